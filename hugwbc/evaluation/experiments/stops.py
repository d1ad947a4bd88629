"""A command to stand while the robot moves: does it brake and stay up?

Every episode moves at one of several speeds and is told to stand at a random time of its stride, as by a key or by the
end of a connection. The change of gait waits for the brake of the control period.
"""

import dataclasses

import numpy as np
import polars as pl

from hugwbc.commands import default_command
from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.evaluation.episode import MOVING, CountedSettings, Row, ending, simulate
from hugwbc.evaluation.experiment import Experiment
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import bootstrap_mean, wilson_of
from hugwbc.evaluation.plans import Knot, Plan, Schedule
from hugwbc.gait import Gait
from hugwbc.settings import Count, Positive, settings

SPEEDS = (0.6, 1.0, 1.5)  # [m/s]
WAYS = {
    "forwards": lambda speed: {"v_x": speed},
    "sideways": lambda speed: {"v_y": speed},
    "turning": lambda speed: {"v_x": speed, "omega": 0.6},
}
STILL = 0.1  # [m/s], below which a robot has stopped
_BRAKING = 4.0  # [s] after `settle`, in which a robot is told to stand, within a stride, and comes to rest


@settings(kw_only=True)
class StopsSettings(CountedSettings):
    """Settings of stops."""

    # number of episodes of each speed and way; speeds beyond the range of a command are left out
    episodes: Count = 6
    speeds: tuple[Positive, ...] = SPEEDS  # commanded speeds [m/s]
    settle: Positive = 3.0  # time of moving before the robot is told to stand [s]
    duration: Positive = 9.0  # duration of an episode [s]
    possible = MOVING

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.duration < self.settle + _BRAKING:
            raise ConfigError(
                f"duration is {self.duration} s; give {_BRAKING:g} s more than settle, in which the robot can stop"
            )
        if not self.ways:
            raise ConfigError(f"speeds are {', '.join(map(str, self.speeds))}; none is within the {self.gait} gait's")

    @property
    def ways(self) -> dict[str, dict[str, float]]:
        """Velocities of each way and speed that the gait admits for the robot, by name."""
        found = {f"{way} at {speed:g} m/s": values(speed) for way, values in WAYS.items() for speed in self.speeds}
        start, robot = self.default_command(), self.robot
        return {n: values for n, values in found.items() if not dataclasses.replace(start, **values).clamp(robot)[1]}


def plan(settings: StopsSettings) -> list[Plan]:
    """Return the episodes of each way and speed; each stops at another time of a stride."""
    plans, stand = [], default_command(Gait.STANDING, settings.robot)
    for cell, (name, values) in enumerate(settings.ways.items()):
        for number in range(settings.episodes):
            draw = cell * settings.episodes + number
            moving = dataclasses.replace(settings.default_command(draw), **values)
            at = settings.settle + float(np.random.default_rng((settings.seed, draw)).uniform()) / moving.f
            commands = Schedule((Knot(0.0, moving), Knot(at, stand)))
            plans.append(Plan(draw, commands, {"way": name, "at": at}))
    return plans


def episode(controller: Controller, settings: StopsSettings, plan: Plan) -> Row:
    """Return time [s] and path [m] from the command to stand until the pelvis stays slow; None if it never does."""
    trace, at = simulate(controller, settings, plan), float(plan.tags["at"])
    speed = np.linalg.norm(trace.measured[:, :2], axis=1)
    begin = int(np.searchsorted(trace.time, at))
    fast = begin + np.flatnonzero(speed[begin:] > STILL)
    still = int(fast[-1]) + 1 if fast.size else begin
    if still >= len(trace.time):
        return {"stop_s": None, "moved": None, **ending(trace)}
    moved = np.linalg.norm(np.diff(trace.qpos[begin : still + 1, :2], axis=0), axis=1).sum()
    return {"stop_s": float(trace.time[still]) - at, "moved": float(moved), **ending(trace)}


def figures(settings: StopsSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return falls of each way and speed, and time and distance of the stops without a fall.

    Robots that do not come to rest have neither, and are counted where there are any.
    """
    table, found = f"Told to stand, {settings.gait}", []
    for (way,), part in rows.group_by("way", maintain_order=True):
        upright = part.filter(~pl.col("fell"))
        found += [
            falls_figure(table, part["fell"], quantity=f"{way}: falls"),
            Figure(table, f"{way}: time until still", "s", bootstrap_mean(upright["stop_s"])),
            Figure(table, f"{way}: way until still", "m", bootstrap_mean(upright["moved"])),
        ]
        if restless := upright["stop_s"].null_count():
            found.append(Figure(table, f"{way}: never still", "% of episodes", wilson_of(restless, len(part))))
    return [*found, falls_figure(table, rows["fell"])]


EXPERIMENT = Experiment(
    "stops",
    "told to stand at once at several speeds: falls, and distance after the command",
    StopsSettings,
    plan,
    episode,
    figures,
)

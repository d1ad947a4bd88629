"""The paper's test on the real robot, in simulation: p and w go from their minimum to their maximum, in five runs.

Each run uses another robot: ground friction, payload and joint gains are drawn from the training's ranges.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import polars as pl

from hugwbc.commands import MEASURED_NAMES, Command, command_ranges
from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.evaluation.episode import CountedSettings, Row, ending, simulate
from hugwbc.evaluation.experiment import Experiment, Measured, Section
from hugwbc.evaluation.figures import FALLS, Figure, falls_figure
from hugwbc.evaluation.intervals import bootstrap_mean, known
from hugwbc.evaluation.metrics import tracking_errors
from hugwbc.evaluation.paper import real_robot_errors
from hugwbc.evaluation.plans import Knot, Plan, Schedule
from hugwbc.settings import Count, NotNegative, Positive, settings
from hugwbc.viz import evaluation_plots
from hugwbc.viz.plots import Panel

RAMPED = ("p", "w")
_START, _APPROACH = 1.0, 2.0  # [s] at the default command, and from there to the minimum
_CURVE_POINTS = 21


@settings(kw_only=True)
class RampSettings(CountedSettings):
    """Settings of ramp."""

    episodes: Count = 5  # number of runs of each command
    duration: Positive = 14.0  # length of an episode, with which the ramp ends [s]
    settle: NotNegative = 4.0  # start of the ramp [s]
    varied = frozenset({"payload", "friction", "gain"})  # drawn for every run
    possible = ("standing", "walking", "jumping")  # hopping does not command p and w

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.settle < _START + _APPROACH:
            raise ConfigError(f"the ramp begins at settle = {self.settle} s; give {_START + _APPROACH} s or more")


def plan(settings: RampSettings) -> list[Plan]:
    """Return the runs of p, then those of w, on the same drawn robots."""
    return [
        Plan(
            draw,
            ramp_schedule(settings, name),
            {"command": name},
            conditions=settings.conditions.of_a_drawn_robot(np.random.default_rng((settings.seed, draw))),
        )
        for name in RAMPED
        for draw in range(settings.episodes)
    ]


def ramp_schedule(settings: RampSettings, name: str) -> Schedule:
    """Go from the default command to one command's minimum, then linearly from `settle` to the end to its maximum."""
    low, high = command_ranges(settings.gaits[0], settings.robot)[name].finishing
    start = settings.default_command()

    def at(value: float) -> Command:
        return dataclasses.replace(start, **{name: value})

    ramp = settings.duration - settings.settle
    return Schedule((Knot(0.0, start), Knot(_START, at(low), _APPROACH), Knot(settings.settle, at(high), ramp)))


def episode(controller: Controller, settings: RampSettings, plan: Plan) -> Row:
    """Return the mean absolute error during the ramp, and the measured values by commanded value [rad].

    The curve has 21 commanded values; without those after a fall.
    """
    trace, name = simulate(controller, settings, plan), str(plan.tags["command"])
    ramp = settings.duration - settings.settle
    times = settings.settle + ramp * np.arange(_CURVE_POINTS) / (_CURVE_POINTS - 1)
    samples = np.searchsorted(trace.time, times - 1e-9)
    measured = trace.measured[:, MEASURED_NAMES.index(name)]
    robot = settings.robot
    values = np.linspace(*command_ranges(settings.gaits[0], robot)[name].finishing, _CURVE_POINTS)
    # The end of the ramp is the end of the episode, one sample after the last.
    samples = np.where(math.isclose(trace.survived_s, times[-1]), np.minimum(samples, len(measured) - 1), samples)
    kept = samples < len(measured)
    return {
        "error": known(tracking_errors(trace, settings.settle)[name]),
        "commanded": values[kept].tolist(),
        "measured": measured[samples[kept]].tolist(),
        **ending(trace),
    }


def figures(settings: RampSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return the errors of p and w with the paper's on the real robot, and the falls."""
    table, paper, found = f"Ramp, {settings.gait}", real_robot_errors(settings.gaits[0]), []
    for name in RAMPED:
        errors = rows.filter(pl.col("command") == name)["error"]
        found.append(Figure(table, f"E_{name}", "rad", bootstrap_mean(errors), paper.get(f"E_{name}")))
    for name in RAMPED:
        fell = rows.filter(pl.col("command") == name)["fell"]
        found.append(falls_figure(table, fell, quantity=f"{FALLS}, {name}"))
    return found


def pictures(measured: Sequence[Measured], controllers: Sequence[str]) -> list[Panel]:
    """Return measured over commanded value, averaged over the runs, for each gait and command."""
    drawn = []
    for gait in dict.fromkeys(chosen.gait for _, chosen, _ in measured):
        for command in RAMPED:
            found = {name: _mean_curve(rows, command) for name, chosen, rows in measured if chosen.gait == gait}
            series = {name: found.get(name, (np.zeros(0), np.zeros(0))) for name in controllers}
            labels = (f"commanded {command} [rad]", "measured [rad]")
            drawn.append(evaluation_plots.curves(f"{command}, {gait}", series, labels))
    return drawn


def _mean_curve(rows: pl.DataFrame, command: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the commanded values, and the mean of what the runs that got there measured."""
    points = rows.filter(pl.col("command") == command).select("commanded", "measured").explode("commanded", "measured")
    curve = points.drop_nulls().group_by("commanded").agg(pl.col("measured").mean()).sort("commanded")
    return curve["commanded"].to_numpy(), curve["measured"].to_numpy()


EXPERIMENT = Experiment(
    "ramp",
    "ramp p and w from their minimum to their maximum, as on the paper's real robot",
    RampSettings,
    plan,
    episode,
    figures,
    section=Section(
        "Ramp",
        "p and w go from minimum to maximum. Every run has a robot with other friction, payload and gains. The paper's "
        "figures are from its real robot, ours from simulation.",
        lambda: [RampSettings(gait=gait, episodes=2, duration=10.0) for gait in ("standing", "walking", "jumping")],
        lambda: [RampSettings(gait=gait) for gait in ("standing", "walking", "jumping")],
        pictures,
    ),
)

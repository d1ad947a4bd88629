"""Forces from outside: a pull at the hands, a wall to press, masses to carry, hands that sway, and pushes on the trunk.

A robot stands or walks with its hands held at their targets. With the sensors of a robot, the estimate of the forces on
the hands is compared with the truth as well.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Annotated

import numpy as np
import polars as pl
from pydantic import Field

from hugwbc.commands import Command, default_command
from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.evaluation import metrics
from hugwbc.evaluation.episode import CountedSettings, Row, ending, simulate, simulation_of
from hugwbc.evaluation.experiment import Experiment, numbered
from hugwbc.evaluation.experiments.hands import arms_size
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import (
    Estimate,
    bootstrap_mean,
    bootstrap_median,
    bootstrap_rms,
    known,
    paired_ratio,
    root,
    scaled,
    wilson_percentage,
)
from hugwbc.evaluation.plans import Plan
from hugwbc.gait import Gait
from hugwbc.robot import SIDES, Robot
from hugwbc.runtime.trace import Trace
from hugwbc.settings import Count, settings
from hugwbc.sim import Engine, Force
from hugwbc.sim.forces import HandPull
from hugwbc.sim.scenes.furniture import Wall
from hugwbc.sim.scenes.scene import Scene
from hugwbc.state import GRAVITY, RobotState
from hugwbc.targets import HandTargets

DIRECTIONS = tuple(range(0, 360, 45))  # [deg], counted from the robot's front to its left
TAKEN = 0.5  # [s], when the arms are taken over
STARTED = 1.0  # [s], when a walk starts
V_X = 0.4  # [m/s], velocity of a walk
BEGIN = 3.0  # [s], when a force begins
RISE = 1.0  # [s], in which a steady force rises
HANDS = ((0.35, 0.2, 0.15), (0.35, -0.2, 0.15))  # targets in the pelvis frame of an H1 [m]

Newtons = Annotated[float, Field(gt=0, le=500)]


@settings(kw_only=True)
class ForcesSettings(CountedSettings):
    """Settings of the experiments with forces, which have times of their own."""

    gait: str = "standing"  # standing or walking
    episodes: Count = 2  # number of episodes; of pull, for each direction
    varied = frozenset({"settle", "duration", "intervention", "motions", "hand_payload"})
    possible = ("standing", "walking")


@settings(kw_only=True)
class WalkSettings(ForcesSettings):
    """Settings of an experiment in which the robot walks."""

    gait: str = "walking"  # walking
    possible = ("walking",)


def hand_places(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Return `HANDS` in proportion to the arms of a robot [m]."""
    left, right = arms_size(robot) * np.array(HANDS)
    return left, right


@dataclasses.dataclass(frozen=True)
class Source:
    """Stands, and walks from `STARTED` on; the hands are taken at `TAKEN`."""

    robot: Robot
    v_x: float | None  # velocity of the walk [m/s]; None stands
    hands: HandTargets  # targets of the hands

    @classmethod
    def of(cls, settings: ForcesSettings, hands: HandTargets | None = None) -> "Source":
        """Return the source of an experiment that stands or walks by its gait; by default the hands are at `HANDS`."""
        robot = settings.robot
        return cls(robot, V_X if settings.gait == "walking" else None, hands or HandTargets.of(*hand_places(robot)))

    def command_at(self, t: float) -> Command:
        """Return the command: a stand, or a walk that gets faster within a second."""
        if self.v_x is None or t < STARTED:
            return default_command(Gait.STANDING, self.robot)
        walk = default_command(Gait.WALKING, self.robot)
        return dataclasses.replace(walk, v_x=min(t - STARTED, 1.0) * self.v_x)

    def hands_at(self, t: float) -> HandTargets | None:
        """Return the targets of the hands."""
        return None if t < TAKEN else self.hands


class HandForceErrors:
    """Errors of the estimated forces on the hands, taken after each physics step from `BEGIN` + `RISE` on."""

    def __init__(self, force: Callable[[RobotState], np.ndarray | None]) -> None:
        """Begin, given the true force on each hand in a state [N], shape (2, 3)."""
        self._force = force
        self._squares: list[float] = []

    def __call__(self, truth: RobotState, estimate: RobotState) -> None:
        """Take the true and the estimated state after a physics step."""
        if truth.time <= BEGIN + RISE or estimate.hand_force is None:
            return
        force = self._force(truth)
        if force is not None:
            self._squares.append(float(np.mean(np.sum((estimate.hand_force - force) ** 2, axis=1))))

    def row(self, trace: Trace) -> Row:
        """Return the root mean square error of a hand's force in the episode [N]; None after a fall."""
        counted = self._squares and not trace.down
        return {"estimate_error": math.sqrt(float(np.mean(self._squares))) if counted else None}


def estimate_figure(table: str, rows: pl.DataFrame) -> Figure:
    """Return the error of the estimated forces."""
    return Figure(table, "error of the estimated force on a hand, RMS", "N", bootstrap_rms(rows["estimate_error"]))


def play(
    controller: Controller,
    settings: ForcesSettings,
    plan: Plan,
    source: Source,
    simulation: Engine,
    duration: float,
    on_step: Callable[[RobotState, RobotState], None] | None = None,
) -> Trace:
    """Run one episode of a duration [s]."""
    where = {"source": source, "simulation": simulation, "upper_body": settings.conditions.upper_body()}
    return simulate(controller, settings, plan, **where, duration=duration, on_step=on_step)


def heading(direction: float) -> np.ndarray:
    """Return the horizontal unit vector of a direction [deg] in the heading frame, shape (3,)."""
    return np.array([math.cos(math.radians(direction)), math.sin(math.radians(direction)), 0.0])


# A steady force on both hands together, from each of eight directions.

PULLED = 5.0  # [s] of the full pull


@settings(kw_only=True)
class PullSettings(ForcesSettings):
    """Settings of pull."""

    force: Newtons = 40.0  # steady force on both hands together [N]


def pull_plan(settings: PullSettings) -> list[Plan]:
    """Return the episodes of each direction."""
    return [Plan(draw, tags={"direction": d}) for d in DIRECTIONS for draw in range(settings.episodes)]


def pull_episode(controller: Controller, settings: PullSettings, plan: Plan) -> Row:
    """Return whether the robot fell, and the error of the estimated force [N]."""
    duration = BEGIN + RISE + PULLED
    simulation = simulation_of(settings, plan, duration)
    pull = HandPull(simulation, settings.force * heading(float(plan.tags["direction"])), BEGIN, RISE)
    errors = HandForceErrors(lambda truth: np.asarray(pull.force))

    def on_step(truth: RobotState, estimate: RobotState) -> None:
        pull.update(truth)
        errors(truth, estimate)

    trace = play(controller, settings, plan, Source.of(settings), simulation, duration, on_step)
    return {**errors.row(trace), **ending(trace)}


def pull_figures(settings: PullSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return how often the robot stays up by direction, the error of the estimated force, and the falls."""
    table = f"Pulled with {settings.force:g} N at the hands, {settings.gait}"
    found = []
    for direction in DIRECTIONS:
        up = wilson_percentage(~rows.filter(pl.col("direction") == direction)["fell"])
        found.append(Figure(table, f"stays up, {direction}°", "% of episodes", up, higher_is_better=True))
    return [*found, estimate_figure(table, rows), falls_figure(table, rows["fell"])]


PULL = Experiment(
    "pull",
    "a steady pull at the hands from eight directions: does the robot stay up",
    PullSettings,
    pull_plan,
    pull_episode,
    pull_figures,
)


# The left hand of a standing robot presses a wall with a requested force.

WALL = 0.42  # [m], distance of the wall's surface ahead of the start, for the arms of an H1
HEIGHT = 1.12  # at which the hand presses, as a multiple of the pelvis's nominal height
PRESSURE = 40.0  # [N], requested
PRESSED, STEADY = 4.0, 1.0  # [s]: press, and how long the hand has to become steady


@settings(kw_only=True)
class PressSettings(ForcesSettings):
    """Settings of press."""

    possible = ("standing",)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.conditions.engine != "mujoco":
            raise ConfigError("a wall to press needs the engine mujoco; leave out the engine")


@dataclasses.dataclass(frozen=True)
class PressSource(Source):
    """Holds the left hand before the wall, and presses from `BEGIN` on."""

    def hands_at(self, t: float) -> HandTargets | None:
        """Return the target of the left hand, with the force while it presses."""
        if t < TAKEN:
            return None
        pressing, size = t >= BEGIN, arms_size(self.robot)
        height = HEIGHT * self.robot.nominal_height
        target = (size * WALL - (0.02 if pressing else 0.05), size * HANDS[0][1], height)
        return HandTargets.of(target, None, "world", left_force=(-PRESSURE, 0.0, 0.0) if pressing else None)


def press_episode(controller: Controller, settings: PressSettings, plan: Plan) -> Row:
    """Return the mean absolute error of the force against the wall [N], `STEADY` after its rise; None after a fall."""
    rising = PRESSURE / 100.0
    duration = BEGIN + rising + PRESSED
    wall = Wall(name="wall", position=(arms_size(settings.robot) * WALL + 0.05, 0.0), size=(0.1, 3.0, 2.5))
    misses: list[float] = []
    errors = HandForceErrors(lambda truth: truth.hand_force)

    def on_step(truth: RobotState, estimate: RobotState) -> None:
        errors(truth, estimate)
        if truth.hand_force is not None and truth.time > BEGIN + rising + STEADY:
            misses.append(abs(-float(truth.hand_force[0, 0]) - PRESSURE))

    simulation = simulation_of(settings, plan, duration, Scene((wall,)))
    trace = play(controller, settings, plan, PressSource.of(settings), simulation, duration, on_step)
    error = float(np.mean(misses)) if misses and not trace.down else None
    return {"error": error, **errors.row(trace), **ending(trace)}


def press_figures(settings: PressSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return the error of the force, that of its estimate, and the falls."""
    table = f"Press a wall with {PRESSURE:g} N"
    error = Figure(table, "error of the force", "N", bootstrap_mean(rows["error"]))
    return [error, estimate_figure(table, rows), falls_figure(table, rows["fell"])]


PRESS = Experiment(
    "press",
    "press a wall with a requested force: how far the contact force is off",
    PressSettings,
    numbered,
    press_episode,
    press_figures,
)


# A mass in each hand that nobody is told, standing or walking.

CARRIED = BEGIN + 3.0  # [s], length of an episode


@settings(kw_only=True)
class CarrySettings(ForcesSettings):
    """Settings of carry."""

    load: Annotated[float, Field(ge=0, le=20)] = 3.0  # mass in each hand [kg]


def carry_plan(settings: CarrySettings) -> list[Plan]:
    """Return the episodes, which differ in the errors of the sensors."""
    loaded = dataclasses.replace(settings.conditions, hand_payload=settings.load)
    return [Plan(draw, conditions=loaded) for draw in range(settings.episodes)]


def carry_episode(controller: Controller, settings: CarrySettings, plan: Plan) -> Row:
    """Return how far both hands are below their targets on average [m], and the error of the estimated load [N]."""
    weight = np.tile((0.0, 0.0, -GRAVITY * settings.load), (2, 1))
    errors, simulation = HandForceErrors(lambda truth: weight), simulation_of(settings, plan, CARRIED)
    trace = play(controller, settings, plan, Source.of(settings), simulation, CARRIED, errors)
    kept = trace.time >= BEGIN
    hands = metrics.places(trace, [f"{side}_hand" for side in SIDES], kept)  # the record has only their distances
    sag = None if trace.down else known(float(np.nanmean(trace.hand_target_world[kept, :, 2] - hands[..., 2])))
    return {"sag": sag, **errors.row(trace), **ending(trace)}


def carry_figures(settings: CarrySettings, rows: pl.DataFrame) -> list[Figure]:
    """Return the sag, the error of the estimated load, and the falls."""
    table = f"Carry {settings.load:g} kg in each hand, {settings.gait}"
    sagging = Figure(table, "sag of the hands", "cm", scaled(bootstrap_mean(rows["sag"]), 100.0))
    return [sagging, estimate_figure(table, rows), falls_figure(table, rows["fell"])]


CARRY = Experiment(
    "carry",
    "a mass in each hand that nobody is told: how far the hands sag",
    CarrySettings,
    carry_plan,
    carry_episode,
    carry_figures,
)


# A sudden push on the trunk of a walk: the largest change of velocity that is survived.

PUSH_TIME = 0.1  # [s]
PUSH_STEP, PUSH_MOST = 0.2, 2.4  # [m/s], between two pushes and the largest one
ENDED = "ladders that ended in a fall"
RECOVERY = 3.0  # [s] after a push begins, in which the robot must not fall


@settings(kw_only=True)
class PushSettings(WalkSettings):
    """Settings of push."""

    episodes: Count = 4  # number of ladders of pushes in each direction


def next_pushes(settings: PushSettings, rows: Sequence[Row]) -> list[Plan]:
    """Return the next larger push of every ladder (a direction and a draw) that survived all pushes so far."""
    plans, mass = [], settings.robot.mass + settings.conditions.payload
    stride = 1.0 / default_command(Gait.WALKING, settings.robot).f
    for direction in DIRECTIONS:
        for draw in range(settings.episodes):
            steps = [row["fell"] for row in rows if (row["direction"], row["number"]) == (direction, draw)]
            if any(steps) or len(steps) >= round(PUSH_MOST / PUSH_STEP):
                continue
            change = (len(steps) + 1) * PUSH_STEP
            vector = tuple((mass * change / PUSH_TIME * heading(direction)).tolist())
            # The ladders of one direction meet the gait at times that are spread evenly over a stride.
            push = Force(vector, BEGIN + stride * draw / settings.episodes, PUSH_TIME, frame="heading")
            tags = {"direction": direction, "number": draw, "change": change}
            plans.append(Plan(draw, tags=tags, forces=(push,)))
    return plans


def push_episode(controller: Controller, settings: PushSettings, plan: Plan) -> Row:
    """Return whether the robot fell."""
    duration = plan.forces[0].start + RECOVERY
    simulation = simulation_of(settings, plan, duration)
    return ending(play(controller, settings, plan, Source.of(settings), simulation, duration))


def survived(settings: PushSettings, rows: pl.DataFrame) -> dict[int, list[float]]:
    """Return the largest change of velocity that was survived in each ladder by direction [m/s]."""
    upright = rows.filter(~pl.col("fell"))
    largest = {
        (direction, number): change
        for direction, number, change in upright.group_by("direction", "number").agg(pl.col("change").max()).iter_rows()
    }
    return {d: [largest.get((d, number), 0.0) for number in range(settings.episodes)] for d in DIRECTIONS}


def push_figures(settings: PushSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return the median of the largest survived changes of velocity, by direction and of all, and how ladders ended."""
    table, changes = f"Survived push in a walk at {V_X:g} m/s", survived(settings, rows)
    medians = {
        f"{direction}°": Estimate(float(np.median(found)), None, None, len(found))
        for direction, found in changes.items()
    }
    medians["median of all"] = bootstrap_median([change for found in changes.values() for change in found])
    ended = rows.group_by("direction", "number").agg(pl.col("fell").any())["fell"]
    return [
        *(Figure(table, name, "m/s", median, higher_is_better=True) for name, median in medians.items()),
        Figure(table, ENDED, "% of ladders", wilson_percentage(ended)),
    ]


PUSH = Experiment(
    "push",
    "sudden pushes on the trunk of a walk from eight directions: the largest that is survived",
    PushSettings,
    lambda settings: next_pushes(settings, ()),
    push_episode,
    push_figures,
    following=next_pushes,
    note=f"A ladder of pushes gets stronger by {PUSH_STEP:g} m/s until the robot falls or survives {PUSH_MOST:g} m/s.",
)


# How much the hands accelerate in a walk, held in the "steady" frame and with the arm joints held stiff.

SWAYED_FROM = 9.0  # [s], when the acceleration of the hands counts: they have learned the stride by then
SWAYED = 6.0  # [s], for which it counts


def sway_plan(settings: WalkSettings) -> list[Plan]:
    """Return a walk with steady hands and one with stiff arms for each draw."""
    walks = [(draw, arms) for draw in range(settings.episodes) for arms in ("steady", "stiff")]
    return [Plan(draw, tags={"arms": arms, "walk": draw}) for draw, arms in walks]


def sway_episode(controller: Controller, settings: WalkSettings, plan: Plan) -> Row:
    """Return the root mean square of the hands' acceleration [m/s^2]; None after a fall."""
    duration, robot = SWAYED_FROM + SWAYED, settings.robot
    stiff = HandTargets(None, None, joints=robot.nominal[robot.arms])
    hands = HandTargets.of(*hand_places(robot), "steady") if plan.tags["arms"] == "steady" else stiff
    source = Source.of(settings, hands)
    trace = play(controller, settings, plan, source, simulation_of(settings, plan, duration), duration)
    hands = metrics.places(trace, [f"{side}_hand" for side in SIDES], trace.time >= SWAYED_FROM)
    return {"acceleration": None if trace.down else known(metrics.hand_acceleration(hands)), **ending(trace)}


def sway_figures(settings: WalkSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return the hands' accelerations, held steady and with stiff arms, their ratio without a fall, and the falls."""
    table = f"Sway of the hands at {V_X:g} m/s"
    steady, stiff = (rows.filter(pl.col("arms") == arms).select("walk", "acceleration") for arms in ("steady", "stiff"))
    both = steady.join(stiff, on="walk", suffix="_stiff").drop_nulls()
    squares = ([value**2 for value in both[name]] for name in ("acceleration", "acceleration_stiff"))
    return [
        Figure(table, "acceleration of the hands, steady frame, RMS", "m/s²", bootstrap_rms(steady["acceleration"])),
        Figure(table, "acceleration with stiff arm joints, RMS", "m/s²", bootstrap_rms(stiff["acceleration"])),
        Figure(table, "ratio", "", root(paired_ratio(*squares))),
        falls_figure(table, rows["fell"]),
    ]


SWAY = Experiment(
    "sway",
    "how much the hands accelerate in a walk, held steady and with stiff arms",
    WalkSettings,
    sway_plan,
    sway_episode,
    sway_figures,
)

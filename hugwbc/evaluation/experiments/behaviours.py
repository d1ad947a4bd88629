"""Behaviours, again and again: the user's own, `walk_to` any goal, and boxes by mass and height.

How often does one succeed, how long does it take, and why does it fail?
"""

import math
from collections.abc import Iterator
from typing import Annotated

import numpy as np
import polars as pl
from pydantic import Field

from hugwbc import rotations
from hugwbc.behaviours import (
    Behaviour,
    BehaviourSource,
    BoxGrip,
    Course,
    Status,
    View,
    doing,
    load_behaviour,
    seen,
    walk_to,
)
from hugwbc.behaviours.boxes import DISTANCE as NEAR
from hugwbc.behaviours.hands import stature
from hugwbc.commands import Command
from hugwbc.controller import Controller
from hugwbc.evaluation.episode import BY_BEHAVIOUR, CountedSettings, Row, Settings, ending, simulate, simulation_of
from hugwbc.evaluation.experiment import Experiment, numbered
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import bootstrap_mean, wilson_of, wilson_percentage
from hugwbc.evaluation.plans import Plan
from hugwbc.rotations import wrap_angle
from hugwbc.settings import Count, Positive, check_each_once, settings
from hugwbc.sim import Engine, Scene, Simulation, load_scene
from hugwbc.sim.scenes import Box, Step
from hugwbc.sim.scenes.varied import Uniform
from hugwbc.state import GRAVITY
from hugwbc.tasks.judges import apart, at_rest, hands_off, happened, lifted, stands_on, upright
from hugwbc.tasks.run_task import run_task
from hugwbc.tasks.task import LONGEST, Task
from hugwbc.tasks.verdict import without_time


@settings(kw_only=True)
class BehavioursSettings(CountedSettings):
    """Settings of behaviours."""

    # number of episodes; what varies in the scene, and the sensors' errors, differ from one to the next
    episodes: Count = 10
    behaviour: str = "fetch_cup"  # name of a shipped behaviour, or FILE.py:NAME
    scene: str = "cupboard"  # name of a shipped scene, or a YAML file
    duration: Positive = 120.0  # longest time of an episode [s]
    varied = BY_BEHAVIOUR

    def __post_init__(self) -> None:
        super().__post_init__()
        load_scene(self.scene)
        load_behaviour(self.behaviour)


def play(
    controller: Controller, settings: Settings, plan: Plan, behaviour: Behaviour, scene: Scene
) -> tuple[Row, Engine]:
    """Play a behaviour; return how it ended, and the simulation after it.

    - `success`: whether the behaviour ended with success, and no object left the world; `seconds`: when, None if not
      [s]; `ending`: what it said, or what went wrong with robot or objects.
    """
    source, simulation = BehaviourSource(behaviour), simulation_of(settings, plan, scene=scene)
    where = {"source": source, "simulation": simulation, "upper_body": settings.conditions.upper_body()}
    trace = simulate(controller, settings, plan, **where, until=lambda: source.done)
    problem = without_time(next(iter(trace.problems), ""))
    success = source.status is Status.SUCCESS and not trace.down and not problem
    seconds = simulation.time if success else None
    how = problem or ("a fall" if trace.down else source.ending)
    return {**ending(trace), "success": success, "seconds": seconds, "ending": how}, simulation


def episode(controller: Controller, settings: BehavioursSettings, plan: Plan) -> Row:
    """Return how the behaviour ended, and where the objects then were [m]."""
    row, simulation = play(controller, settings, plan, load_behaviour(settings.behaviour), load_scene(settings.scene))
    return row | {"objects": {name: pose.position.round(3).tolist() for name, pose in simulation.objects.items()}}


def figures(settings: BehavioursSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return how often it was done, its time, and the other endings."""
    table, done = settings.behaviour, rows.filter(pl.col("success"))
    success = wilson_percentage(rows["success"])
    return [
        Figure(table, "done", "% of episodes", success, higher_is_better=True),
        Figure(table, "time", "s", bootstrap_mean(done["seconds"])),
        *other_endings(table, "", rows),
        falls_figure(table, rows["fell"]),
    ]


def other_endings(table: str, place: str, rows: pl.DataFrame) -> Iterator[Figure]:
    """Yield the share of each ending without success, called by `place` and its words, with "..." for numbers."""
    failed = rows.filter(~pl.col("success")).with_columns(pl.col("ending").str.replace_all(r"-?\d+(\.\d+)?", "..."))
    endings = failed.group_by("ending", maintain_order=True).len()
    for words, count in endings.iter_rows():
        yield Figure(table, f"{place}{words}", "% of episodes", wilson_of(count, len(rows)))


BEHAVIOURS = Experiment(
    "behaviours",
    "a behaviour of your own, again and again: how often it is done, and why not",
    BehavioursSettings,
    numbered,
    episode,
    figures,
)


# Does `walk_to` arrive? Goals at any distance and heading, with the defaults of the behaviour. A box far away makes the
# place a scene, in which the robot's pose is told as by motion capture, without drift.

GOALS = (0.3, 3.0)  # [m], distances
AWAY = Scene((Box(name="far", position=(9.0, 9.0), size=(0.2, 0.2, 0.2), mass=1.0),))


@settings(kw_only=True)
class ArriveSettings(CountedSettings):
    """Settings of arrive."""

    episodes: Count = 20  # number of goals
    duration: Positive = 60.0  # longest time of an episode [s]
    varied = BY_BEHAVIOUR


def arrive_plan(settings: ArriveSettings) -> list[Plan]:
    """Return an episode for each goal: distances and bearings are uniform, and so is the heading at the goal."""
    plans = []
    for draw in range(settings.episodes):
        rng = np.random.default_rng((settings.seed, draw))
        distance, bearing = rng.uniform(*GOALS), rng.uniform(-math.pi, math.pi)
        goal = {"x": distance * math.cos(bearing), "y": distance * math.sin(bearing)}
        plans.append(Plan(draw, tags={**goal, "yaw": float(rng.uniform(-math.pi, math.pi))}))
    return plans


def arrive_episode(controller: Controller, settings: ArriveSettings, plan: Plan) -> Row:
    """Return whether and when the behaviour ended with success, and how far the robot truly stood from the goal.

    - `distance`: of the pelvis from the goal [m]; `angle`: of the heading from that of the goal [deg]. None for walks
      that did not arrive.
    """
    x, y, yaw = (float(plan.tags[name]) for name in ("x", "y", "yaw"))
    row, simulation = play(controller, settings, plan, lambda view: walk_to(view, (x, y), yaw), AWAY)
    if not row["success"]:
        return row | {"distance": None, "angle": None}
    state = simulation.state()
    assert state.position is not None
    away = math.hypot(state.position[0] - x, state.position[1] - y)
    return row | {"distance": away, "angle": abs(math.degrees(float(wrap_angle(state.yaw - yaw))))}


def arrive_figures(settings: ArriveSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return the share of goals that were reached, time and true error of these, and the falls."""
    table, done = "Goals of 0.3 to 3 m, any heading", rows.filter(pl.col("success"))
    found = [
        Figure(table, "arrived", "% of goals", wilson_percentage(rows["success"]), higher_is_better=True),
        Figure(table, "time", "s", bootstrap_mean(done["seconds"])),
        Figure(table, "true distance", "m", bootstrap_mean(done["distance"])),
        Figure(table, "true angle", "deg", bootstrap_mean(done["angle"])),
    ]
    return [*found, falls_figure(table, rows["fell"])]


ARRIVE = Experiment(
    "arrive",
    "walk_to goals of 0.3 to 3 m and any heading: how often it arrives, how fast, how exactly",
    ArriveSettings,
    arrive_plan,
    arrive_episode,
    arrive_figures,
)


# Lift a box, carry it back and forth, set it down where it stood, and let go. Figures are an H1's; those of other
# robots are in proportion, as in tasks.

SIZE = (0.2, 0.28, 0.28)  # [m]
FRICTION = Uniform(0.6, 1.0)
HEAVIEST = 2.0 * FRICTION.low * BoxGrip(SIZE[1]).force / (2.0 * GRAVITY)  # [kg], with half of the friction to spare
_AT = (0.0, 0.08)  # [m], where the hands press: above the middle, so that the box hangs
_BACK = 0.4  # [m]
OFF = 0.10  # [m], by which it may be off its place
_LOW = 0.7  # [m], below which the robot bends over the box, and its knees need room
_SLIPS = 0.5  # [m], below which a box slips out of hands that only press on it
_BENT, _FAR = Command(h=-0.3, p=0.4), 0.50  # posture, and distance from the pelvis [m]


@settings(kw_only=True)
class BoxesSettings(CountedSettings):
    """Settings of boxes."""

    episodes: Count = 20  # number of episodes of each mass and height
    masses: tuple[Positive, ...] = (2.0, 4.0, 6.0)  # masses of an H1's boxes [kg]; others' are scaled to the robot
    heights: tuple[Positive, ...] = (0.3, 0.6, 0.9)  # heights on which an H1's boxes stand [m]; also scaled
    # longest time of an episode [s]
    duration: Annotated[float, Field(gt=0, le=LONGEST)] = 70.0
    varied = BY_BEHAVIOUR | {"engine", "terrain_roughness", "slope"}

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("masses", "heights"):
            check_each_once(name, [f"{value:g}" for value in getattr(self, name)])


def boxes_plan(settings: BoxesSettings) -> list[Plan]:
    """Return the episodes of each mass and height."""
    cells = [(mass, height) for mass in settings.masses for height in settings.heights]
    return [
        Plan(draw, tags={"mass": mass, "height": height}) for mass, height in cells for draw in range(settings.episodes)
    ]


def scene(mass: float, height: float) -> Scene:
    """Return a box of a mass [kg] at the front edge of a block of a height [m]."""
    stand = Step(name="stand", position=(0.95, 0.0), size=(0.3, 0.5, height))
    place = (-0.05, Uniform(-0.05, 0.05))
    box = Box(name="box", on="stand", position=place, yaw=Uniform(-0.15, 0.15), size=SIZE, mass=mass, friction=FRICTION)
    return Scene((stand, box))


def shift(view: View, mass: float, height: float) -> Course:
    """Take the box, by friction where the arms can press enough, step back and forth with it, and set it down."""
    stood, by_friction = seen(view, "box"), mass <= HEAVIEST and height >= _SLIPS
    box = (BoxGrip if by_friction else BoxGrip.hung)(SIZE[1], at=_AT)
    distance, posture = (_FAR, _BENT) if height < _LOW else (NEAR, None)
    view = yield from box.take(view, "box", distance=distance, posture=posture, height=0.06, speed=0.05)
    here, heading = view.position, view.state.yaw
    for way in (_BACK, 0.0):
        x, y, _ = here - way * rotations.rotation_z(heading)[:, 0]
        view = yield from doing("carry the box", walk_to(view, (float(x), float(y)), heading, speed=0.25))
    view = yield from doing("put the box down", box.put(view, "box", stood.position, stood.yaw, posture))
    return (yield from doing("let go", box.let_go(view)))


def task_of(mass: float, height: float, limit: float) -> Task:
    """Return the task of a box of a mass [kg] on a block of a height [m], with its longest duration [s]."""
    milestones = (
        lifted("box", "the box was not lifted"),
        happened(
            lambda record: apart(record, "box", record.poses["box"][0, :2]) <= OFF,
            f"the box stands more than {100 * OFF:.0f} cm off its place",
        ),
        happened(lambda record: stands_on(record, "box", "stand"), "the box does not stand on the block"),
        upright("box", "the box is not upright"),
        at_rest("box", "the box still moved at the end"),
        hands_off("a hand still touched something at the end"),
    )
    return Task(
        name="boxes",
        about="Take a box from a block, step back and forth with it, and put it where it stood.",
        scene=scene(mass, height),
        behaviour=lambda view, shapes: shift(view, mass, height),
        limit=limit,
        milestones=milestones,
        idealised=("attach",),
    )


def boxes_episode(controller: Controller, settings: BoxesSettings, plan: Plan) -> Row:
    """Return whether it was done, when the behaviour ended [s], and why it was not done."""
    task = task_of(float(plan.tags["mass"]), float(plan.tags["height"]), settings.duration).sized(settings.robot)
    simulation = simulation_of(settings, plan, scene=task.scene)
    assert isinstance(simulation, Simulation)  # the settings refuse other engines
    conditions = settings.conditions
    run = run_task(task, controller, simulation, conditions.estimator(), conditions.upper_body(), strict=False)
    verdict = run.verdict
    return {**ending(run.trace), "success": verdict.success, "seconds": run.seconds, "ending": verdict.reason}


def boxes_figures(settings: BoxesSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return how often a box of each mass was carried from each height and back, and the other endings."""
    found, size = [], stature(settings.robot)
    for (mass, height), part in rows.group_by("mass", "height", maintain_order=True):
        table, place = f"{size**3 * mass:.3g} kg", f"from {size * height:.3g} m"
        success = wilson_percentage(part["success"])
        found.append(Figure(table, f"done {place}", "% of episodes", success, higher_is_better=True))
        found += other_endings(table, f"{place}: ", part)
    return found


BOXES = Experiment(
    "boxes",
    "boxes of several masses from several heights: how often each is lifted, carried and set down again",
    BoxesSettings,
    boxes_plan,
    boxes_episode,
    boxes_figures,
)

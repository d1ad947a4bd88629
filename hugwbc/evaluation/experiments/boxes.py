"""Boxes by mass and height: lift one, carry it back and forth, set it down where it stood, and let go."""

import functools

import polars as pl

from hugwbc import rotations
from hugwbc.behaviours import BoxGrip, Course, View, doing, seen, walk_to
from hugwbc.behaviours.boxes import DISTANCE
from hugwbc.commands import Command
from hugwbc.controller import Controller
from hugwbc.evaluation.episode import CountedSettings, Row
from hugwbc.evaluation.experiment import Experiment
from hugwbc.evaluation.experiments.behaviours import play
from hugwbc.evaluation.figures import Figure
from hugwbc.evaluation.intervals import wilson_of, wilson_percentage
from hugwbc.evaluation.plans import Plan
from hugwbc.settings import Count, Positive, settings
from hugwbc.sim.scenes import Box, Scene, Step
from hugwbc.sim.scenes.varied import Uniform
from hugwbc.state import GRAVITY

SIZE = (0.2, 0.28, 0.28)  # [m]
FRICTION = Uniform(0.6, 1.0)
HEAVIEST = 2.0 * FRICTION.low * BoxGrip(SIZE[1]).force / (2.0 * GRAVITY)  # [kg], with half of the friction to spare
_AT = (0.0, 0.08)  # [m], where the hands press: above the middle, so that the box hangs
_BACK = 0.4  # [m]
_SUNK = 0.02  # [m], by which a box may be off the height at which it stands
_LOW = 0.7  # [m], below which the robot bends over the box, and its knees need room
_SLIPS = 0.5  # [m], below which a box slips out of hands that only press on it
_BENT, _FAR = Command(h=-0.3, p=0.4), 0.50  # posture, and distance from the pelvis [m]


@settings(kw_only=True)
class BoxesSettings(CountedSettings):
    """Settings of boxes."""

    episodes: Count = 20  # number of episodes of each mass and height
    masses: tuple[Positive, ...] = (2.0, 4.0, 6.0)  # of the boxes [kg]
    heights: tuple[Positive, ...] = (0.3, 0.6, 0.9)  # of what they stand on [m]
    duration: Positive = 70.0  # longest time of an episode [s]
    varied = frozenset({"engine", "terrain_roughness", "slope", "intervention", "motions"})


def plan(settings: BoxesSettings) -> list[Plan]:
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
    distance, posture = (_FAR, _BENT) if height < _LOW else (DISTANCE, None)
    view = yield from box.take(view, "box", distance=distance, posture=posture, height=0.06, speed=0.05)
    here, heading = view.position, view.state.yaw
    for way in (_BACK, 0.0):
        x, y, _ = here - way * rotations.rotation_z(heading)[:, 0]
        view = yield from doing("carry the box", walk_to(view, (float(x), float(y)), heading, speed=0.25))
    view = yield from doing("put the box down", box.put(view, "box", stood.position, stood.yaw, posture))
    return (yield from doing("let go", box.let_go(view)))


def episode(controller: Controller, settings: BoxesSettings, plan: Plan) -> Row:
    """Return how it ended; it is done if the box stands on the block again."""
    mass, height = float(plan.tags["mass"]), float(plan.tags["height"])
    behaviour = functools.partial(shift, mass=mass, height=height)
    row, simulation = play(controller, settings, plan, behaviour, scene(mass, height))
    stands = abs(float(simulation.objects["box"].position[2]) - height - SIZE[2] / 2) < _SUNK
    ending = row["ending"] if stands or not row["success"] else "the box does not stand on the block"
    return row | {"success": row["success"] and stands, "ending": ending}


def figures(settings: BoxesSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return how often each mass was done from each height, and the other endings."""
    found = []
    for (mass, height), part in rows.group_by("mass", "height", maintain_order=True):
        table, place = f"{mass:g} kg", f"from {height:g} m"
        success = wilson_percentage(part["success"].to_list())
        found.append(Figure(table, f"done {place}", "% of episodes", success, higher_is_better=True))
        for words, count in part.filter(~pl.col("success")).group_by("ending", maintain_order=True).len().iter_rows():
            found.append(Figure(table, f"{place}: {words}", "% of episodes", wilson_of(count, len(part))))
    return found


EXPERIMENT = Experiment(
    "boxes",
    "boxes of several masses from several heights: how often each is lifted, carried and set down again",
    BoxesSettings,
    plan,
    episode,
    figures,
)

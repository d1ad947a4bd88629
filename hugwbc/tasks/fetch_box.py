"""Take a box from a table between both hands, turn, carry it to another table, and set it down upright."""

import numpy as np

from hugwbc import rotations
from hugwbc.behaviours import Behaviour, BoxGrip, Course, View, doing, seen, step, walk_to
from hugwbc.behaviours.boxes import DISTANCE, carried_at
from hugwbc.behaviours.course import Seconds
from hugwbc.tasks.judges import (
    apart,
    at_rest,
    hands_off,
    happened,
    lifted,
    stands_on,
    touched,
    upright,
)
from hugwbc.tasks.record import TaskRecord
from hugwbc.tasks.task import Shapes, Task, scene_of
from hugwbc.tasks.verdict import Milestone, within

GOAL = (-0.1, 0.0)  # [m], where to set it down, in the axes of the other table from its middle
NEAR = 0.10  # [m]
ON_THE_FLOOR = 0.3  # [m], height of the centre of a box that has been dropped
_CARRIED = 0.5  # [m] from the goal


def goal_of(record: TaskRecord) -> np.ndarray:
    """Return where the box should stand, x and y in the world [m]."""
    turn = rotations.rotation_z(record.yaw("bench")[0])
    return record.poses["bench"][0, :2] + turn[:2, :2] @ np.array(GOAL)


MILESTONES = (
    touched("box", "no hand touched the box"),
    lifted("box", "the box was not lifted"),
    happened(lambda record: record.poses["box"][:, 2].min() > ON_THE_FLOOR, "the box was dropped"),
    Milestone(
        "the box was not carried to the other table",
        lambda record: within(apart(record, "box", goal_of(record)), _CARRIED),
    ),
    happened(lambda record: stands_on(record, "box", "bench"), "the box does not stand on the other table"),
    upright("box", "the box is not upright"),
    Milestone(
        "the box stands more than 10 cm off its place",
        lambda record: within(apart(record, "box", goal_of(record)), NEAR),
    ),
    hands_off("a hand still touched something at the end"),
    at_rest("box", "the box still moved at the end"),
)


_BACK = 0.35  # [m], step back with the box before the turn
_CLEAR = 0.05  # [m], of the box over both tables


@step
def fetch_box(view: View, shapes: Shapes, *, timeout: Seconds = 100.0) -> Course:
    """Grasp the box, step back, turn, walk to the other table, and put the box down."""
    return (yield from bring(view, shapes, lambda now: doing("carry the box", to_the_table(now, speed=0.35))))


def bring(view: View, shapes: Shapes, way: Behaviour) -> Course:
    """Grasp the box, step back, go a way that ends before the other table, put the box down there, and let go."""
    _, width, height = shapes["box"]["size"]
    top, box = shapes["bench"]["height"], BoxGrip(width)
    highest = max(float(seen(view, "box").position[2]), top + height / 2)
    view = yield from box.take(view, "box", goal=carried_at(highest + box.at[1] + _CLEAR))
    yaw = view.state.yaw
    back = view.position - _BACK * rotations.rotation_z(yaw)[:, 0]
    step_back = walk_to(view, (float(back[0]), float(back[1])), yaw, speed=0.25, tolerance=0.1)
    view = yield from doing("carry the box", step_back)
    view = yield from way(view)
    bench = seen(view, "bench")
    goal = bench.position + rotations.rotation_z(bench.yaw) @ np.array([*GOAL, 0.0])
    goal[2] = top + height / 2
    view = yield from doing("put the box down", box.put(view, "box", goal, bench.yaw))
    return (yield from doing("let go", box.let_go(view)))


def to_the_table(view: View, speed: float) -> Course:
    """Walk with the box to where it can be put on the other table, at a speed [m/s]."""
    return walk_to(view, before="bench", distance=DISTANCE - GOAL[0], speed=speed)


TASK = Task(
    name="fetch_box",
    about="Take a box of 0.5 to 3 kg from a table between both hands, turn, walk 2 m, and set it on another table.",
    scene=scene_of("fetch_box"),
    behaviour=fetch_box,
    limit=110.0,
    milestones=MILESTONES,
)

"""Lift a box from a low stool with both hands and the whole body, and hold it at the chest for 5 s."""

import numpy as np

from hugwbc.behaviours import BoxGrip, Course, View, doing, step, wait
from hugwbc.behaviours.course import Seconds
from hugwbc.commands import Command
from hugwbc.tasks.judges import happened, lifted
from hugwbc.tasks.record import HANDS, TaskRecord
from hugwbc.tasks.task import Shapes, Task, scene_of
from hugwbc.tasks.verdict import Milestone, longest

HELD = 5.0  # [s]
CHEST = (0.05, 0.60)  # [m], heights of the box's centre above the pelvis
CLOSE = 0.55  # [m], horizontal distance from the pelvis
SLOW = 0.15  # [m/s]


def held_at_chest(record: TaskRecord) -> np.ndarray:
    """Return whether the box is at the chest and hardly moves, shape (T,), bool."""
    away = record.poses["box"][:, :3] - record.pelvis[:, :3]
    height, distance = away[:, 2], np.linalg.norm(away[:, :2], axis=1)
    return (height > CHEST[0]) & (height < CHEST[1]) & (distance < CLOSE) & (record.speed("box") < SLOW)


MILESTONES = (
    happened(lambda record: all(record.touches((hand,), "box") for hand in HANDS), "a hand did not touch the box"),
    lifted("box", "the box was not lifted"),
    happened(lambda record: record.poses["box"][:, 2].min() > 0.3, "the box was dropped"),
    Milestone("the box was not brought to the chest", lambda record: 1.0 if held_at_chest(record).any() else 0.0),
    Milestone(
        "the box was not held at the chest for 5 s", lambda record: longest(held_at_chest(record)) / (HELD - 1e-9)
    ),
)


_DISTANCE = 0.50  # [m], from the pelvis to the middle of the box
_LOW = Command(h=-0.3, p=0.4)
_LIFT, _SPEED = 0.06, 0.05  # [m], [m/s], up from the stool


@step
def lift_from_stool(view: View, shapes: Shapes, *, timeout: Seconds = 60.0) -> Course:
    """Crouch as low as the robot can, grasp the upper half of the box, and stand up with it."""
    box = BoxGrip(shapes["box"]["size"][1], at=(0.0, 0.08))
    view = yield from box.take(view, "box", distance=_DISTANCE, posture=_LOW, height=_LIFT, speed=_SPEED)
    return (yield from doing("hold the box", wait(view, HELD + 2.0)))


TASK = Task(
    name="lift_from_stool",
    about="Lift a box of 0.5 to 2 kg from a stool of 0.4 m with the whole body, and hold it at the chest for 5 s.",
    scene=scene_of("lift_from_stool"),
    behaviour=lift_from_stool,
    limit=70.0,
    milestones=MILESTONES,
)

"""Take a box from a shelf, push a door open with it, walk through, and set it down upright on a table."""

import numpy as np

from hugwbc import rotations
from hugwbc.behaviours import Course, View, doing, seen, step, walk_to
from hugwbc.behaviours.course import Seconds
from hugwbc.tasks import fetch_box, open_door
from hugwbc.tasks.judges import happened, trunk_clear
from hugwbc.tasks.task import Shapes, Task, scene_of

MILESTONES = (
    *fetch_box.MILESTONES[:3],
    happened(lambda record: record.travel["door"].max() > open_door.OPEN, "the door was not pushed open"),
    happened(lambda record: open_door.passed(record)[-1] > open_door.THROUGH, "the robot did not get through the door"),
    *fetch_box.MILESTONES[3:],
    trunk_clear("door/frame", "the trunk touched the frame"),
)

_BEFORE, _BEHIND = 0.9, 1.0  # [m], of the pelvis from the doorway
_ASIDE = -0.1  # [m], away from the hinge: the leaf comes to rest on the robot's left


@step
def deliver_box(view: View, shapes: Shapes, *, timeout: Seconds = 115.0) -> Course:
    """Grasp the box, turn to the door, push the leaf with the box, walk through, and put the box down."""
    return (yield from fetch_box.bring(view, shapes, _through_the_door))


def _through_the_door(view: View) -> Course:
    walk = walk_to(view, before="door/frame", distance=_BEFORE, aside=_ASIDE, speed=0.35, tolerance=0.08)
    view = yield from doing("carry the box to the door", walk)
    frame = seen(view, "door/frame")
    goal = frame.position + rotations.rotation_z(frame.yaw) @ np.array([_BEHIND, _ASIDE, 0.0])
    walk = walk_to(view, (float(goal[0]), float(goal[1])), frame.yaw, speed=0.25, stand=False, tolerance=0.2)
    view = yield from doing("push the door and walk through", walk)
    return (yield from doing("carry the box to the table", fetch_box.to_the_table(view, speed=0.3)))


TASK = Task(
    name="deliver_box",
    about="Take a box of 0.5 to 2 kg from a shelf, push a door open on the way, and set it on a table behind the door.",
    scene=scene_of("deliver_box"),
    behaviour=deliver_box,
    limit=120.0,
    milestones=MILESTONES,
)

"""Push a door with a closer open and walk through, without touching its frame with the trunk."""

import numpy as np

from hugwbc import rotations
from hugwbc.behaviours import Course, View, doing, glide, seen, step, walk_to
from hugwbc.behaviours.course import Seconds
from hugwbc.sim.scenes.varied import settled
from hugwbc.tasks.judges import in_axes_of, touched, trunk_clear
from hugwbc.tasks.record import TaskRecord
from hugwbc.tasks.task import Shapes, Task, scene_of
from hugwbc.tasks.verdict import Milestone

THROUGH = 0.6  # [m], of the pelvis behind the doorway
OPEN = 0.5  # [rad]


def passed(record: TaskRecord) -> np.ndarray:
    """Return how far the pelvis is behind the doorway [m], shape (T,); negative before it.

    A pelvis that got behind it outside the doorway, round the frame, is at 0.
    """
    ahead, left, _ = in_axes_of(record, "door/frame", record.pelvis[:, :3]).T
    behind, half = ahead >= 0.0, settled(record.thing("door").size[1]) / 2  # type: ignore[attr-defined]
    came = np.maximum.accumulate(np.where(np.diff(behind, prepend=False) & behind, np.arange(len(ahead)), 0))
    return np.where(behind & (np.abs(left[came]) > half), 0.0, ahead)


MILESTONES = (
    touched("door", "no hand touched the door"),
    Milestone("the door was not pushed open", lambda record: record.travel["door"].max() / OPEN),
    Milestone(
        "the robot did not get through the door",
        lambda record: (passed(record).max() - passed(record)[0]) / (THROUGH - passed(record)[0]),
    ),
    trunk_clear("door/frame", "the trunk touched the frame"),
)


_BEFORE, _BEHIND = 0.65, 1.2  # [m], of the pelvis from the doorway
_ASIDE = -0.08  # [m], away from the hinge: the leaf comes to rest on the robot's left


@step
def open_door(view: View, shapes: Shapes, *, timeout: Seconds = 45.0) -> Course:
    """Hold both forearms ahead and walk through: the hands push the leaf, and the left arm keeps it away."""
    walk = walk_to(view, before="door/frame", distance=_BEFORE, aside=_ASIDE)
    view = yield from doing("walk to the door", walk)
    ahead, points = np.array([1.0, 0.0, 0.0]), np.array([[0.40, 0.17, 0.14], [0.40, -0.14, 0.14]])
    view = yield from doing("raise the hands", glide(view, points, directions=(ahead, ahead)))
    frame = seen(view, "door/frame")
    goal = frame.position + rotations.rotation_z(frame.yaw) @ np.array([_BEHIND, _ASIDE, 0.0])
    place = (float(goal[0]), float(goal[1]))
    walk = walk_to(view, place, frame.yaw, speed=0.3, tolerance=0.15, timeout=25.0)
    return (yield from doing("push the door and walk through", walk))


TASK = Task(
    name="open_door",
    about="Push a door with a closer of 5 to 15 N m open, and walk through without touching the frame with the trunk.",
    scene=scene_of("open_door"),
    behaviour=open_door,
    limit=60.0,
    milestones=MILESTONES,
)

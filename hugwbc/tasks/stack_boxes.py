"""Put one box on another, upright, and let go."""

import numpy as np

from hugwbc.scripts.behaviours import Course, View, seen
from hugwbc.scripts.behaviours.walk_steps import WalkTo
from hugwbc.sim.scenes.varied import settled
from hugwbc.tasks.boxes import DISTANCE, BoxMoves
from hugwbc.tasks.judges import apart, at_rest, hands_off, happened, lifted, stands_on, touched, upright
from hugwbc.tasks.moves import ARRIVED, up
from hugwbc.tasks.task import Shapes, Task, scene_of

NEAR = 0.08  # [m], of the centres

MILESTONES = (
    touched("upper", "no hand touched the box"),
    lifted("upper", "the box was not lifted"),
    happened(
        lambda record: min(record.poses[name][:, 2].min() for name in ("upper", "lower")) > 0.4, "a box fell down"
    ),
    happened(lambda record: stands_on(record, "upper", "lower"), "the box does not stand on the other one"),
    happened(lambda record: apart(record, "upper", record.poses["lower"][-1, :2]) <= NEAR, "the boxes are not in line"),
    upright("upper", "the upper box is not upright"),
    upright("lower", "the lower box is not upright"),
    hands_off("a hand still held the box at the end"),
    at_rest("upper", "the box still moved at the end"),
)


_UP = 0.06  # [m], off the table by the arms
# Where the box is carried [m], in the heading frame: over the lower box, and hardly higher before the robot than it was
# taken. Forearms that rise turn up, and a light box turns with them.
_CHEST = np.array([0.36, 0.0, 0.17])


class StackBoxes(BoxMoves):
    """Grasp one box, stand up with it, step sideways, and put it on the other one."""

    timeout = 80.0

    def __init__(self, shapes: Shapes) -> None:
        """Take the sizes of the boxes."""
        upper, lower = (shapes[name]["size"] for name in ("upper", "lower"))
        super().__init__(width=settled(upper[1]), at=(-0.025, 0.045))  # type: ignore[index]
        self._apart = (settled(upper[2]) + settled(lower[2])) / 2  # type: ignore[index]

    def course(self, view: View) -> Course:  # noqa: D102
        view = yield from self.take(view, "upper", height=_UP, goal=_CHEST)
        self.doing = "carry the box to the other one"
        view = yield from self.walk(view, WalkTo(before="lower", distance=DISTANCE, speed=0.25, tolerance=ARRIVED))
        lower = seen(view, "lower")
        view = yield from self.put(view, "upper", lower.position + up(self._apart), lower.yaw)
        return (yield from self.let_go(view))


TASK = Task(
    name="stack_boxes",
    about="Put one of two boxes of 0.5 kg on the other one, upright, and let go.",
    scene=scene_of("stack_boxes"),
    behaviour=StackBoxes,
    limit=90.0,
    milestones=MILESTONES,
)

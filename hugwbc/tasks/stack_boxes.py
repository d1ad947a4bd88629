"""Put one box on another, upright, and let go."""

from hugwbc.commands import Command
from hugwbc.robot import SIDES
from hugwbc.scripts.behaviours import Course, Grip, View, seen
from hugwbc.scripts.behaviours.walk_steps import WalkTo
from hugwbc.sim.scenes.varied import settled
from hugwbc.tasks.boxes import DISTANCE, BoxMoves
from hugwbc.tasks.judges import apart, at_rest, hands_off, happened, lifted, stands_on, touched, upright
from hugwbc.tasks.moves import up
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


# [m], between a hand and the box that hangs from it: a hand that touches the box would press against its own hook.
_GAP = 0.015
_HOOK = 0.05  # [m], of the hooks above the middle of the box, which hangs from both like a pendulum


class StackBoxes(BoxMoves):
    """Hook one box with both hands, stand up with it, step sideways, and put it on the other one.

    A box of half a kilogram between forearms that only press on it turns with them, and slips.
    """

    timeout = 80.0

    def __init__(self, shapes: Shapes) -> None:
        """Take the sizes of the boxes."""
        upper, lower = (shapes[name]["size"] for name in ("upper", "lower"))
        super().__init__(width=settled(upper[1]), at=(0.0, _HOOK), squeeze=0.0, gap=_GAP)  # type: ignore[index]
        self._apart = (settled(upper[2]) + settled(lower[2])) / 2  # type: ignore[index]

    def grasp(self, view: View, name: str, posture: Command | None = None) -> Course:  # noqa: D102
        view = yield from super().grasp(view, name, posture)
        return (yield from self.grip(view, *(Grip(side, name, hook=True) for side in SIDES)))

    def let_go(self, view: View) -> Course:  # noqa: D102
        view = yield from self.grip(view, *(Grip(side, None) for side in SIDES))
        return (yield from super().let_go(view))

    def course(self, view: View) -> Course:  # noqa: D102
        view = yield from self.take(view, "upper")
        self.doing = "carry the box to the other one"
        view = yield from self.walk(view, WalkTo(before="lower", distance=DISTANCE, speed=0.25))
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
    idealised=("attach",),
)

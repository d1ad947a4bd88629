"""Put one box on another, upright, and let go."""

from hugwbc.behaviours import BoxGrip, Course, View, doing, seen, step, walk_to
from hugwbc.behaviours.boxes import DISTANCE, up
from hugwbc.behaviours.course import Seconds
from hugwbc.tasks.judges import apart, at_rest, hands_off, happened, lifted, stands_on, touched, upright
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
    hands_off("a hand still touched something at the end"),
    at_rest("upper", "the box still moved at the end"),
)


_HOOK = 0.05  # [m], of the hooks above the middle of the box, which hangs from both like a pendulum


@step
def stack_boxes(view: View, shapes: Shapes, *, timeout: Seconds = 80.0) -> Course:
    """Take one box with both hands hooked, stand up with it, step sideways, and put it on the other one.

    A box of half a kilogram between forearms that only press on it turns with them, and slips.
    """
    upper, lower = (shapes[name]["size"] for name in ("upper", "lower"))
    box = BoxGrip.hung(upper[1], at=(0.0, _HOOK))
    view = yield from box.take(view, "upper")
    walk = walk_to(view, before="lower", distance=DISTANCE, speed=0.25)
    view = yield from doing("carry the box to the other one", walk)
    below, apart = seen(view, "lower"), (upper[2] + lower[2]) / 2
    put = box.put(view, "upper", below.position + up(apart), below.yaw)
    view = yield from doing("put the box on the other one", put)
    return (yield from doing("let go", box.let_go(view)))


TASK = Task(
    name="stack_boxes",
    about="Put one of two boxes of 0.5 kg on the other one, upright, and let go.",
    scene=scene_of("stack_boxes"),
    behaviour=stack_boxes,
    limit=90.0,
    milestones=MILESTONES,
    idealised=("attach",),
)

"""Walk to a panel, press a spring button with a hand all the way, and let it come back."""

from hugwbc.behaviours import Course, View, doing, press, step, walk_to
from hugwbc.behaviours.course import Seconds
from hugwbc.tasks.judges import at_end, happened, touched, trunk_clear
from hugwbc.tasks.record import TaskRecord
from hugwbc.tasks.task import Shapes, Task, scene_of
from hugwbc.tasks.verdict import Milestone

PRESSED, RELEASED = 0.9, 0.15  # shares of the button's travel


def travel_of(record: TaskRecord) -> float:
    """Return how far the button can be pressed [m]."""
    return float(record.thing("button").travel)  # type: ignore[attr-defined]


MILESTONES = (
    touched("button", "no hand touched the button"),
    Milestone(
        "the button was not pressed all the way",
        lambda record: record.travel["button"].max() / (PRESSED * travel_of(record)),
    ),
    happened(
        lambda record: at_end(record.travel["button"]) <= RELEASED * travel_of(record), "the button was not released"
    ),
    trunk_clear("button/panel", "the trunk ran into the panel"),
)


_DISTANCE, _ASIDE = 0.47, 0.2  # [m], of the pelvis from the button; it is in front of the right shoulder
_SEEN_IN = 0.85  # share of the travel that is seen


@step
def press_button(view: View, shapes: Shapes, *, timeout: Seconds = 57.0) -> Course:
    """Walk to the button, press it with the right hand until it is seen to be in, and draw the hand back."""
    walk = walk_to(view, before="button", distance=_DISTANCE, aside=_ASIDE)
    view = yield from doing("walk to the button", walk)
    travel = shapes["button"]["travel"]
    front = (-(travel / 2 + 0.01), 0.0, 0.0)  # the middle of it
    return (yield from press(view, "button", at=front, travel=_SEEN_IN * travel))


TASK = Task(
    name="press_button",
    about="Walk 1.5 m to a panel, press a spring button of 15 N by its 2 cm, and let it come back.",
    scene=scene_of("press_button"),
    behaviour=press_button,
    limit=60.0,
    milestones=MILESTONES,
)

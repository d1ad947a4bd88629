"""Walk to a panel, press a spring button with a hand all the way, and let it come back."""

import numpy as np

from hugwbc.commands import Command
from hugwbc.scripts.behaviours import Action, Course, Failure, View, seen, standing
from hugwbc.scripts.behaviours.hand_motion import TIP
from hugwbc.scripts.behaviours.walk_steps import WalkTo
from hugwbc.tasks.judges import at_end, happened, touched, trunk_clear
from hugwbc.tasks.moves import NO_HAND, Moves, crouch, targets
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
_BEFORE = 0.08  # [m], between tip and button before it is pressed
SEEN_IN, _HELD_IN = 0.85, 0.2  # share of the travel that is seen, for a time [s]
_SPEED, _DEEPEST = 0.06, 0.10  # [m/s] of a pressing hand, [m] of its target behind the front of the button


class PressButton(Moves):
    """Walk to the button, press it with the right hand until it is seen to be in, and draw the hand back."""

    timeout = 45.0

    def __init__(self, shapes: Shapes) -> None:
        """Take the travel of the button."""
        self._travel = float(shapes["button"]["travel"])  # type: ignore[arg-type]

    def course(self, view: View) -> Course:  # noqa: D102
        self.doing = "walk to the button"
        view = yield from self.walk(view, WalkTo(before="button", distance=_DISTANCE, aside=_ASIDE))
        self.doing = "reach for the button"
        button = seen(view, "button")
        ahead = button.direction(np.array([1.0, 0.0, 0.0]))
        front = button.position - (self._travel / 2 + 0.01) * ahead  # the middle of its front
        way = (None, ahead)
        posture = crouch(float(front[2]) + 0.05)
        for gap in (_BEFORE + 0.08, _BEFORE):
            points = np.stack([NO_HAND, front - (TIP + gap) * ahead])
            view = yield from self.glide(view, points, frame="world", directions=way, posture=posture, settle=0.4)
        self.doing = "press the button"
        view = yield from self._press(view, front, ahead)
        self.doing = "draw the hand back"
        points = np.stack([NO_HAND, front - (TIP + _BEFORE + 0.06) * ahead])
        view = yield from self.glide(view, points, frame="world", directions=way, speed=0.15)
        return (yield from self.glide(view, points, frame="world", directions=way, posture=Command()))

    def _press(self, view: View, front: np.ndarray, ahead: np.ndarray) -> Course:
        begin, start, held = view.time, seen(view, "button").position, 0.0
        last = begin
        while held < _HELD_IN:
            depth = (view.time - begin) * _SPEED - _BEFORE
            moved = float((seen(view, "button").position - start) @ ahead)
            held = held + view.time - last if moved > SEEN_IN * self._travel else 0.0
            last = view.time
            if depth > _DEEPEST + 0.5 * _SPEED:
                raise Failure(f"press: the button moved by {1e3 * moved:.0f} of {1e3 * self._travel:.0f} mm")
            point = front + (min(depth, _DEEPEST) - TIP) * ahead
            view = yield Action(standing(view), targets(np.stack([NO_HAND, point]), "world", directions=(None, ahead)))
        return view


TASK = Task(
    name="press_button",
    about="Walk 1.5 m to a panel, press a spring button of 15 N by its 2 cm, and let it come back.",
    scene=scene_of("press_button"),
    behaviour=PressButton,
    limit=60.0,
    milestones=MILESTONES,
)

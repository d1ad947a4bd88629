"""Hook the handle of a drawer with a hand, and pull the drawer open by 25 cm."""

import numpy as np

from hugwbc.behaviours import Course, Grip, View, doing, glide, grip, pull, seen, step, wait, walk_to
from hugwbc.behaviours.course import Seconds
from hugwbc.behaviours.hands import crouch, hands_in, one_hand
from hugwbc.tasks.judges import at_end, happened
from hugwbc.tasks.task import Shapes, Task, scene_of
from hugwbc.tasks.verdict import Milestone

OPENED = 0.25  # [m]

MILESTONES = (
    happened(lambda record: "drawer" in record.gripped, "no hand got hold of the handle"),
    Milestone("the drawer was not pulled open by 25 cm", lambda record: record.travel["drawer"].max() / OPENED),
    Milestone("the drawer did not stay open", lambda record: at_end(record.travel["drawer"]) / (OPENED - 0.005)),
)


_REACH, _ASIDE = 0.38, 0.18  # [m], of the pelvis from the handle, which is in front of the right shoulder
_APART = 0.028  # [m], of hand and handle when it is hooked: a hand that touches it would press against its own hook
_FARTHER = 0.02  # [m], than the drawer has to open
_SPEED = 0.2  # [m/s]
# [N]; a policy that starts to walk out of a crouch drops for a moment, and hangs on the hook with 150 N.
_STRONG = 300.0
_YIELDING = 400.0  # [N/m], of a hand that pulls: the hook must not break by the sway of a step


@step
def open_drawer(view: View, shapes: Shapes, *, timeout: Seconds = 60.0) -> Course:
    """Walk to the drawer, hook the handle with the right hand, and walk back until it is seen to be open."""
    handle = shapes["drawer"]["size"][0] / 2 + shapes["drawer"]["handle"]
    walk = walk_to(view, before="drawer", distance=handle + _REACH, aside=_ASIDE)
    view = yield from doing("walk to the drawer", walk)
    view = yield from doing("reach for the handle", _reach(view, handle))
    hook = grip(view, Grip("right", "drawer", hook=True, breaking_force=_STRONG))
    view = yield from doing("hook the handle", hook)
    view = yield from doing("pull the drawer", _pull(view))
    view = yield from doing("let go of the handle", grip(view, Grip("right", None)))
    return (yield from doing("let go of the handle", wait(view, 0.5)))


def _reach(view: View, handle: float) -> Course:
    closed = seen(view, "drawer")
    ahead = closed.direction(np.array([1.0, 0.0, 0.0]))
    bar = closed.position - handle * ahead
    posture, way = crouch(float(bar[2]) + 0.1), (None, ahead)
    for gap in (0.10, 0.0):
        points = one_hand(1, bar - (view.hand_tip + _APART + gap) * ahead)
        view = yield from glide(view, points, frame="world", directions=way, posture=posture, speed=0.15, settle=0.5)
    return view


def _pull(view: View) -> Course:
    hands = one_hand(1, hands_in(view, "heading")[1])
    view = yield from glide(view, hands, stiffness=_YIELDING)
    return (yield from pull(view, "drawer", OPENED + _FARTHER, speed=_SPEED))


TASK = Task(
    name="open_drawer",
    about="Hook the handle of a drawer, and pull it open by 25 cm against 10 to 20 N.",
    scene=scene_of("open_drawer"),
    behaviour=open_drawer,
    limit=70.0,
    milestones=MILESTONES,
    idealised=("attach",),
)

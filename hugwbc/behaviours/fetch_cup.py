"""Take a cup from a shelf, walk 2 m, turn, set it on a table, squat and wave (--scene cupboard)."""

from hugwbc.behaviours.course import Course, parallel
from hugwbc.behaviours.hold import carry, lift, place
from hugwbc.behaviours.reach import grip, reach
from hugwbc.behaviours.walk import stand, walk_to
from hugwbc.scripts.view import Grip, View

HOME, LEFT = (0.2, 2.0), 1.5708  # [m], [rad]


def fetch_cup(view: View) -> Course:
    """Fetch the cup."""
    view = yield from walk_to(view, before="cupboard", distance=0.55)
    view = yield from reach(view, right=(-0.05, 0.0, 0.2), frame="cup")
    view = yield from reach(view, right=(-0.02, 0.0, 0.08), frame="cup", speed=0.1)
    view = yield from grip(view, Grip("right", "cup", hook=True), timeout=2.0)  # it hangs as by its handle
    view = yield from lift(view, "cup", 0.05)
    view = yield from carry(view, "cup", walk_to(view, before="desk", distance=0.55, speed=0.3))
    view = yield from place(view, "cup", on="desk", at=(-0.1, -0.2), lower=0.6)
    view = yield from walk_to(view, HOME, LEFT)
    view = yield from stand(view, 2.0, h=-0.2)
    return (yield from parallel(view, legs=_rise(view), hands=_wave(view)))


def _rise(view: View) -> Course:
    view = yield from stand(view, 2.0)
    return (yield from walk_to(view, HOME, LEFT))


def _wave(view: View) -> Course:
    view = yield from reach(view, right=(0.25, -0.3, 0.45))
    return (yield from reach(view, right=(0.25, -0.45, 0.4)))

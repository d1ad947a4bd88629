"""Push a loaded cart by its handle over 2 m, and stop."""

import math

import numpy as np

from hugwbc import rotations
from hugwbc.behaviours import Course, Failure, Grip, View, doing, glide, grip, seen, step, walk_to
from hugwbc.behaviours.course import Seconds
from hugwbc.robot import SIDES
from hugwbc.tasks.judges import at_rest, in_axes_of, touched
from hugwbc.tasks.record import TaskRecord
from hugwbc.tasks.task import Shapes, Task, scene_of
from hugwbc.tasks.verdict import Milestone, at_end, within

WAY = 2.0  # [m]
NEAR = 0.20  # [m]
STRAIGHT = math.radians(10.0)


def way(record: TaskRecord) -> np.ndarray:
    """Return how far the cart has come along its first heading, and to its left [m], shape (T, 2)."""
    return in_axes_of(record, "cart", record.poses["cart"][:, :3])[:, :2]


def off_goal(record: TaskRecord) -> float:
    """Return how far the cart is from 2 m ahead of where it stood, at the end [m]."""
    ahead, left = way(record).T
    return math.hypot(at_end(ahead) - WAY, at_end(left))


def turned(record: TaskRecord) -> float:
    """Return by how much the cart has turned at the end [rad]."""
    yaw = record.yaw("cart")
    return abs(float(rotations.wrap_angle(yaw[-1] - yaw[0])))


MILESTONES = (
    touched("cart", "no hand touched the cart"),
    Milestone("the cart was not pushed 2 m", lambda record: way(record)[:, 0].max() / (WAY - NEAR)),
    Milestone("the cart stands more than 20 cm off its goal", lambda record: within(off_goal(record), NEAR)),
    Milestone("the cart has turned by more than 10 degrees", lambda record: within(turned(record), STRAIGHT)),
    at_rest("cart", "the cart still rolled at the end"),
)


_REACH = 0.36  # [m], from the pelvis to the handle
_GAP = 0.03  # [m], from a hand to the handle's middle when it is hooked: a hand that touched it would press on its hook
_APART = 0.20  # [m], of each hand from the middle
_YIELDING = 400.0  # [N/m], of the hands, so that the cart does not follow the sway of the steps
_SPEED = 0.3  # [m/s]
_THERE = 0.06  # [m]
_MOST_STEPS = 3


@step
def push_cart(view: View, shapes: Shapes, *, timeout: Seconds = 55.0) -> Course:
    """Push the cart by its handle with both hands hooked, and stop where the cart is seen at its goal."""
    length, handle = shapes["cart"]["size"][0], shapes["cart"]["handle"]
    start = seen(view, "cart")
    goal = start.position + WAY * rotations.rotation_z(start.yaw)[:, 0]
    ready = _hands(view, handle - 0.98, gap=0.08)
    view = yield from doing("walk to the cart", glide(view, ready))
    view = yield from doing("walk to the cart", walk_to(view, before="cart", distance=length / 2 + _REACH))
    cart = seen(view, "cart")
    turn = rotations.rotation_z(cart.yaw)
    bar = cart.position + turn @ np.array([-length / 2 - view.hand_tip - _GAP, 0.0, 0.0])
    points = bar + np.array([[0.0, _APART, 0.0], [0.0, -_APART, 0.0]]) @ turn.T
    points[:, 2] = handle
    way = (turn[:, 0], turn[:, 0])
    reach = glide(view, points, frame="world", directions=way, speed=0.1, settle=0.6)
    view = yield from doing("reach for the handle", reach)
    hook = grip(view, *(Grip(side, "cart", hook=True) for side in SIDES))
    view = yield from doing("hook the handle", hook)
    soften = glide(view, _hands(view, float(points[0, 2] - view.position[2])), stiffness=_YIELDING)
    view = yield from doing("push the cart", soften)
    view = yield from doing("push the cart", _push(view, goal, start.yaw))
    view = yield from doing("let go of the cart", grip(view, *(Grip(side, None) for side in SIDES)))
    return (yield from doing("let go of the cart", glide(view, ready, speed=0.1)))


def _push(view: View, goal: np.ndarray, yaw: float) -> Course:
    """Walk until the cart is seen near a point of the world [m]."""
    for _ in range(_MOST_STEPS):
        left = goal - seen(view, "cart").position
        if np.hypot(*left[:2]) < 1.5 * _THERE:
            break
        x, y = (view.position + left)[:2].tolist()
        view = yield from walk_to(view, (x, y), yaw, speed=_SPEED, tolerance=_THERE)
        if None in view.held:
            raise Failure("push: a hook broke")
    off = float(np.hypot(*(goal - seen(view, "cart").position)[:2]))
    if off > NEAR:
        raise Failure(f"push: the cart stands {100 * off:.0f} cm off its goal")
    return view


def _hands(view: View, height: float, gap: float = 0.0) -> np.ndarray:
    """Return the hands before the handle, at a height over the pelvis [m], in the heading frame, shape (2, 3)."""
    x = _REACH - view.hand_tip - _GAP - gap
    return np.array([[x, _APART, height], [x, -_APART, height]])


TASK = Task(
    name="push_cart",
    about="Push a cart of 20 to 40 kg over 2 m, to within 20 cm and 10 degrees.",
    scene=scene_of("push_cart"),
    behaviour=push_cart,
    limit=60.0,
    milestones=MILESTONES,
    idealised=("attach",),
)

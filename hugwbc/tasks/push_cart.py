"""Push a loaded cart by its handle over 2 m, and stop."""

import math

import numpy as np

from hugwbc import rotations
from hugwbc.robot import SIDES
from hugwbc.scripts.behaviours import Course, Failure, Grip, View, seen
from hugwbc.scripts.behaviours.walk_steps import WalkTo
from hugwbc.sim.scenes.varied import settled
from hugwbc.tasks.judges import at_rest, in_axes_of, touched
from hugwbc.tasks.moves import Moves
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
# [m], from the hand frame to the handle's middle when it is hooked: a hand that touched it would press on its hook.
_TIP = 0.07
_APART = 0.20  # [m], of each hand from the middle
_YIELDING = 400.0  # [N/m], of the hands, so that the cart does not follow the sway of the steps
_SPEED = 0.3  # [m/s]
_THERE = 0.06  # [m]
_MOST_STEPS = 3


class PushCart(Moves):
    """Hook the handle with both hands, walk ahead, and stop where the cart is seen at its goal."""

    timeout = 55.0

    def __init__(self, shapes: Shapes) -> None:
        """Take length and handle height of the cart."""
        cart = shapes["cart"]
        self._length = settled(cart["size"][0])  # type: ignore[index]
        self._handle = settled(cart["handle"])  # type: ignore[arg-type]

    def course(self, view: View) -> Course:  # noqa: D102
        start = seen(view, "cart")
        ahead = rotations.rotation_z(start.yaw)[:, 0]
        goal = start.position + WAY * ahead
        self.doing = "walk to the cart"
        distance = self._length / 2 + _REACH
        ready = self._hands(self._handle - 0.98, gap=0.08)
        view = yield from self.glide(view, ready)
        view = yield from self.walk(view, WalkTo(before="cart", distance=distance))
        self.doing = "reach for the handle"
        cart = seen(view, "cart")
        turn = rotations.rotation_z(cart.yaw)
        bar = cart.position + turn @ np.array([-self._length / 2 - _TIP, 0.0, 0.0])
        points = bar + np.array([[0.0, _APART, 0.0], [0.0, -_APART, 0.0]]) @ turn.T
        points[:, 2] = self._handle
        way = (turn[:, 0], turn[:, 0])
        view = yield from self.glide(view, points, frame="world", directions=way, speed=0.1, settle=0.6)
        self.doing = "hook the handle"
        view = yield from self.grip(view, *(Grip(side, "cart", hook=True) for side in SIDES))
        self.doing = "push the cart"
        view = yield from self.glide(view, self._hands(float(points[0, 2] - view.position[2])), stiffness=_YIELDING)
        for _ in range(_MOST_STEPS):
            left = goal - seen(view, "cart").position
            if np.hypot(*left[:2]) < 1.5 * _THERE:
                break
            x, y = (view.position + left)[:2].tolist()
            view = yield from self.walk(view, WalkTo((x, y), start.yaw, speed=_SPEED, tolerance=_THERE))
            if None in view.held:
                raise Failure("push: a hook broke")
        off = float(np.hypot(*(goal - seen(view, "cart").position)[:2]))
        if off > NEAR:
            raise Failure(f"push: the cart stands {100 * off:.0f} cm off its goal")
        self.doing = "let go of the cart"
        view = yield from self.grip(view, *(Grip(side, None) for side in SIDES))
        return (yield from self.glide(view, ready, speed=0.1))

    def _hands(self, height: float, gap: float = 0.0) -> np.ndarray:
        """Return the hands before the handle, at a height over the pelvis [m], in the heading frame, shape (2, 3)."""
        x = _REACH - _TIP - gap
        return np.array([[x, _APART, height], [x, -_APART, height]])


TASK = Task(
    name="push_cart",
    about="Push a cart of 20 to 40 kg over 2 m, to within 20 cm and 10 degrees.",
    scene=scene_of("push_cart"),
    behaviour=PushCart,
    limit=60.0,
    milestones=MILESTONES,
    idealised=("attach",),
)

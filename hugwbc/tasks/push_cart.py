"""Push a loaded cart by its handle over 2 m, and stop."""

import math

import numpy as np

from hugwbc import rotations
from hugwbc.scripts.behaviours import Course, Failure, View, seen
from hugwbc.scripts.behaviours.walk_steps import WalkTo
from hugwbc.sim.scenes.varied import settled
from hugwbc.tasks.judges import at_rest, in_axes_of, touched
from hugwbc.tasks.moves import ARRIVED, Moves
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
_TIP = 0.05  # [m], from the hand frame to the handle's middle when they touch
_APART = 0.18  # [m], of each hand from the middle
_ROLLS_ON = 0.06  # [m], after the robot has begun to slow down
_SPEED = 0.3  # [m/s]
_MOST_STEPS = 3


class PushCart(Moves):
    """Put both hands on the handle, walk ahead, and stop where the cart is seen at its goal."""

    timeout = 55.0

    def __init__(self, shapes: Shapes) -> None:
        """Take length and handle height of the cart."""
        cart = shapes["cart"]
        self._length = settled(cart["size"][0])  # type: ignore[index]
        self._middle = settled(cart["size"][2]) - 0.015  # type: ignore[index]  # height of its origin
        self._handle = settled(cart["handle"])  # type: ignore[arg-type]

    def course(self, view: View) -> Course:  # noqa: D102
        distance = self._length / 2 + _REACH
        start = seen(view, "cart")
        ahead = rotations.rotation_z(start.yaw)[:, 0]
        self.doing = "walk to the cart"
        z = self._handle - 0.98
        ready = np.array([[_REACH - _TIP - 0.08, _APART, z], [_REACH - _TIP - 0.08, -_APART, z]])
        view = yield from self.glide(view, ready)
        view = yield from self.walk(view, WalkTo(before="cart", distance=distance, tolerance=ARRIVED))
        self.doing = "put the hands on the handle"
        z = self._handle - float(view.position[2])
        pushing = np.array([[_REACH - _TIP + 0.02, _APART, z], [_REACH - _TIP + 0.02, -_APART, z]])
        view = yield from self.glide(view, pushing, speed=0.1)
        self.doing = "push the cart"
        for _ in range(_MOST_STEPS):
            left = WAY - float((seen(view, "cart").position - start.position) @ ahead)
            if left < 0.5 * NEAR:
                break
            goal = view.position + (left - _ROLLS_ON + 0.02) * ahead
            walk = WalkTo((float(goal[0]), float(goal[1])), start.yaw, speed=_SPEED, tolerance=0.06)
            view = yield from self.walk(view, walk)
        moved = float((seen(view, "cart").position - start.position) @ ahead)
        if abs(moved - WAY) > NEAR:
            raise Failure(f"push: the cart came {moved:.2f} of {WAY:g} m")
        self.doing = "let go of the cart"
        return (yield from self.glide(view, ready, speed=0.1))


TASK = Task(
    name="push_cart",
    about="Push a cart of 20 to 40 kg over 2 m, to within 20 cm and 10 degrees.",
    scene=scene_of("push_cart"),
    behaviour=PushCart,
    limit=60.0,
    milestones=MILESTONES,
)

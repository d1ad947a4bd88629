"""Push a loaded cart by its handle over 2 m, and stop."""

import math

import numpy as np

from hugwbc import rotations
from hugwbc.scripts.behaviours import Course, Failure, View, seen
from hugwbc.scripts.behaviours.walk_steps import Goal, Walk, WalkTo
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
_ROLLS_ON = 0.14  # [m], after the robot has begun to slow down; creeping on with one hand turns the cart
_SPEED = 0.3  # [m/s]
_MOST_STEPS = 3
_LOOK_AHEAD = 0.55  # [m], of the goal of the walk: a nearer one is walked to without turning
_STEER, _BACK = 1.2, 0.5  # way aside for a cart's way off the line, and for a robot that is not behind its middle
_MOST_ASIDE = 0.2  # [m]


class Line:
    """The line on which the cart shall go, from its first place along its first heading.

    Attributes:
        yaw: direction of the line [rad].
        axes: along it and to its left, as columns, shape (2, 2).
    """

    def __init__(self, start: np.ndarray, yaw: float) -> None:
        """Take the first place [m], shape (3,), and heading [rad]."""
        self.yaw, self.axes, self._start = yaw, rotations.rotation_z(yaw)[:2, :2], start[:2]

    def place(self, position: np.ndarray) -> np.ndarray:
        """Return how far along the line and to its left a position is [m], shape (2,)."""
        return (position[:2] - self._start) @ self.axes


class _Behind(Walk):
    """Walks behind a cart until it is where it should be.

    The castors roll in every direction: the cart goes where it is pushed. So the robot goes aside with its hands on
    the handle, against the cart's way off the line, and back behind its middle.
    """

    def __init__(self, line: Line) -> None:
        """Take the line from where the cart stands to its goal."""
        super().__init__(speed=_SPEED, tolerance=0.1)
        self._line = line

    def goal(self, view: View, begin: View) -> Goal:
        cart, robot = self._line.place(seen(view, "cart").position), self._line.place(view.position)
        ahead = min(WAY - cart[0] - _ROLLS_ON + 0.02, _LOOK_AHEAD)
        aside = float(np.clip(-_STEER * cart[1] - _BACK * (robot[1] - cart[1]), -_MOST_ASIDE, _MOST_ASIDE))
        x, y = view.position[:2] + self._line.axes @ (ahead, aside)
        return Goal(float(x), float(y), self._line.yaw)


class PushCart(Moves):
    """Put both hands on the handle, walk ahead, and stop where the cart is seen at its goal."""

    timeout = 55.0

    def __init__(self, shapes: Shapes) -> None:
        """Take length and handle height of the cart."""
        cart = shapes["cart"]
        self._length = settled(cart["size"][0])  # type: ignore[index]
        self._handle = settled(cart["handle"])  # type: ignore[arg-type]

    def course(self, view: View) -> Course:  # noqa: D102
        distance = self._length / 2 + _REACH
        start = seen(view, "cart")
        line = Line(start.position, start.yaw)
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
            if WAY - line.place(seen(view, "cart").position)[0] < 0.8 * NEAR:
                break
            view = yield from self.walk(view, _Behind(line))
        moved = float(line.place(seen(view, "cart").position)[0])
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

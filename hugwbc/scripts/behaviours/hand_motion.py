"""Motions of the hands that behaviours are made of: from where the hands are to points of a frame or an object."""

import dataclasses
from collections.abc import Callable

import numpy as np

from hugwbc import rotations
from hugwbc.blends import smooth_step
from hugwbc.commands import Command
from hugwbc.errors import ConfigError
from hugwbc.robot import SIDES
from hugwbc.scripts.behaviours.behaviour import Behaviour, Course, Failure, check_within, seen
from hugwbc.scripts.behaviours.view import Action, View, standing
from hugwbc.targets import HAND_FRAMES, HandFrame, HandTargets

HAND_SPEED = 0.3  # [m/s], by default
SLOWEST, FASTEST = 0.001, 1.0  # [m/s], that may be asked for
FINEST = 0.001  # [m], tolerance that may be asked for
SHORTEST = 0.4  # [s], of a motion
ARRIVED = 0.03  # [m]
HALF_WIDTH = 0.03  # [m], of a forearm: from the hand's axis to its surface
TIP = 0.04  # [m], from the hand's origin to the end of the forearm
LEVEL = 1.13  # [m], height of the hands at which the forearms of a robot that stands upright are about level
LOWEST = -0.25  # [m], of the commanded h
_PEAK = 1.875  # highest speed of a minimum-jerk motion, relative to its mean

STIFFNESS = 1000.0  # [N/m], about that of a hand in front of the body
PRESSING_GAIN = 2.0  # [1/s], at which the force of a pressing hand goes to the wanted one
MOST_MORE = 25.0  # [N], that a hand is asked for beyond the wanted force

Point = tuple[float, float, float]
Aim = Callable[[View], HandTargets]


def frame_of(name: str) -> HandFrame:
    """Return the frame in which targets given in `name` are sent: that of an object is the world."""
    return name if name in HAND_FRAMES else "world"  # type: ignore[return-value]


def placed(view: View, frame: str, point: object) -> np.ndarray | None:
    """Return a point of a frame or an object in the frame in which it is sent [m], shape (3,); None for None.

    Raises:
        Failure: if the object is not seen.
    """
    if point is None:
        return None
    vector = np.asarray(point, dtype=float)
    return vector if frame in HAND_FRAMES else seen(view, frame).point(vector)


def turned(view: View, frame: str, vector: object) -> np.ndarray | None:
    """Return a vector of a frame or an object in the axes in which it is sent, shape (3,); None for None."""
    if vector is None:
        return None
    given = np.asarray(vector, dtype=float)
    return given if frame in HAND_FRAMES else seen(view, frame).direction(given)


def axes_of(view: View, frame: str) -> np.ndarray:
    """Return the matrix from a frame of hand targets to the world, shape (3, 3)."""
    if frame == "world":
        return np.eye(3)
    # The steady frame is the heading frame but for the sway of the steps.
    return rotations.to_matrix(view.state.orientation) if frame == "pelvis" else rotations.rotation_z(view.state.yaw)


def points_in(view: View, points: np.ndarray, frame: str) -> np.ndarray:
    """Return points of the world in a frame of hand targets [m], shape (n, 3)."""
    return points if frame == "world" else (points - view.position) @ axes_of(view, frame)


def points_of(view: View, hands: HandTargets) -> np.ndarray:
    """Return hand targets in the world [m], shape (2, 3); NaN for a hand without one."""
    points = hands.array()
    return points if hands.frame == "world" else view.position + points @ axes_of(view, hands.frame).T


def now(view: View) -> np.ndarray:
    """Return where the hands are asked to be in the world, or else where they are [m], shape (2, 3)."""
    if view.last.hands is None:
        return view.hands.copy()
    asked = points_of(view, view.last.hands)
    return np.where(np.isnan(asked), view.hands, asked)


def move(
    behaviour: Behaviour,
    view: View,
    aim: Aim,
    *,
    speed: float = HAND_SPEED,
    tolerance: float = ARRIVED,
    level: bool = False,
) -> Course:
    """Move the hands to targets that may move, on a straight line with a minimum-jerk profile, and wait for them.

    Args:
        behaviour: gets its progress from here.
        view: now.
        aim: returns the targets for a view, in one and the same frame.
        speed: highest speed of a hand [m/s].
        tolerance: distance of a hand from its target at which it has arrived [m]; infinite not to wait.
        level: whether the legs keep the forearms level (`levelled`).
    """
    goal = aim(view)
    start = points_in(view, now(view), goal.frame)
    far = float(np.nanmax(np.linalg.norm(goal.array() - start, axis=1)))
    duration, begin = max(_PEAK * far / speed, SHORTEST), view.time
    while True:
        goal = aim(view)
        share = smooth_step((view.time - begin) / duration)
        points = start + share * (goal.array() - start)
        hands = with_points(goal, points)
        if view.time - begin >= duration:
            gap = np.linalg.norm(view.hands - points_of(view, hands), axis=1)
            gap = np.where(hands.given, gap, 0.0)
            worst = int(np.argmax(gap))
            behaviour.progress = f"the {SIDES[worst]} hand is {100 * gap[worst]:.1f} cm from its target"
            if gap[worst] <= tolerance:
                return view
        else:
            behaviour.progress = "the hands are on their way"
        view = yield Action(levelled(view, hands) if level else standing(view), hands)


def levelled(view: View, hands: HandTargets) -> Command:
    """Return the standing command with which the forearms are level at these targets.

    The legs lift and lower what both hands hold: a forearm that rises turns up, and the object turns with it.
    """
    height = float(np.nanmean(points_of(view, hands)[:, 2]))
    return Command(h=float(np.clip(height - LEVEL, LOWEST, 0.0)))


def with_points(hands: HandTargets, points: np.ndarray) -> HandTargets:
    """Return targets with other positions for the hands that have one; `points` of shape (2, 3)."""
    left, right = (points[row] if given else None for row, given in enumerate(hands.given))
    return dataclasses.replace(hands, left=left, right=right)


def in_frame(view: View, hands: HandTargets, frame: str) -> HandTargets:
    """Return the same targets in another frame; directions and forces turn with it."""
    if hands.frame == frame:
        return hands
    turn = axes_of(view, hands.frame).T @ axes_of(view, frame)
    vectors = {}
    for name in ("left_direction", "right_direction", "left_force", "right_force"):
        vector = getattr(hands, name)
        vectors[name] = None if vector is None else vector @ turn
    moved = with_points(hands, points_in(view, points_of(view, hands), frame))
    return dataclasses.replace(moved, frame=frame, **vectors)


def held_targets(view: View) -> HandTargets:
    """Return the last targets of the hands.

    Raises:
        Failure: if the controller moves the arms.
    """
    hands = view.last.hands
    if hands is None or hands.joints is not None:
        raise Failure("the hands have no targets; reach or squeeze first")
    return hands


def shifted(hands: HandTargets, by: np.ndarray) -> HandTargets:
    """Return targets moved by a vector of their frame [m]."""
    return with_points(hands, hands.array() + by)


def wait(view: View, seconds: float) -> Course:
    """Keep the last targets and the posture for a time [s]."""
    begin = view.time
    while view.time - begin < seconds:
        view = yield Action(standing(view), view.last.hands)
    return view


class Pressing:
    """The force to ask of a hand that it presses with a wanted one.

    A hand gives way along the force that it is asked for, so that its target cannot make up for what friction of the
    drives and errors of the model take from it. Where forces on the hands are known, their error changes what is asked.
    """

    def __init__(self, view: View, row: int, normal: np.ndarray, force: float) -> None:
        """Begin.

        Args:
            view: now.
            row: of the hand, 0 for the left one.
            normal: unit vector away from the surface, in the world, shape (3,).
            force: wanted, against the surface [N].
        """
        self._row, self._normal, self._force = row, normal, force
        self._time, self._more = view.time, 0.0

    def asked(self, view: View) -> float:
        """Return the force to ask for at this tick, against the surface [N]."""
        if view.hand_force is not None:
            missing = self._force - float(view.hand_force[self._row] @ self._normal)
            more = self._more + PRESSING_GAIN * (view.time - self._time) * missing
            self._more = float(np.clip(more, -0.8 * self._force, MOST_MORE))
        self._time = view.time
        return self._force + self._more


def check_above(name: str, value: float, most: float, unit: str = "m") -> None:
    """Refuse a number that is not above 0 and at most `most`."""
    if not 0.0 < value <= most:
        raise ConfigError(f"{name} is {value} {unit}; give a number above 0, up to {most:g} {unit}")


def check_speed(value: float) -> None:
    """Refuse a speed of a hand that is out of range [m/s]."""
    check_within("speed", value, SLOWEST, FASTEST, "m/s")


def check_tolerance(value: float) -> None:
    """Refuse a tolerance of a hand's place that is out of range [m]."""
    check_within("tolerance", value, FINEST, 1.0)

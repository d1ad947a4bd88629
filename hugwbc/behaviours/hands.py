"""Motions of the hands for behaviours: from where the hands are to points of a frame or an object."""

import dataclasses
from collections.abc import Callable

import numpy as np

from hugwbc import rotations
from hugwbc.behaviours.course import Course, Failure, seen, standing
from hugwbc.commands import Command
from hugwbc.gait import Gait
from hugwbc.hand_wrench import FREE, HandWrench
from hugwbc.numeric import smooth_step
from hugwbc.robot import SIDES, Robot, load_robot
from hugwbc.scripts.view import Action, View
from hugwbc.targets import FARTHEST_HAND, HAND_FRAMES, HandFrame, HandTargets, frame_axes

HAND_SPEED = 0.3  # [m/s], highest speed of a hand by default
SHORTEST = 0.4  # [s], of a motion
ARRIVED = 0.03  # [m]
# Of an H1; those of other robots are in proportion (`stature`).
LEVEL = 1.13  # [m], height of the hands at which the forearms of a robot that stands upright are about level
LOWEST = -0.25  # [m], of the commanded h
COMFORTABLE = 1.05  # [m], height at which single hands work while the robot stands upright
NO_FORCE = np.zeros((2, 3))
_PEAK = 1.875  # highest speed of a minimum-jerk motion, relative to its mean
_GLIDE_SPEED, _SHORTEST_GLIDE = 0.25, 0.5  # [m/s] mean speed, [s]
_PRESSING_GAIN = 2.0  # [1/s], at which the force of a pressing hand goes to the wanted one
_MOST_MORE = 25.0  # [N], by which the requested force may exceed the wanted one

Aim = Callable[[View], HandTargets]
Directions = tuple[np.ndarray | None, np.ndarray | None]


def move(view: View, aim: Aim, *, speed: float = HAND_SPEED, tolerance: float = ARRIVED, level: bool = False) -> Course:
    """Move the hands to targets that may move, on straight lines with a minimum-jerk profile, and wait for them.

    Args:
        view: now.
        aim: returns the targets for a view, in one and the same frame.
        speed: highest speed of a hand [m/s].
        tolerance: distance of a hand from its target at which it has arrived [m]; infinite not to wait.
        level: whether the legs keep the forearms level (`levelled`).
    """
    goal = aim(view)
    start = points_in(view, hands_in(view, "world"), goal.frame)
    far = float(np.nanmax(np.linalg.norm(goal.array() - start, axis=1)))
    duration, begin = max(_PEAK * far / speed, SHORTEST), view.time
    progress = "the hands are on their way"
    while True:
        goal = aim(view)
        share = smooth_step((view.time - begin) / duration)
        hands = with_points(goal, start + share * (goal.array() - start))
        if view.time - begin >= duration:
            gap = np.linalg.norm(view.hands - points_of(view, hands), axis=1)
            gap = np.where(hands.given, gap, 0.0)
            worst = int(np.argmax(gap))
            progress = f"the {SIDES[worst]} hand is {_cm(gap[worst])} from its target (tolerance {_cm(tolerance)})"
            if gap[worst] <= tolerance:
                return view
        command = levelled(view, hands) if level else standing(view)
        view = yield Action(command, hands, progress=progress)


def glide(
    view: View,
    points: np.ndarray,
    *,
    frame: HandFrame = "heading",
    speed: float = _GLIDE_SPEED,
    together: bool = False,
    directions: Directions = (None, None),
    forces: np.ndarray = NO_FORCE,
    stiffness: float | None = None,
    posture: Command | None = None,
    settle: float = 0.3,
) -> Course:
    """Move both hands along straight lines while the robot takes a posture; forces change as softly.

    It takes a time and does not wait for the hands: what they touch may hold them back.

    Args:
        view: now.
        points: where the left and the right hand go [m], shape (2, 3); a row of NaN for an arm that rests.
        frame: "heading" or "world".
        speed: mean speed of the hand with the longer way [m/s].
        together: whether the hands hold one object.
        directions: along which the forearms should point.
        forces: on the hands, at the end [N], shape (2, 3).
        stiffness: of the hands [N/m]; None for that of the servo.
        posture: standing command with h, p and w; None for that of the last tick.
        settle: time afterwards in which the targets stay [s].
    """
    last = view.last.hands
    start, before = hands_in(view, frame), NO_FORCE if last is None else in_frame(view, last, frame).wrench.force
    start = np.where(np.isfinite(points), start, np.nan)
    length = float(np.nanmax(np.linalg.norm(points - start, axis=1), initial=0.0))
    duration = max(length / speed, _SHORTEST_GLIDE)
    begin, command = view.time, posture or standing(view)
    while view.time - begin < duration + settle:
        blend = smooth_step((view.time - begin) / duration)
        at, force = start + blend * (points - start), before + blend * (forces - before)
        view = yield Action(command, targets(at, frame, together, directions, force, stiffness))
    return view


def targets(
    points: np.ndarray,
    frame: HandFrame,
    together: bool = False,
    directions: Directions = (None, None),
    forces: np.ndarray = NO_FORCE,
    stiffness: float | None = None,
) -> HandTargets:
    """Return hand targets from points [m] and forces [N], shapes (2, 3); a row of NaN is a hand without one."""
    left, right = (None if np.isnan(point).any() else point for point in points)
    forces = np.where(np.isnan(points).any(axis=1, keepdims=True), 0.0, forces)
    wrench = HandWrench(forces, stiffness=stiffness) if forces.any() or stiffness is not None else FREE
    return HandTargets(left, right, frame, *directions, together=together, wrench=wrench)


def one_hand(row: int, point: np.ndarray, others: np.ndarray | None = None) -> np.ndarray:
    """Return the points of both hands, shape (2, 3); the other hand keeps that of `others`, or has none."""
    points = np.full((2, 3), np.nan) if others is None else others.copy()
    points[row] = point
    return points


def stature(robot: Robot | None) -> float:
    """Return the height of a robot's shoulders relative to the H1's, for which `LEVEL` and others hold; 1 for None."""
    if robot is None:
        return 1.0
    height, made_for = (float(one.nominal_height + one.shoulder[2]) for one in (robot, load_robot("h1")))
    return height / made_for


def levelled(view: View, hands: HandTargets) -> Command:
    """Return the standing command with which the forearms are level at these targets."""
    return squat(float(np.nanmean(points_of(view, hands)[:, 2])), view.robot)


def squat(height: float, robot: Robot | None = None) -> Command:
    """Return the standing command with which the forearms are level while the hands are at a height [m].

    The legs lift and lower what both hands hold: a forearm that rises turns up, and the object turns with it.
    """
    size = stature(robot)
    h = size * float(np.clip(height / size - LEVEL, LOWEST, 0.0))
    return Command.from_mapping({"h": h}, Gait.STANDING, robot)


def crouch(height: float, robot: Robot | None = None) -> Command:
    """Return the standing command with which hands work comfortably at a height [m]: lower and leaning for low ones."""
    size = stature(robot)
    h = float(np.clip(height / size - COMFORTABLE, LOWEST, 0.0))
    return Command.from_mapping({"h": size * h, "p": float(np.clip(-h, 0.0, 0.25))}, Gait.STANDING, robot)


def frame_of(name: str) -> HandFrame:
    """Return the frame in which targets given in `name` are sent: that of an object is the world."""
    return name if name in HAND_FRAMES else "world"  # type: ignore[return-value]


def check_frame(view: View, name: str) -> None:
    """Raise `Failure` if a name is neither that of a frame nor of an object that is seen."""
    if name not in HAND_FRAMES and name not in view.objects:
        names = ", ".join((*HAND_FRAMES, *view.objects))
        raise Failure(f"there is no frame or object '{name}'; there are: {names}")


def sent_point(view: View, frame: str, point: object) -> np.ndarray | None:
    """Return a point of a frame or an object in the frame in which it is sent [m], shape (3,); None for None."""
    if point is None:
        return None
    vector = np.asarray(point, dtype=float)
    return vector if frame in HAND_FRAMES else seen(view, frame).point(vector)


def sent_vector(view: View, frame: str, vector: object) -> np.ndarray | None:
    """Return a vector of a frame or an object in the axes in which it is sent, shape (3,); None for None."""
    if vector is None:
        return None
    given = np.asarray(vector, dtype=float)
    return given if frame in HAND_FRAMES else seen(view, frame).direction(given)


def sent_orientation(view: View, frame: str, orientation: np.ndarray | None) -> np.ndarray | None:
    """Return an orientation in a frame or an object in the axes in which it is sent, shape (4,); None for None."""
    if orientation is None or frame in HAND_FRAMES:
        return orientation
    return rotations.multiply(seen(view, frame).orientation, orientation)


def to_world(view: View, frame: str) -> np.ndarray:
    """Return the matrix from a frame of hand targets to the world, shape (3, 3)."""
    return frame_axes(frame, view.state.orientation)


def points_in(view: View, points: np.ndarray, frame: str) -> np.ndarray:
    """Return points of the world in a frame of hand targets [m], shape (n, 3)."""
    return points if frame == "world" else (points - view.position) @ to_world(view, frame)


def points_of(view: View, hands: HandTargets) -> np.ndarray:
    """Return hand targets in the world [m], shape (2, 3); NaN for a hand without one."""
    points = hands.array()
    return points if hands.frame == "world" else view.position + points @ to_world(view, hands.frame).T


def hands_in(view: View, frame: HandFrame) -> np.ndarray:
    """Return the hand targets in a frame, or else the hand positions [m], shape (2, 3)."""
    points = last_targets(view, frame).array()
    return np.where(np.isfinite(points), points, points_in(view, view.hands, frame))


def last_targets(view: View, frame: HandFrame) -> HandTargets:
    """Return the last targets of the hands in a frame; empty ones after targets of joints, which have no places."""
    last = view.last.hands
    return HandTargets(None, None, frame) if last is None or last.joints is not None else in_frame(view, last, frame)


def with_points(hands: HandTargets, points: np.ndarray) -> HandTargets:
    """Return targets with other positions for the hands that have one; `points` of shape (2, 3)."""
    left, right = (points[row] if given else None for row, given in enumerate(hands.given))
    return dataclasses.replace(hands, left=left, right=right)


def in_frame(view: View, hands: HandTargets, frame: HandFrame) -> HandTargets:
    """Return the same targets in another frame; what is given by its axes turns with it."""
    if hands.frame == frame:
        return hands
    turn = to_world(view, hands.frame).T @ to_world(view, frame)
    return hands.turned(turn, points_in(view, points_of(view, hands), frame), frame)


def held_targets(view: View) -> HandTargets:
    """Return the last targets of the hands; raise `Failure` if they have none."""
    hands = view.last.hands
    if hands is None or hands.joints is not None or not hands.given.any():
        raise Failure("the hands have no targets; reach or squeeze first")
    return hands


def shifted(hands: HandTargets, by: np.ndarray) -> HandTargets:
    """Return targets moved by a vector of their frame [m]."""
    return with_points(hands, hands.array() + by)


def check_near(view: View, hands: HandTargets) -> None:
    """Raise `Failure` if a hand target is farther from the pelvis than `FARTHEST_HAND`."""
    away = np.linalg.norm(points_of(view, hands) - view.position, axis=1)
    for side, distance in zip(SIDES, away, strict=True):
        if distance > FARTHEST_HAND:
            raise Failure(f"the {side} hand's target is {distance:.1f} m away (limit {FARTHEST_HAND:g} m); walk there")


def _cm(metres: float) -> str:
    return f"{100 * metres:.1f} cm"


class Pressing:
    """The requested force with which a hand presses with the wanted one.

    A hand gives way along the requested force, so that its target cannot make up for what friction of the drives and
    errors of the model take from that force. Where forces on the hands are known, their error corrects the request.
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
            more = self._more + _PRESSING_GAIN * (view.time - self._time) * missing
            self._more = float(np.clip(more, -0.8 * self._force, _MOST_MORE))
        self._time = view.time
        return self._force + self._more

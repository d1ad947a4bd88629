"""Steps of the legs: walk to a place, face something, push and pull by walking, stand.

Walks are velocity commands from the estimated pose.
"""

import dataclasses
import math
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from hugwbc import rotations
from hugwbc.behaviours.course import (
    Angle,
    Course,
    Failure,
    Metres,
    Name,
    Place,
    Seconds,
    Tolerance,
    WalkSpeed,
    Way,
    kept,
    seen,
    standing,
    step,
)
from hugwbc.behaviours.lag import START, STUCK
from hugwbc.behaviours.stops import SETTLED
from hugwbc.commands import VELOCITY_NAMES, Command, default_command
from hugwbc.errors import ConfigError
from hugwbc.gait import Gait
from hugwbc.scripts.view import Action, View
from hugwbc.stride import OverStride

POSITION_TOLERANCE = 0.05  # [m]
YAW_TOLERANCE = math.radians(3.0)  # [rad]
_NEAR, _DEADBAND = 0.7, 0.5  # shares of the tolerances that the mean of a stride keeps for a while, and as it stops
_GAIN, _TURN_GAIN = 0.5, 1.0  # [1/s], speed per distance (at 0.7 a slow v_y overshoots for ever), yaw rate per angle
_SLOW_DOWN = 0.15  # [m/s^2], deceleration towards the goal
_FAR = 0.6  # [m]; the robot turns to face a goal that is farther away
_BEFORE = 0.5  # [m], from an object to the robot that stands before it
_SLOWEST_TURN = 0.6  # [rad/s], highest yaw rate of a turn
_SLOW_TIME = 0.6  # [s] near the goal before the robot stands
_HAUL_GAIN = 0.8  # [1/s], speed of a push per distance that is left, and per distance from the line
_SLOWEST = 0.08  # [m/s], least speed of a push


class Goal(NamedTuple):
    """A place in the world [m] and a heading [rad]."""

    x: float
    y: float
    yaw: float


@step
def walk_to(
    view: View,
    position: Place | None = None,
    yaw: Angle | None = None,
    *,
    before: Name | None = None,
    distance: Metres = _BEFORE,
    aside: Metres = 0.0,
    turn: Angle = 0.0,
    speed: WalkSpeed = 0.4,
    keep_yaw: bool = False,
    stand: bool = True,
    tolerance: Tolerance = POSITION_TOLERANCE,
    timeout: Seconds = 45.0,
) -> Course:
    """Walk to a place in the world, or in front of an object: give `position` or `before`.

    A robot that is more than 0.6 m from its goal turns to face it and walks ahead; a nearer one, or any with
    `keep_yaw`, goes ahead, back or sideways as it stands. It walks on a straight line and avoids nothing.

    Args:
        view: now.
        position: x and y in the world [m].
        yaw: heading there [rad]; None for the direction from the start to the position, or the present heading where
            that is nearer than 0.1 m or `keep_yaw` is set.
        before: object whose x axis points away from the robot that stands before it. The goal follows the object.
        distance: from the object's origin, against its x axis [m].
        aside: along the object's y axis [m].
        turn: heading there, relative to the object's [rad].
        speed: highest speed [m/s].
        keep_yaw: whether it does not turn to face its way, such as with a box between tables.
        stand: whether it ends standing; otherwise it ends as soon as it is near, still walking.
        tolerance: distance from the goal at which it has arrived [m].
        timeout: after which it fails [s].
    """
    if (position is None) is (before is None):
        raise ConfigError("walk_to needs either a position (x, y) or the object to stand before; give one of them")
    if before is not None and yaw is not None:
        raise ConfigError("yaw is a heading in the world; give turn, which is relative to the object's")
    if before is None and (distance, aside, turn) != (_BEFORE, 0.0, 0.0):
        raise ConfigError("distance, aside and turn are relative to an object; give before, or yaw at a position")

    def goal(now: View) -> Goal:
        if before is None:
            assert position is not None
            x, y = position
            heading = yaw
            if heading is None:
                way = np.array([x, y]) - view.position[:2]
                turns = not keep_yaw and np.hypot(*way) > 0.1
                heading = math.atan2(way[1], way[0]) if turns else view.state.yaw
            return Goal(x, y, heading)
        thing = seen(now, before)
        offset = rotations.rotation_z(thing.yaw) @ np.array([-distance, aside, 0.0])
        x, y, _ = (thing.position + offset).tolist()
        return Goal(x, y, thing.yaw + turn)

    return _Walk(goal, speed, stand, tolerance, keep_yaw).course(view)


@step
def face(
    view: View, object: Name | None = None, *, yaw: Angle | None = None, stand: bool = True, timeout: Seconds = 20.0
) -> Course:
    """Turn on the spot to a heading, or towards an object: give `object` or `yaw`.

    Args:
        view: now.
        object: name of an object.
        yaw: heading in the world [rad].
        stand: whether it ends standing.
        timeout: after which it fails [s].
    """
    if (object is None) is (yaw is None):
        raise ConfigError("face needs either an object or a yaw; give one of them")
    x, y = view.position[:2].tolist()

    def goal(now: View) -> Goal:
        if object is None:
            assert yaw is not None
            return Goal(x, y, yaw)
        way = seen(now, object).position - now.position
        return Goal(x, y, math.atan2(way[1], way[0]))

    return _Walk(goal, 0.4, stand, tolerance=0.15).course(view)


@step
def push(view: View, object: Name, distance: Way, *, speed: WalkSpeed = 0.2, timeout: Seconds = 40.0) -> Course:
    """Walk ahead on a straight line, with the hands as they are, until an object has moved by a distance.

    Args:
        view: now.
        object: its name.
        distance: by how much it has to move along the robot's heading at the start [m].
        speed: of the walk [m/s].
        timeout: after which it fails [s].
    """
    return _haul(view, object, distance, speed, sign=1.0)


@step
def pull(view: View, object: Name, distance: Way, *, speed: WalkSpeed = 0.2, timeout: Seconds = 40.0) -> Course:
    """Walk back on a straight line, with the hands as they are, until an object has moved by a distance; as `push`."""
    return _haul(view, object, distance, speed, sign=-1.0)


def _haul(view: View, name: str, distance: float, speed: float, sign: float) -> Course:
    start, yaw, at = view.position, view.state.yaw, seen(view, name).position
    axes = rotations.rotation_z(yaw)
    far, time = 0.0, view.time
    while True:
        moved = sign * float((seen(view, name).position - at) @ axes[:, 0])
        left = distance - moved
        progress = f"'{name}' has moved by {100 * moved:.0f} of {100 * distance:g} cm"
        if left <= 0.0:
            break
        if moved > far + 0.01:
            far, time = moved, view.time
        if view.time - time > STUCK + START * (far == 0.0):
            raise Failure(f"{progress} and is stuck")
        turn = float(rotations.wrap_angle(yaw - view.state.yaw))
        aside = float((start - view.position) @ axes[:, 1])
        v_x, v_y = sign * min(speed, _HAUL_GAIN * left + _SLOWEST), min(max(_HAUL_GAIN * aside, -0.15), 0.15)
        omega = min(max(_TURN_GAIN * turn, -0.4), 0.4)
        view = yield Action(_walking(view, (v_x, v_y, omega)), kept(view), progress=progress)
    while view.last.command.gait is not Gait.STANDING:
        view = yield Action(standing(view), kept(view), progress="the robot comes to a stand")
    return view


@step
def stand(view: View, seconds: Seconds = 1.0, *, h: float = 0.0, p: float = 0.0, w: float = 0.0) -> Course:
    """Take a height h [m], a pitch p and a waist angle w [rad], then stand so for a time [s]; the hands stay."""
    command = Command.from_mapping({"h": h, "p": p, "w": w}, Gait.STANDING, view.robot).validate(view.robot)
    begin: float | None = None
    while begin is None or view.time - begin < seconds:
        last = view.last.command
        there = np.allclose(last.array(), command.array(), atol=1e-3) and last.gait is Gait.STANDING
        begin = view.time if begin is None and there else begin
        view = yield Action(command, kept(view))
    return view


@dataclasses.dataclass
class _Walk:
    """A walk to a goal, which turns to its heading, and stands.

    The velocity falls with the distance; that by which the robot lags is added to the command (`View.lag`). As the
    pelvis sways from foot to foot, the robot stops where the mean of a stride is near the goal minus the way that a
    stop moves it (`View.stop`). If it then stands outside of the tolerances, it walks again.
    """

    goal: Callable[[View], Goal]  # returns the goal as it is known now
    speed: float  # highest speed [m/s]
    stand: bool  # whether it ends standing; otherwise it ends as soon as it is near, still walking
    tolerance: float  # distance from the goal at which it has arrived [m]
    keep_yaw: bool = False  # whether it does not turn to face a goal that is far
    progress: str = ""  # how far it is

    def course(self, view: View) -> Course:
        """Walk."""
        if view.state.position is None or view.state.velocity is None:
            raise Failure("the position of the robot is not known; add an estimator")
        while True:
            view = yield from self._approach(view)
            if not self.stand:
                return view
            view = yield from self._stop(view)
            if self._arrived(self._error(view), 1.0):
                return view

    def _error(self, view: View) -> np.ndarray:
        """Return the way to the goal in the heading frame [m] and the angle to its heading [rad], shape (3,)."""
        goal = self.goal(view)
        state, position = view.state, view.position
        ahead = rotations.rotation_z(-state.yaw)[:2, :2] @ (np.array([goal.x, goal.y]) - position[:2])
        turn = float(rotations.wrap_angle(goal.yaw - state.yaw))
        self.progress = (
            f"{100 * float(np.hypot(*ahead)):.1f} cm and {abs(math.degrees(turn)):.1f} degrees from the goal "
            f"(tolerance {100 * self.tolerance:g} cm and {math.degrees(YAW_TOLERANCE):g} degrees)"
        )
        return np.array([*ahead, turn])

    def _arrived(self, error: np.ndarray, share: float) -> bool:
        distance = math.hypot(error[0], error[1])
        return distance <= share * self.tolerance and abs(error[2]) <= share * YAW_TOLERANCE

    def _approach(self, view: View) -> Course:
        """Walk until the mean of a stride is near the goal for a while; at once if it need not stand."""
        stride, mean = 1.0 / default_command(Gait.WALKING, view.robot).f, OverStride()
        near: float | None = None
        error = self._error(view)
        if self._arrived(error, _DEADBAND) and view.last.command.gait is Gait.STANDING:
            return view
        while True:
            error, last = self._error(view) - (view.stop if self.stand else 0.0), float(error[2])
            velocity = self._velocity(error) + view.lag
            error[2] += math.tau * round((last - error[2]) / math.tau)  # the mean of two half turns is none
            average = mean(view.time, error, stride)
            average[2] = rotations.wrap_angle(average[2])
            near = None if not self._arrived(average, _NEAR) else view.time if near is None else near
            if near is not None and not self.stand:
                return view
            ready = near is not None and view.time - near >= _SLOW_TIME and view.mid_stance
            if ready and self._arrived(average, _DEADBAND):
                return view
            view = yield Action(_walking(view, velocity), kept(view), progress=self.progress)
            if view.stuck:
                v_x, v_y, omega, *_ = view.last.command.array()
                speed = math.hypot(v_x, v_y)
                words = f"moved for {STUCK:g} s while commanded {speed:.1f} m/s"
                if speed < abs(omega):
                    words = f"turned for {STUCK:g} s while commanded {abs(omega):.1f} rad/s"
                raise Failure(f"stuck: has not {words}; {self.progress}")

    def _velocity(self, error: np.ndarray) -> np.ndarray:
        """Return the velocity [m/s, m/s, rad/s] for a way that is left, shape (3,)."""
        distance = math.hypot(error[0], error[1])
        speed = min(self.speed, _GAIN * distance, math.sqrt(2.0 * _SLOW_DOWN * distance))
        turn = error[2]
        if distance > _FAR and not self.keep_yaw:  # walk ahead to it: sideways is slow
            turn = math.atan2(error[1], error[0])
            speed *= max(math.cos(turn), 0.0)
            way = np.array([speed, 0.0])
        else:
            way = error[:2] * (speed / max(distance, 1e-6))
        return np.array([*way, min(max(_TURN_GAIN * turn, -_SLOWEST_TURN), _SLOWEST_TURN)])

    def _stop(self, view: View) -> Course:
        """Stand, and wait until the robot is at rest."""
        since: float | None = None
        while since is None or view.time - since < SETTLED:
            last = view.last.command
            if last.gait is Gait.STANDING and since is None:
                since = view.time
            view = yield Action(standing(view), kept(view), progress=self.progress)
            self._error(view)
        return view


def _walking(view: View, velocity: Iterable[float]) -> Command:
    """Return a walking command with a velocity [m/s, m/s, rad/s], and with h and p of the last command."""
    last = view.last.command
    values = dict(zip(VELOCITY_NAMES, map(float, velocity), strict=True)) | {"h": last.h, "p": last.p}
    return Command.from_mapping(values, Gait.WALKING, view.robot)

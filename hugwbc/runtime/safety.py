"""What passes a control period: states that can be used, and joint commands within the limits."""

import math

import numpy as np

from hugwbc.controller import JointCommand
from hugwbc.robot import Robot
from hugwbc.runtime.safety_report import SafetyLog
from hugwbc.state import RobotState
from hugwbc.table_defaults import LEAST_ERROR, LEAST_SPEED

# Counters of what was clamped in the five vectors.
_LIMITED = ("positions_limited", "speeds_limited", "gains_limited", "gains_limited", "torques_limited")


def gain_limits(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Return the highest stiffness [N*m/rad] and damping [N*m*s/rad] of each joint, each of shape (n,).

    They give the drive's full torque for an error of 0.05 rad, or of a tenth of the joint's highest speed.
    """
    return robot.torque_limit / LEAST_ERROR, robot.torque_limit / (LEAST_SPEED * robot.velocity_limit)


class SafetyFilter:
    """A limiter of joint commands.

    Position targets are clamped to `Robot.target_range`, velocity targets to the joints' highest speeds, gains to 0
    and `gain_limits`, and feed-forward torques to the torque limits. What is clamped is counted.
    """

    def __init__(self, robot: Robot, log: SafetyLog) -> None:
        """Take the limits from a robot."""
        self._names, self._log = robot.joint_names, log
        (lowest, highest), speed, torque = robot.target_range, robot.velocity_limit, robot.torque_limit
        self._high = np.array((highest, speed, *gain_limits(robot), torque))
        self._low = np.array((lowest, -speed, *np.zeros((2, torque.size)), -torque))
        self._given: JointCommand | None = None

    def __call__(self, command: JointCommand) -> JointCommand:
        """Bring a finite joint command within all limits, and count what was changed."""
        if command is self._given:
            return command
        before = np.array((command.q, command.dq, command.kp, command.kd, command.tau))
        after = np.minimum(np.maximum(before, self._low), self._high)  # in a third of the time of `np.clip`
        different = before != after
        if np.count_nonzero(different):  # in a fifth of the time of `any`
            for counter, joints, way in zip(_LIMITED, different, np.abs(before - after), strict=True):
                if joints.any():
                    joint = self._names[int(np.argmax(way))]
                    self._log.count(counter, f"{counter.replace('_', ' ')}, first at {joint}")
        self._given = JointCommand(*after)
        return self._given


# The most that a body does that can still be balanced. Beyond that no controller helps, and the solver of the QP takes
# 40 times as long.
_LARGEST_TILT = 1.3  # [rad] between the pelvis's axis and the vertical; the robot has fallen at 1.0
_LARGEST_RATE = 15.0  # [rad/s], of the pelvis
_LARGEST_SPEED = 6.0  # [m/s], of the pelvis
_FASTEST_JOINT = 3.0  # multiple of the robot's table; ankles reach 1.8 times theirs where a foot lands hard
_BEYOND_RANGE = 0.5  # [rad] outside a joint's range; stops of rubber give way, and encoders have offsets


class StateCheck:
    """A judge of a robot's states."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self._fastest = robot, _FASTEST_JOINT * robot.velocity_limit
        self._low, self._high = robot.lower - _BEYOND_RANGE, robot.upper + _BEYOND_RANGE
        vector = np.full(robot.kp.size, np.nan)
        self._nothing = RobotState(vector, vector, np.full(4, np.nan), np.full(3, np.nan))

    def admit(self, state: RobotState) -> RobotState:
        """Return the state, or one without numbers if it is not of this robot's joints."""
        fits = isinstance(state, RobotState) and state.q.size == self.robot.kp.size
        return state if fits else self._nothing

    def fault(self, state: RobotState) -> str:
        """Return why no controller can use a state; empty if it can."""
        if not state.is_usable:
            return "the state is not finite, or has no orientation"
        velocity, (_, x, y, _) = state.velocity, state.orientation.tolist()
        if 1.0 - 2.0 * (x * x + y * y) < math.cos(_LARGEST_TILT):
            return "the robot has fallen: it leans too far"
        if state.angular_velocity.dot(state.angular_velocity) > _LARGEST_RATE**2:
            return "the pelvis turns faster than it can"
        if velocity is not None and velocity.dot(velocity) > _LARGEST_SPEED**2:
            return "the pelvis moves faster than it can"
        if np.count_nonzero(np.abs(state.dq) > self._fastest):
            return "a joint moves faster than it can"
        beyond = np.count_nonzero((state.q < self._low) | (state.q > self._high))
        return "a joint is outside its range" if beyond else ""

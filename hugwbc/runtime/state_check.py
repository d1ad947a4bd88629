"""The check of states, once in a control period: controllers trust what they get."""

import math

import numpy as np

from hugwbc.robot import Robot
from hugwbc.state import RobotState

# What a body that can still be balanced does at most. Beyond it no controller helps, and the solver of the QP takes 40
# times as long.
_LARGEST_TILT = 1.3  # [rad] between the pelvis's axis and the vertical; the robot has fallen at 1.0
_LARGEST_RATE = 15.0  # [rad/s], of the pelvis
_LARGEST_SPEED = 6.0  # [m/s], of the pelvis
_FASTEST_JOINT = 3.0  # multiple of the robot's table; ankles reach 1.8 times theirs where a foot lands hard
_BEYOND_RANGE = 0.5  # [rad] outside a joint's range; stops of rubber give way, and encoders have offsets


class StateCheck:
    """A judge of a robot's states.

    Attributes:
        robot: the robot.
    """

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

"""The check of states, once in a control period: controllers trust what they get."""

import numpy as np

from hugwbc.robot import Robot
from hugwbc.state import RobotState


class StateCheck:
    """A judge of a robot's states.

    Attributes:
        robot: the robot.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        vector = np.full(robot.kp.size, np.nan)
        self._nothing = RobotState(vector, vector, np.full(4, np.nan), np.full(3, np.nan))

    def admit(self, state: RobotState) -> RobotState:
        """Return the state, or one without numbers if it is not of this robot's joints."""
        fits = isinstance(state, RobotState) and state.q.size == self.robot.kp.size
        return state if fits else self._nothing

    def fault(self, state: RobotState) -> str:
        """Return why no controller can use a state; empty if it can."""
        return "" if state.is_usable else "the state is not finite, or has no orientation"

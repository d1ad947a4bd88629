"""Detection of a dead motor in a leg: torque is asked of it for a while, and it gives none."""

import collections
import math

import numpy as np

from hugwbc.controller import JointCommand
from hugwbc.kinematics import in_place
from hugwbc.robot import Robot
from hugwbc.state import RobotState

# Figures behind these numbers are in docs/log/faults.md.
QUIET = 3.5  # [N*m]; a motor that measures more than this works
ASKED = 7.0  # [N*m]; a working motor that is asked for so much is not quiet for long
MISSING = 0.3  # [N*m*s], integral of the torque that a quiet motor was asked for, from which on it is dead
_MOST = 20.0  # [N*m], what counts of that torque: one large value of a working motor at a change of sign means nothing
_FORGET = 0.3  # [s], in which the integral fades while less than `ASKED` is asked for
_LONGEST_STEP = 0.03  # [s]; a longer gap between two readings counts as this
_LATE = 0.01  # [s] by which a command may reach a motor too late; of those that may act, the least torque counts
_AVERAGED = 0.002  # [s] by which torques are older than their reading, since they are averaged from the last one on
_KEPT = 64  # commands, an eighth of a second of the shortest periods


class MotorWatch:
    """A watch over the torques of the legs.

    Attributes:
        dead: name of the first joint whose motor was found dead; empty while all work.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot, self._legs = robot, in_place(robot.legs)
        self._limit = robot.torque_limit[self._legs]
        self._fastest = robot.velocity_limit[self._legs]
        self._slope = self._limit / (self._fastest - robot.corner_speed[self._legs])
        self.reset()

    def reset(self) -> None:
        """Take all motors to work."""
        self.dead = ""
        self._missing = np.zeros(self._limit.size)
        self._commands: collections.deque[tuple[float, JointCommand]] = collections.deque(maxlen=_KEPT)
        self._now = math.inf  # [s]

    def note(self, command: JointCommand) -> None:
        """Keep the joint command that follows on the last reading."""
        self._commands.append((self._now, command))

    def see(self, reading: RobotState, now: float) -> None:
        """Compare the torques of a new reading, which arrives now [s], with what the commands of its time asked for."""
        elapsed, self._now = min(max(now - self._now, 0.0), _LONGEST_STEP), now
        acted = now - reading.age - self._robot.command_delay - _AVERAGED
        commands = self._acting(acted)
        if not commands or reading.torque is None:
            return
        quiet = np.abs(reading.torque[self._legs]) <= QUIET  # a comparison with NaN is false
        asked = np.full(quiet.size, _MOST)
        for command in commands:
            asked = np.minimum(asked, self._asked(command, reading))
            if not (quiet & (asked > ASKED)).any():
                break
        missing = np.where(asked > ASKED, self._missing + elapsed * asked, math.exp(-elapsed / _FORGET) * self._missing)
        self._missing = np.where(quiet, missing, 0.0)
        if not self.dead and self._missing.max() > MISSING:
            self.dead = self._robot.joint_names[self._robot.legs[int(np.argmax(self._missing))]]

    def _acting(self, acted: float) -> list[JointCommand]:
        """Return the commands that may have acted at a time [s], the last one first."""
        found = []
        for issued, command in reversed(self._commands):
            if issued <= acted:
                found.append(command)
                if issued <= acted - _LATE:
                    break
        return found

    def _asked(self, command: JointCommand, reading: RobotState) -> np.ndarray:
        """Return how much torque a command asks of each motor of the legs, within what the motor can give [N*m]."""
        legs = self._legs
        torque = command.tau + command.kp * (command.q - reading.q) + command.kd * (command.dq - reading.dq)
        speed = reading.dq[legs] * np.sign(torque[legs])  # a motor has no torque to drive a joint at its highest speed
        return np.minimum(np.abs(torque[legs]), self._slope * (self._fastest - speed))

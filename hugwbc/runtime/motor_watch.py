"""Detection of a dead motor in a leg: torque is asked of it for a while, and it gives none."""

import collections
import dataclasses
import math

from hugwbc.controller import JointCommand
from hugwbc.kinematics import in_place
from hugwbc.robot import Robot
from hugwbc.state import RobotState

# Figures behind these numbers are in docs/log/faults.md.
QUIET = 3.5  # [N*m]; a motor that measures more than this works
ASKED = 7.0  # [N*m]; a working motor that is asked for so much is not quiet for long
MISSING = 0.3  # [N*m*s], integral of the torque that a quiet motor was asked for, from which on it is dead
_MOST = 20.0  # [N*m], most of that torque that counts: a single large value at a change of sign means nothing
_FORGET = 0.3  # [s], in which the integral fades while less than `ASKED` is asked for
# A longer gap counts as this: nothing is known of it, and one reading alone finds no motor dead.
_LONGEST_STEP = 0.005  # [s]
_LATE = 0.01  # [s] by which a command may reach a motor too late; of those that may act, the least torque counts
_AVERAGED = 0.002  # [s] by which torques are older than their reading, since they are averaged from the last one on
_KEPT = 64  # commands, in case readings stop


@dataclasses.dataclass
class _Asked:
    """What a command asks of the legs, and when it was sent: at the earliest and at the latest."""

    kp: list[float]  # stiffness [N*m/rad]
    kd: list[float]  # damping [N*m*s/rad]
    constant: list[float]  # torque at zero angle and speed [N*m]
    earliest: float  # [s]
    latest: float  # [s]


class MotorWatch:
    """A watch over the torques of the legs.

    The thresholds are torques of an H1 in N*m, whatever the robot: on one whose legs need less than `ASKED`, a dead
    motor is not found.

    Attributes:
        dead: name of the first joint whose motor was found dead; empty while all work.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot, self._legs = robot, in_place(robot.legs)
        fastest = robot.velocity_limit[self._legs]
        slope = robot.torque_limit[self._legs] / (fastest - robot.corner_speed[self._legs])
        self._fastest, self._slope = fastest.tolist(), slope.tolist()
        self.reset()

    def reset(self) -> None:
        """Assume that all motors work."""
        self.dead = ""
        self._missing = [0.0] * len(self._slope)
        self._commands: collections.deque[_Asked] = collections.deque(maxlen=_KEPT)
        self._now, self._behind = math.inf, False  # time of the last reading [s]; whether a newer one waited
        self._torque = b""  # of the last reading

    def note(self, command: JointCommand) -> None:
        """Keep the joint command that answers the last reading."""
        legs = self._legs
        kp, kd = command.kp[legs], command.kd[legs]
        constant = command.tau[legs] + kp * command.q[legs] + kd * command.dq[legs]
        self._commands.append(_Asked(kp.tolist(), kd.tolist(), constant.tolist(), self._now, self._now))

    def see(self, reading: RobotState, now: float, *, behind: bool = False) -> None:
        """Compare the torques of a new reading, which arrives now [s], with what the commands of its time asked for.

        A reading is `behind` if a newer one waits: it arrived while the last command was computed, which may not have
        been sent yet.
        """
        elapsed, self._now = min(max(now - self._now, 0.0), _LONGEST_STEP), now
        if self._commands and (behind or self._behind):
            self._commands[-1].latest = now
        self._behind = behind
        acted = now - reading.age - self._robot.command_delay - _AVERAGED
        while len(self._commands) > 1 and self._commands[1].latest <= acted - _LATE:
            self._commands.popleft()
        acting = [(asked.kp, asked.kd, asked.constant) for asked in self._commands if asked.earliest <= acted]
        if not acting or reading.torque is None:
            return
        last, self._torque = self._torque, reading.torque.tobytes()
        if self._torque == last:  # measured torques have noise
            return
        legs = self._legs
        fade, missing = math.exp(-elapsed / _FORGET), self._missing
        motion = zip(*(vector[legs].tolist() for vector in (reading.torque, reading.q, reading.dq)), strict=True)
        # Most motors are settled after one comparison or two: floats take a quarter of the time of arrays.
        for joint, (measured, q, speed) in enumerate(motion):
            if not -QUIET <= measured <= QUIET:  # nor is NaN
                missing[joint] = 0.0
                continue
            asked = _MOST
            for kp, kd, constant in acting:
                torque = constant[joint] - kp[joint] * q - kd[joint] * speed
                # A motor has no torque to drive a joint at its highest speed.
                possible = self._slope[joint] * (self._fastest[joint] - (speed if torque > 0.0 else -speed))
                asked = min(abs(torque), possible, asked)
                if not asked > ASKED:
                    break
            missing[joint] = missing[joint] + elapsed * asked if asked > ASKED else fade * missing[joint]
        if not self.dead and max(missing) > MISSING:
            self.dead = self._robot.joint_names[self._robot.legs[missing.index(max(missing))]]

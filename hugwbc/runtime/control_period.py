"""One period of control, the same in simulation and on a robot: estimate, arms, controller behind the safety filter."""

import math
import time
import warnings
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from hugwbc.commands import Command
from hugwbc.controller import Controller, JointCommand, UpperBody
from hugwbc.errors import ConfigError
from hugwbc.numeric import changed
from hugwbc.robot import Robot
from hugwbc.runtime.estimation import StateEstimator
from hugwbc.runtime.moment import PlanView
from hugwbc.runtime.safety import SafetyFilter
from hugwbc.runtime.sight import Sight
from hugwbc.scripts.command_source import CommandSource, SeeingSource
from hugwbc.scripts.view import View
from hugwbc.state import RobotState
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import IKSolution
from hugwbc.upper_ik.source import STALE_TIME

LONGEST_UPDATE = 0.01  # [s] between two updates of the estimator, if the controller's period is longer
_ROUNDING = 1e-9  # [s]


class Due:
    """Tells when the next period begins. After a gap in time it leaves periods out: it keeps in step with the others.

    Attributes:
        period: [s].
    """

    def __init__(self, period: float) -> None:
        self.period = period
        self.restart(0.0)

    def restart(self, first: float) -> None:
        """Let the first period begin at a time [s]."""
        self._next = first

    def __call__(self, now: float) -> bool:
        """Return whether a period begins now [s], and wait for the next one if so."""
        if now < self._next - _ROUNDING:
            return False
        self._next += (math.floor((now - self._next + _ROUNDING) / self.period) + 1) * self.period
        return True


def joined(readings: Sequence[RobotState]) -> RobotState:
    """Return the newest of some readings, with what is integrated averaged over all: gyro, accelerometer, torques."""
    last, count = readings[-1], len(readings)
    parts = []
    for reading in readings:
        gyro, accelerometer, torque = reading.imu_gyro, reading.imu_accelerometer, reading.torque
        if count == 1 or gyro is None or accelerometer is None or torque is None:
            return last
        parts.append((gyro, accelerometer, torque))
    gyro, accelerometer, torque = [sum(values[1:], values[0]) / count for values in zip(*parts, strict=True)]
    return changed(last, imu_gyro=gyro, imu_accelerometer=accelerometer, torque=torque)


class ArmSource(Protocol):
    """An object that turns hand targets into arm joint targets, such as `hugwbc.upper_ik.UpperBodySource`."""

    @property
    def solution(self) -> IKSolution | None:
        """The last IK solution; None while the controller moves the arms."""
        ...

    def reset(self) -> None:
        """Give the arms back at once, for a new run."""
        ...

    def update(
        self,
        state: RobotState,
        hands: HandTargets | None,
        command: Command,
        dt: float,
        commanded: np.ndarray | None = None,
    ) -> tuple[UpperBody, Command]:
        """Return the arm targets for the next `dt` seconds, and the command as the hands need it.

        Args:
            state: the robot now.
            hands: the hand targets; None gives the arms back to the controller.
            command: the user's command; its h, p and w may change for targets that ask for the whole body.
            dt: length of the control period [s].
            commanded: the arm part of the last joint command [rad], shape (8,); None at the start.
        """
        ...


class ControlPeriod:
    """What happens in every control period between a reading and a joint command.

    `decide` goes downhill, each part once: the source of commands, the arms, the safety filter with the controller
    inside it. `hugwbc.runtime.loop.ControlLoop` calls it for a simulated robot, `hugwbc.deploy.pilot.Pilot` for one
    behind messages.

    Attributes:
        safe: the controller behind its safety filter.
        plan: what the controller plans.
        estimator: gives the controller the state from noisy sensors; None where the readings tell it.
        upper_body: turns hand targets into arm targets; None ignores hand targets, with a warning.
        estimate: what the controller knows of the robot: the last estimate, or the last reading without an estimator.
        hands: the last hand targets, None where the controller moves the arms.
        ik_s: time that the last call of the arms' source took [s].
    """

    estimate: RobotState

    def __init__(
        self,
        controller: Controller,
        source: CommandSource,
        sight: Sight,
        *,
        robot: Robot,
        estimator: StateEstimator | None,
        upper_body: ArmSource | None = None,
    ) -> None:
        """Connect the parts.

        Args:
            controller: any object with the members of `Controller`.
            source: gives commands and hand targets over time.
            sight: what a source that looks at robot and objects sees.
            robot: whose limits the safety filter keeps.
            estimator: estimates the state from the readings; None where they tell it.
            upper_body: turns hand targets into arm targets; None ignores hand targets.
        """
        self.safe = SafetyFilter(controller, robot=robot)
        self.plan = PlanView(controller, self.safe)
        self.estimator, self.upper_body = estimator, upper_body
        self.hands: HandTargets | None = None
        self.ik_s = 0.0
        self._source, self._sight = source, sight
        self._update_due = Due(min(self.safe.period, LONGEST_UPDATE))
        self._unseen: list[RobotState] = []  # by the estimator
        self._seeing = source if isinstance(source, SeeingSource) else None
        self._arms = robot.arms
        self._commanded_arms: np.ndarray | None = None
        self._free_arms = UpperBody.none()
        self._asked: tuple[Command, HandTargets | None] = (Command(), None)  # what the source gave last
        self._unheard = 0.0  # [s] since then
        self._started = self._warned = False
        self._view: View | None = None

    def locate(self, reading: RobotState, now: float) -> None:
        """Start the estimate from the reading of a robot that stands at rest, which arrives now [s]."""
        self._update_due.restart(now + self._update_due.period)
        self._unseen.clear()
        self.estimate = reading
        if self.estimator is not None:
            self.estimate = self.estimator.reset(reading, self._update_due.period)

    def start(self, reading: RobotState, now: float) -> None:
        """Start a run from the reading of a robot that stands at rest, which arrives now [s]."""
        self.locate(reading, now)
        self._started = True
        self.safe.reset(self.estimate)
        self.hands, self.ik_s, self._commanded_arms = None, 0.0, None
        self._asked, self._unheard = (Command(), None), 0.0
        if self.upper_body is not None:
            self.upper_body.reset()
        if self._seeing is not None:
            self._seeing.restart()
            self._sight.reset()
            self._view = None

    def observe(self, reading: RobotState, now: float, *, driven: bool = True) -> None:
        """Take a reading. The estimator is updated once a period, or every `LONGEST_UPDATE`.

        Args:
            reading: newer than all before.
            now: time at which it arrives, on the robot's clock [s]; the stamp of a reading may be wrong.
            driven: whether the controller's last command acts, so that its plan tells of the motion.
        """
        if self.estimator is None:
            self.estimate = reading
            return
        self._unseen.append(reading)
        if driven and not self.estimate.coasted:  # what was replaced tells nothing of the motors
            self.safe.motors.see(reading, now)
        if self._update_due(now):
            planned = self.plan.acceleration if driven else None
            self.estimate = self.estimator.update(joined(self._unseen), planned, reading.imu_gyro)
            self._unseen.clear()

    def decide(self, t: float) -> JointCommand:
        """Return the joint command for the next period, which begins at time t of the run [s].

        Where the source raises or gives something else, its last command and hand targets count for `STALE_TIME`;
        then the robot stands, and the arms go back to the controller.
        """
        if not self._started:
            raise ConfigError("decide was called before the run has begun; call reset of the loop first")
        self._placed, arms = self.estimate, self._free_arms
        asked = self.safe.ask("source_failures", "the source", lambda: self._ask(t))
        self._unheard = 0.0 if asked is not None else self._unheard + self.safe.period
        if asked is not None or self._unheard > STALE_TIME:
            self._asked = asked or (Command(), None)
        command, self.hands = self._asked
        if self.upper_body is not None:
            begin = time.perf_counter()
            moved = self.safe.ask("source_failures", "the source of arm targets", lambda: self._move_arms(command))
            arms, command = moved or (arms, command)
            self.ik_s = time.perf_counter() - begin
        joints = self.safe.act(self.estimate, command, arms)
        self._commanded_arms = joints.q[self._arms]
        return joints

    def look(self, t: float) -> View:
        """Return what is seen at time t of the run [s]; each time has one view."""
        if self._view is None or self._view.time != t:
            self._view = self._sight.look(t, self.estimate)
        return self._view

    def _ask(self, t: float) -> tuple[Command, HandTargets | None]:
        """Ask the source for command and hand targets."""
        if self._seeing is not None:
            view = self.look(t)
            self._placed = view.state
            self._seeing.see(view)
            self._sight.grip(self._seeing.grips)
        command = self._source.command_at(t)
        hands = self._source.hands_at(t)
        if not isinstance(command, Command) or not isinstance(hands, HandTargets | None):
            given = f"a {type(command).__name__} and a {type(hands).__name__}"
            raise TypeError(f"it gave {given} instead of a Command, and HandTargets or None")
        if hands is not None and self.upper_body is None:
            if not self._warned:
                self._warned = True
                warnings.warn("hand targets are ignored: nothing moves the arms; give an UpperBodySource", stacklevel=2)
            hands = None
        return command, hands

    def _move_arms(self, command: Command) -> tuple[UpperBody, Command]:
        """Return the arm targets, and the command as the hands need it."""
        assert self.upper_body is not None
        arms, adapted = self.upper_body.update(
            self._placed, self.hands, command, self.safe.period, self._commanded_arms
        )
        return arms, adapted

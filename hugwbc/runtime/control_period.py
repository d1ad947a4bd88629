"""One period of control, the same in simulation and on a robot: from a reading to a joint command, stage by stage."""

import math
import time

import numpy as np

from hugwbc.commands import Command
from hugwbc.controller import Controller, JointCommand, UpperBody
from hugwbc.errors import ConfigError
from hugwbc.robot import Robot
from hugwbc.runtime.arms import ArmDrive, Handover
from hugwbc.runtime.command_chain import CommandChain
from hugwbc.runtime.estimation import StateEstimator, joined
from hugwbc.runtime.guard import Guard
from hugwbc.runtime.lowering import Lowering
from hugwbc.runtime.motor_watch import MotorWatch
from hugwbc.runtime.reading_guard import IMU, plausible
from hugwbc.runtime.safety import SafetyFilter, StateCheck
from hugwbc.runtime.safety_report import SafetyLog
from hugwbc.runtime.sight import Sight
from hugwbc.runtime.source_stage import SourceStage
from hugwbc.scripts.view import CommandSource, View
from hugwbc.state import RobotState
from hugwbc.stride import MidStance
from hugwbc.upper_ik import UpperBodySource

LONGEST_UPDATE = 0.01  # [s] between two updates of the estimator; a longer period of a controller has several
_ROUNDING = 1e-6  # [s]


class Due:
    """Tells when periods [s] begin. After a gap in time it leaves periods out, to keep in step with others."""

    def __init__(self, period: float) -> None:
        self.period = period
        self.restart(0.0)

    def restart(self, first: float) -> None:
        """Let the first period begin at a time [s]."""
        self._next = first

    def __call__(self, now: float) -> bool:
        """Return whether a period begins now [s], only once for each period."""
        late = now - self._next
        if late < -_ROUNDING:
            return False
        if abs(late) <= _ROUNDING:
            self._next = now  # sums of periods and of time steps would part in minutes
        self._next += (math.floor((now - self._next + _ROUNDING) / self.period) + 1) * self.period
        return True


class ControlPeriod:
    """What happens in every control period between a reading and a joint command.

    `decide` calls the stages in the order in which they act. `hugwbc.runtime.loop.ControlLoop` calls it for a simulated
    robot, `hugwbc.deploy.pilot.Pilot` for one behind messages.

    Attributes:
        guard: the controller, behind a guard.
        chain: limits the command; its `command` is what the robot is asked for now.
        log: counts what the stages change (`SafetyLog.report`).
        period: the controller's [s].
        estimator: gives the controller the state from noisy sensors; None where the readings tell the state.
        upper_body: turns hand targets into arm targets; None ignores hand targets, with a warning.
        motors: finds dead motors of the legs.
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
        upper_body: UpperBodySource | None = None,
    ) -> None:
        """Connect the parts; raise a ConfigError if one of them is of a robot with other joints."""
        advice = f"take a controller of {robot.name}, such as qp"
        _refuse_another(controller, robot, f"{getattr(controller, 'name', 'it')} controls the robot", advice)
        advice = f'give UpperBodySource(load_robot("{robot.name}"))'
        _refuse_another(upper_body, robot, "the source of arm targets moves the arms of", advice)
        advice = f'give StateEstimator(load_robot("{robot.name}"))'
        _refuse_another(estimator, robot, "the estimator knows", advice)
        self.estimator, self.upper_body = estimator, upper_body
        self._robot = robot
        self.log = SafetyLog()
        self.chain = CommandChain(self.log, robot)
        self.motors, self._lowering = MotorWatch(robot), Lowering(robot)
        self._arm_drive = ArmDrive(robot, self.log)
        self._check, self._limit = StateCheck(robot), SafetyFilter(robot, self.log)
        self.guard = Guard(controller, self._check, self._limit, self.log)
        moves_hands = upper_body is not None
        self._source = SourceStage(source, sight, self.log, robot, moves_hands=moves_hands, stop=self.guard.stop)
        self._handover = Handover(robot.arms)
        self.period = self.guard.period
        # An update whenever the controller acts, and as many between as there must be.
        self._update_due = Due(self.period / max(1, math.ceil(self.period / LONGEST_UPDATE - _ROUNDING)))
        self._unseen: list[RobotState] = []  # readings that the estimator has not had
        self._gyro: np.ndarray | None = None  # the last plausible reading of the gyro [rad/s]
        self._free_arms, self._started = UpperBody.none(), False

    def locate(self, reading: RobotState, now: float) -> None:
        """Start the estimate from the reading of a robot that stands at rest, which arrives now [s]."""
        self._update_due.restart(now + self._update_due.period)
        self._unseen.clear()
        self._gyro = reading.imu_gyro
        self.estimate = reading
        if self.estimator is not None:
            self.estimate = self.estimator.reset(reading, self._update_due.period)

    def start(self, reading: RobotState, now: float) -> None:
        """Start a run from the reading of a robot that stands at rest, which arrives now [s]."""
        self.locate(reading, now)
        self._started = True
        for stage in (self.log, self._source, self.chain, self.motors, self._lowering):
            stage.reset()
        self._arm_drive.reset()
        self._handover.reset()
        self.guard.reset(self._check.admit(self.estimate))
        self.hands, self.ik_s, self._last = None, 0.0, None
        self._mid_stance = MidStance()
        self._followed = self.chain.command  # by the controller in the last period
        if self.upper_body is not None:
            self.upper_body.reset()

    def observe(self, reading: RobotState, now: float, *, driven: bool = True, behind: bool = False) -> None:
        """Take a reading. The estimator is updated once a period, or at equal times within one (`LONGEST_UPDATE`).

        Args:
            reading: a reading, newer than all before.
            now: time at which it arrives, on the robot's clock [s]; its own time stamp may be wrong.
            driven: whether the controller's last command acts, so that its plan tells of the motion.
            behind: whether a newer reading waits.
        """
        reading = self._check.admit(reading)
        if self.estimator is None:
            self.estimate = reading
        if driven and not self.estimate.coasted:  # what was replaced tells nothing of the motors
            self.motors.see(reading, now, behind=behind)
        if self.estimator is None:
            return
        self._unseen.append(reading)
        if self._update_due(now):
            planned = self.guard.planned_acceleration if driven else None
            self.estimate = self.estimator.update(self._joined(), planned, self._gyro)
            self._unseen.clear()

    def _joined(self) -> RobotState:
        """Return the mean of the readings that the estimator has not had, without those that cannot be true."""
        newest = self._unseen[-1]
        whole = [
            one
            for one in self._unseen
            if not (one.imu_gyro is None or one.imu_accelerometer is None or one.torque is None)
        ]
        if not whole or whole[-1] is not newest:
            self._gyro = newest.imu_gyro
            return newest
        sound = plausible(whole, self._gyro, self._robot)
        for _ in range(len(self._unseen) - len(sound)):
            self.log.count_of("readings_refused", IMU, f"readings of {IMU} refused and replaced")
        self._gyro = sound[-1].imu_gyro
        return joined(sound, newest)

    @property
    def kneels(self) -> bool:
        """Whether the robot is let down onto its knees, or has been."""
        return self._lowering.begun

    def look(self, t: float) -> View:
        """Return what is seen at time t of the run [s]; each time has one view."""
        return self._source.look(t, self.estimate)

    def decide(self, t: float) -> JointCommand:
        """Return the joint command for the next period, which begins at time t of the run [s].

        A state that the estimator calls lost (`RobotState.lost`), or a dead motor of a leg, makes the robot kneel down
        and then damps its joints, until the next `start` (`hugwbc.runtime.lowering`). Raise a ConfigError before the
        first `start`.
        """
        if not self._started:
            raise ConfigError("decide was called before the run has begun; call reset of the loop first")
        state, dt = self._check.admit(self.estimate), self.period
        self.log.count("ticks")
        mid_stance = self._mid_stance(t, state.foot_force, 1.0 / self._followed.f)
        command, self.hands = self._source.ask(t, self.estimate, dt, mid_stance=mid_stance)
        arms, command = self._solve_arms(command)
        command = self._followed = self.chain(command, state, dt, mid_stance=mid_stance)
        for sensor in state.coasted:
            self.log.count_of("readings_refused", sensor, f"readings of {sensor} refused and replaced")
        lost = state.lost or (self.motors.dead and f"the motor of {self.motors.dead} is dead")
        if lost or self._lowering.begun:
            self.log.count("lowered", f"{lost}: kneeling down")
            joints = self._lowering.command(state, dt)
            self.guard.last_tick_s = 0.0
        else:
            arms = self._arm_drive(arms, state, dt)
            joints = self.guard.act(state, command, arms)
            joints = self._handover(joints, arms, dt)
        self._last = self._limit(joints)
        self.motors.note(self._last)
        return self._last

    def _solve_arms(self, command: Command) -> tuple[UpperBody, Command]:
        """Return the arm targets, and the command as the hands need it."""
        source = self.upper_body
        if source is None:
            return self._free_arms, command
        placed, last = self._source.placed, self._last
        commanded = None if last is None else last.q[self._robot.arms]

        def answer() -> tuple[UpperBody, Command]:
            # Unpacked here, so that an answer that is no pair is a failure of the source too.
            arms, adapted = source.update(placed, self.hands, command, self.period, commanded, self._followed)
            return arms, adapted

        begin = time.perf_counter()
        moved = self.log.ask("source_failures", "the source of arm targets", answer)
        self.ik_s = time.perf_counter() - begin
        if moved is None:
            return self._free_arms, command
        # Not every source has these.
        if self.hands is not None and (refusal := getattr(source, "refusal", "")):
            self.log.count("hands_refused", f"hand targets: {refusal}")
        if not getattr(getattr(source, "solution", None), "ok", True):
            self.log.count("hands_held", "no arm posture for the hand targets: the arms hold")
        return moved


def _refuse_another(part: object, robot: Robot, does: str, advice: str) -> None:
    """Refuse a part of a robot with other joints; one without an attribute `robot` is for any robot."""
    own = getattr(part, "robot", robot)
    if isinstance(own, Robot) and own.joint_names != robot.joint_names:
        raise ConfigError(f"{does} {own.name}, which has other joints than {robot.name}; {advice}")

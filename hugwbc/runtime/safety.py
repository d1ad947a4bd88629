"""A filter around any controller that clamps or replaces bad values in both directions and counts each change."""

import dataclasses
import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from hugwbc.arm_servo import ArmServo
from hugwbc.blends import smooth_step
from hugwbc.commands import Command, CommandChange
from hugwbc.controller import Controller, JointCommand, UpperBody, check_controller, override_arms
from hugwbc.errors import ConfigError
from hugwbc.extensions import described
from hugwbc.kinematics import in_place
from hugwbc.numeric import changed
from hugwbc.robot import Robot
from hugwbc.runtime.braking import Braking
from hugwbc.runtime.feasibility import feasible
from hugwbc.runtime.lowering import Lowering
from hugwbc.runtime.motor_watch import MotorWatch
from hugwbc.runtime.payload import PayloadObserver
from hugwbc.state import RobotState

T = TypeVar("T")
_VECTORS = tuple(field.name for field in dataclasses.fields(JointCommand))
_GAINS = [_VECTORS.index(name) for name in ("kp", "kd")]
# Counters of what was clamped in the five vectors.
_LIMITED = ("positions_limited", "speeds_limited", "gains_limited", "gains_limited", "torques_limited")
# [rad], and as a part of a joint's highest speed: a drive that gives all its torque for less is a switch.
_LEAST_ERROR, _LEAST_SPEED = 0.05, 0.1
_MISTAKES = ("failures", "source_failures", "bad_outputs", "upper_body_rejected")  # of somebody else's code
HOLD_TIME = 0.1  # [s] for which the last good joint command is repeated without a new one, before the joints are damped
HANDOVER_TIME = 0.5  # [s] in which the step between the servo's and the controller's own arm command fades


@dataclasses.dataclass(frozen=True)
class SafetyReport:
    """Counts of what the filter changed since `reset`, in calls of `act`.

    Attributes:
        ticks: calls of `act`.
        commands_clamped: calls in which a command value was out of range or NaN, by command name.
        commands_guarded: calls in which the other values did not allow a command value, by command name.
        upper_body_rejected: external arm targets that were not eight finite numbers; the last good ones stayed.
        upper_body_limited: external arm targets outside the joint limits, clamped to them.
        bad_states: states with NaN or infinity, or with an orientation that is not a unit quaternion.
        bad_outputs: joint commands of the controller with NaN or infinity, or of a wrong size.
        failures: exceptions of the controller, and return values that are not joint commands or its plans.
        source_failures: exceptions of the sources of commands and arm targets, and what is not theirs to return.
        held: ticks on which the last good joint command was repeated.
        damped: ticks on which the joints were damped.
        positions_limited: joint commands with a position target that was clamped.
        torques_limited: joint commands with a feed-forward torque that was clamped.
        speeds_limited: joint commands with a velocity target that was clamped.
        gains_limited: stiffnesses, and dampings, of joint commands that were clamped to 0 or `gain_limits`.
        overruns: calls of the controller that took longer than its period.
        readings_refused: states in which the reading of a sensor was replaced, by the sensor.
        braked: ticks on which a robot braked or stood before it changed its gait (`hugwbc.runtime.braking`).
        lowered: ticks on which the robot knelt down, or was damped afterwards, with its state lost or a motor dead.
        messages: the first message of each kind of event.
    """

    ticks: int = 0
    commands_clamped: dict[str, int] = dataclasses.field(default_factory=dict)
    commands_guarded: dict[str, int] = dataclasses.field(default_factory=dict)
    upper_body_rejected: int = 0
    upper_body_limited: int = 0
    bad_states: int = 0
    bad_outputs: int = 0
    failures: int = 0
    source_failures: int = 0
    held: int = 0
    damped: int = 0
    positions_limited: int = 0
    torques_limited: int = 0
    speeds_limited: int = 0
    gains_limited: int = 0
    overruns: int = 0
    readings_refused: dict[str, int] = dataclasses.field(default_factory=dict)
    braked: int = 0
    lowered: int = 0
    messages: tuple[str, ...] = ()


def target_limits(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest position target of each joint [rad], each of shape (n,).

    A PD joint turns the distance to its target into torque. To give its full torque at a position limit, its target
    must lie torque_limit / kp beyond that limit.
    """
    margin = robot.torque_limit / robot.kp
    return robot.lower - margin, robot.upper + margin


def gain_limits(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Return the highest stiffness [N*m/rad] and damping [N*m*s/rad] of each joint, each of shape (n,).

    They give the drive's full torque for an error of 0.05 rad, or of a tenth of the joint's highest speed.
    """
    return robot.torque_limit / _LEAST_ERROR, robot.torque_limit / (_LEAST_SPEED * robot.velocity_limit)


class Handover:
    """A blend of the arm command where external control takes the arms, and where it gives them back.

    The servo of the arms and the controller drive them with other gains, and one of them carries the arms' weight by
    feed-forward torque, the other perhaps by an offset of its position targets. The step in each of the five vectors
    of the joint command is therefore added to the new command at first, which leaves the torque as it was, and fades
    over `HANDOVER_TIME`. The gains go from those before to the present ones, so that none leaves their range.

    The positions of a takeover have no step, since the targets start at the controller's own arm command
    (`hugwbc.upper_ik.Takeover`). In a hand-back they return to where that command was before the takeover; its arm
    swing may have moved on meanwhile.
    """

    def __init__(self, arms: np.ndarray) -> None:
        """Set up the blend for the joints `arms`, indices of shape (8,)."""
        self._arms, self._size = in_place(arms), arms.size
        self.reset()

    def reset(self) -> None:
        """Forget any difference."""
        self._taken: bool | None = None
        self._last: JointCommand | None = None
        self._before = self._offset = np.zeros((len(_VECTORS), self._size))
        self._elapsed = HANDOVER_TIME

    def __call__(self, command: JointCommand, upper_body: UpperBody, dt: float) -> JointCommand:
        """Return the command without a jump of the arms where `upper_body` takes or releases them.

        Args:
            command: the joint command, finite and within the limits.
            upper_body: the external control that the controller was given.
            dt: time since the last call [s].
        """
        changes = self._last is not None and self._taken is not upper_body.indicator
        self._taken = upper_body.indicator
        if changes or self._elapsed < HANDOVER_TIME:
            now = self._of_arms(command)
            if self._last is not None and changes:
                self._before, self._elapsed = self._of_arms(self._last), 0.0
                self._offset = self._before - now
            self._offset[_GAINS] = (self._before - now)[_GAINS]
            now = now + (1.0 - smooth_step(self._elapsed / HANDOVER_TIME)) * self._offset
            self._elapsed += dt
            vectors = {name: getattr(command, name).copy() for name in _VECTORS}
            for name, arms in zip(_VECTORS, now, strict=True):
                vectors[name][self._arms] = arms
            command = JointCommand(**vectors)
        self._last = command
        return command

    def _of_arms(self, command: JointCommand) -> np.ndarray:
        """Return the arms' part of the five vectors, shape (5, 8)."""
        return np.array([getattr(command, name)[self._arms] for name in _VECTORS])


class SafetyFilter:
    """A wrapper of a controller that keeps what passes in both directions within limits.

    - Commands are clamped to the range of their gait (`Command.clamp`; `command` holds the result). Combinations that
      the legs do not allow become the nearest ones that they do (`feasibility.feasible`). External arm targets are
      clamped to the joint limits.
    - A robot that moves and is told to change its gait brakes and stands first (`Braking`).
    - An unusable state (`RobotState.is_usable`), a joint command that is not finite, or an exception makes the filter
      repeat the last good joint command for `HOLD_TIME` and then damp the joints. After damping, the controller
      is reset on the first good state.
    - A state that the estimator calls lost (`RobotState.lost`), or a dead motor of a leg (`MotorWatch`, attribute
      `motors`), makes the robot kneel down and then damps its joints, until the next `reset`
      (`hugwbc.runtime.lowering`).
    - Arms under external control are driven by one servo, whatever the controller (`ArmServo`). It compensates
      the payload, which is told or estimated (`PayloadObserver`, attribute `payload`). At takeover and release of the
      arms, the step in their command fades (`Handover`).
    - Position targets are clamped to `target_limits`, velocity targets to the joints' highest speeds, gains to 0 and
      `gain_limits`, and feed-forward torques to the torque limits.
    - What is no `RobotState`, `Command` or `UpperBody` counts as one that cannot be used.
    - Every change is counted in `report()`.

    Attributes:
        strict: whether mistakes of controller and sources raise a `ConfigError` instead; for simulations only.
    """

    strict = False

    def __init__(
        self,
        controller: Controller,
        *,
        robot: Robot,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        """Wrap a controller.

        Args:
            controller: the controller; the filter takes over its `name` and `period`.
            robot: limits and gains, and the weight and friction that the arms' servo makes up for.
            clock: returns seconds, to time the controller.
        """
        self.controller = controller
        self.robot = robot
        self.name, self.period = check_controller(controller, "the controller")
        lowest, highest = target_limits(self.robot)
        speed, torque = self.robot.velocity_limit, self.robot.torque_limit
        self._high = np.array((highest, speed, *gain_limits(self.robot), torque))
        self._low = np.array((lowest, -speed, *np.zeros((2, torque.size)), -torque))
        self._arm_limits = self.robot.lower[self.robot.arms], self.robot.upper[self.robot.arms]
        self._nothing = RobotState(
            np.full(torque.size, np.nan), np.full(torque.size, np.nan), np.full(4, np.nan), np.full(3, np.nan)
        )
        self._handover = Handover(self.robot.arms)
        self.payload = PayloadObserver()
        self.motors = MotorWatch(self.robot)
        self._servo: ArmServo | None = None  # built by the first external control of the arms
        self._clock = clock
        self.command = Command()
        self._start(self.robot.nominal)

    def _start(self, q: np.ndarray) -> None:
        self._counts: dict[str, int] = {}
        self._clamped: dict[str, int] = {}
        self._guarded: dict[str, int] = {}
        self._refused: dict[str, int] = {}
        self._lowering = Lowering(self.robot)
        self.motors.reset()
        self._braking = Braking()
        self._first: dict[str, str | CommandChange] = {}  # event of each kind, in order
        self._given: Command | None = None
        self._begun = False  # whether the controller has been reset
        self._asked: Command | None = None
        self._last = JointCommand.position(self.robot, q.copy())
        self._last_upper = UpperBody.none()
        self._missing_s = 0.0
        self._handover.reset()
        self.payload.reset()

    def reset(self, state: RobotState) -> None:
        """Clear the counters and start the controller from this state."""
        state = self._valid_state(state)
        self._start(state.q if state.is_finite else self.robot.nominal)
        if state.is_usable:
            self.ask("failures", self.name, lambda: self._begin(state))

    def _valid_state(self, state: RobotState) -> RobotState:
        fits = isinstance(state, RobotState) and state.q.size == self.robot.kp.size
        return state if fits else self._nothing

    def _begin(self, state: RobotState) -> None:
        self.controller.reset(state)
        self._begun = True

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        """Return the controller's joint command within all limits, or the last good one, or damping."""
        self.last_tick_s = 0.0  # of a controller that is not called
        state = self._valid_state(state)
        joints = self._filtered(state, command, upper_body)
        self.motors.note(joints)
        return joints

    def _filtered(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        self._count("ticks")
        self.command = self._valid_command(command)
        feasible_command = self._braking(self._feasible_command(self.command), state, self.period)
        upper_body = self._valid_upper_body(upper_body)
        if self._braking.active:
            self._count("braked", "told to change the gait while moving: braking and standing first")
        for sensor in state.coasted:
            self._refused[sensor] = self._refused.get(sensor, 0) + 1
            self._first.setdefault(f"refused {sensor}", f"readings of {sensor} refused and replaced")
        lost = state.lost or (self.motors.dead and f"the motor of {self.motors.dead} is dead")
        if lost or self._lowering.begun:
            self._count("lowered", f"{lost}: kneeling down")
            return self.limited(self._lowering.command(state, self.period))
        upper_body = self.driven(upper_body, state)
        output = self._controller_output(state, feasible_command, upper_body)
        if output is None:
            filtered = self._fallback(state)
        else:
            self._missing_s = 0.0
            # A fallback repeats the command without the fade below, which is added to it.
            filtered = self._last = self.limited(override_arms(output, upper_body, self.robot))
        smooth = self._handover(filtered, upper_body, self.period)
        # The sum of a command and a difference may exceed limits that each of them keeps.
        return filtered if smooth is filtered else self.limited(smooth)

    def driven(self, upper_body: UpperBody, state: RobotState) -> UpperBody:
        """Return external arm targets with the gains and the feed-forward torque of the arm servo."""
        if self._servo is None:
            if not upper_body.indicator:
                return upper_body
            self._servo = ArmServo(robot=self.robot)
        if not state.is_usable:
            return upper_body
        return self._servo(self.payload.complete(upper_body, state, self.period), state, self.period)

    def report(self) -> SafetyReport:
        """Return the counters since `reset`."""
        return SafetyReport(
            **self._counts,
            commands_clamped=dict(self._clamped),
            commands_guarded=dict(self._guarded),
            readings_refused=dict(self._refused),
            messages=tuple(
                f"command {event}" if isinstance(event, CommandChange) else event for event in self._first.values()
            ),
        )

    def ask(self, counter: str, who: str, question: Callable[[], T]) -> T | None:
        """Return the answer of somebody else's code; count an exception, and return None."""
        try:
            return question()
        except Exception as error:  # the last line of defence of a running robot
            self._count(counter, "" if counter in self._first else f"{who} raised {described(error)}")
            return None

    def _count(self, counter: str, message: str = "") -> None:
        if self.strict and counter in _MISTAKES:
            raise ConfigError(message)
        self._counts[counter] = self._counts.get(counter, 0) + 1
        if message:
            self._first.setdefault(counter, message)

    def _count_changes(self, kind: str, counts: dict[str, int], changes: tuple[CommandChange, ...]) -> None:
        for change in changes:
            counts[change.name] = counts.get(change.name, 0) + 1
            self._first.setdefault(f"{kind} {change.name}", change)

    def _valid_command(self, command: Command) -> Command:
        if not isinstance(command, Command):
            self._count("source_failures", f"a command is a {type(command).__name__}: keeping the last good one")
            command = self._given or Command()
        if command is not self._given and command != self._given:  # most ticks repeat the last command
            self._given, self._valid = command, command.clamp()
        valid, changes = self._valid
        self._count_changes("clamp", self._clamped, changes)
        return valid

    def _feasible_command(self, command: Command) -> Command:
        if command is not self._asked and command != self._asked:
            self._asked, self._guard = command, feasible(command)
        guarded, changes = self._guard
        self._count_changes("guard", self._guarded, changes)
        return guarded

    def _valid_upper_body(self, upper_body: UpperBody) -> UpperBody:
        if upper_body is self._last_upper:  # free arms, or a source that repeats itself
            return upper_body
        if not isinstance(upper_body, UpperBody) or not upper_body.is_finite:
            self._count(
                "upper_body_rejected",
                "external arm targets are not eight finite numbers each, or the hands' loads are not finite: keeping "
                "the last good ones",
            )
            return self._last_upper
        q = _clip(upper_body.q, *self._arm_limits)
        if ((q != upper_body.q) & upper_body.mask).any():
            self._count("upper_body_limited", "external arm targets outside the joint limits: clamped")
            upper_body = changed(upper_body, q=q)
        self._last_upper = upper_body
        return upper_body

    def _controller_output(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand | None:
        """Return the controller's own joint command, or None if it gave no usable one."""
        if not state.is_usable:
            self._count("bad_states", "the state is not finite, or has no orientation: holding, then damping")
            return None
        begin = self._clock()
        answer = self.ask("failures", self.name, lambda: (self._call(state, command, upper_body),))
        self.last_tick_s = self._clock() - begin
        if self.last_tick_s > self.period:
            self._count("overruns")
        if answer is None:
            return None
        (output,) = answer
        if not isinstance(output, JointCommand):
            self._count("failures", f"act of {self.name} returned a {type(output).__name__} instead of a JointCommand")
            return None
        if not output.is_finite or output.q.size != self.robot.kp.size:
            fits = output.q.size == self.robot.kp.size
            wrong = ", ".join(n for n in _VECTORS if not (fits and np.isfinite(getattr(output, n)).all()))
            self._count(
                "bad_outputs",
                f"{self.name} gave a joint command in which {wrong} are not {self.robot.kp.size} finite numbers each",
            )
            return None
        return output

    def _call(self, state: RobotState, command: Command, upper_body: UpperBody) -> object:
        if not self._begun or self._missing_s > HOLD_TIME:
            self._begin(state)
        return self.controller.act(state, command, upper_body)

    def _fallback(self, state: RobotState) -> JointCommand:
        self._missing_s += self.period
        if self._missing_s <= HOLD_TIME:
            self._count("held")
            return self._last
        self._count("damped")
        zero = np.zeros_like(self.robot.kd)
        q = state.q if np.all(np.isfinite(state.q)) else self._last.q
        return JointCommand(q=q, dq=zero, kp=zero, kd=self.robot.kd, tau=zero)

    def limited(self, output: JointCommand) -> JointCommand:
        """Return a finite joint command within all limits, and count what was changed."""
        before = np.array((output.q, output.dq, output.kp, output.kd, output.tau))
        after = _clip(before, self._low, self._high)
        different = before != after
        if np.count_nonzero(different):  # in a fifth of the time of `any`
            for counter, joints, way in zip(_LIMITED, different, np.abs(before - after), strict=True):
                if joints.any():
                    joint = self.robot.joint_names[int(np.argmax(way))]
                    self._count(counter, f"{counter.replace('_', ' ')}, first at {joint}")
        return JointCommand(*after)


def _clip(values: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the values within bounds; `np.clip` takes three times as long."""
    return np.minimum(np.maximum(values, low), high)

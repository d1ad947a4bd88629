"""A filter around any controller: what is out of range or not finite is clamped or replaced, and counted."""

import dataclasses
import time
from collections.abc import Callable

import numpy as np

from hugwbc.commands import Command
from hugwbc.controller import Controller, JointCommand, UpperBody
from hugwbc.robot import Robot, load_robot
from hugwbc.runtime.feasibility import feasible
from hugwbc.state import RobotState


@dataclasses.dataclass(frozen=True)
class SafetyConfig:
    """Settings of the filter.

    Attributes:
        hold_s: how long the last good joint command is repeated when there is no new one, before damping [s].
        guard: whether combinations of commands that the legs do not allow are changed (`hugwbc.runtime.feasibility`).
        damping_gain: joint damping while there is nothing else to do, as a multiple of the robot's own kd.
    """

    hold_s: float = 0.1
    guard: bool = True
    damping_gain: float = 1.0


@dataclasses.dataclass(frozen=True)
class SafetyReport:
    """What the filter changed since `reset`. Counters count calls of `act`.

    Attributes:
        ticks: calls of `act`.
        commands_clamped: calls per command name whose value was out of range or NaN.
        commands_guarded: calls per command name whose value the others did not allow.
        upper_body_rejected: external arm targets that were not eight finite numbers; the last good ones stayed.
        upper_body_limited: external arm targets outside the joint limits, clamped to them.
        bad_states: states with NaN or infinity, or an orientation that is no unit quaternion.
        bad_outputs: joint commands of the controller with NaN or infinity, or of another size.
        failures: exceptions of the controller, and answers that are no joint command.
        held: ticks on which the last good joint command was repeated.
        damped: ticks on which the joints were damped.
        positions_limited: joint commands with a position target that was clamped.
        torques_limited: joint commands with a feed-forward torque that was clamped.
        overruns: calls of the controller that took longer than its period.
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
    held: int = 0
    damped: int = 0
    positions_limited: int = 0
    torques_limited: int = 0
    overruns: int = 0
    messages: tuple[str, ...] = ()


def target_limits(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest position target of each joint [rad]: its limits widened by torque_limit / kp, shape (19,)."""
    margin = robot.torque_limit / robot.kp
    return robot.lower - margin, robot.upper + margin


class SafetyFilter:
    """A controller that wraps another one and keeps what passes in both directions within limits.

    - Commands are clamped to the range of their gait (`Command.clamp`), and combinations that the legs do not allow to
      the nearest that they do (`feasibility.feasible`); `command` is the clamped one. External arm targets are clamped
      to the joint limits.
    - A state that is not usable (`RobotState.is_usable`), a joint command that is not finite, or an exception, repeats
      the last good joint command for `hold_s` seconds, then damps the joints. After damping the controller is reset on
      the first good state.
    - Position targets are clamped to the joint limits widened by torque_limit / kp: a PD joint asks for torque by the
      distance of its target, and needs that much to give its full torque at a limit. Feed-forward torques are clamped
      to the torque limits.
    - Every change is counted in `report()`.
    """

    def __init__(
        self,
        controller: Controller,
        *,
        config: SafetyConfig | None = None,
        robot: Robot | None = None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        """Wrap a controller.

        Args:
            controller: what to wrap; `name` and `period` are taken from it.
            config: settings; None for the defaults.
            robot: limits and gains; None for the H1.
            clock: seconds, to time the controller.
        """
        self.controller = controller
        self.config = config or SafetyConfig()
        self.robot = robot or load_robot()
        self.name, self.period = controller.name, controller.period
        self._q_low, self._q_high = target_limits(self.robot)
        self._clock = clock
        self.last_tick_s = 0.0
        self.command = Command()
        self._start(self.robot.nominal)

    def _start(self, q: np.ndarray) -> None:
        self._counts: dict[str, int] = {}
        self._clamped: dict[str, int] = {}
        self._guarded: dict[str, int] = {}
        self._messages: dict[str, str] = {}
        self._asked: Command | None = None
        self._last = JointCommand.position(self.robot, q.copy())
        self._last_upper = UpperBody.none()
        self._missing_s = 0.0

    def reset(self, state: RobotState) -> None:
        """Clear the counters and start the controller from this state."""
        self._start(state.q if state.is_finite else self.robot.nominal)
        if state.is_usable:
            self.controller.reset(state)

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        """The controller's joint command within all limits, or the last good one, or damping."""
        feasible_command, upper_body = self.admit(command, upper_body)
        output = self._controller_output(state, feasible_command, upper_body)
        if output is None:
            return self._fallback(state)
        self._missing_s = 0.0
        self._last = self.limited(output)
        return self._last

    def admit(self, command: Command, upper_body: UpperBody) -> tuple[Command, UpperBody]:
        """What of a command and of external arm targets reaches the controller in one tick; counts what is changed.

        The first half of `act`, for those who call the controller themselves, such as for many robots at once.
        """
        self._count("ticks")
        self.command = self._valid_command(command)
        return self._feasible_command(self.command), self._valid_upper_body(upper_body)

    def report(self) -> SafetyReport:
        """The counters since `reset`."""
        return SafetyReport(
            **self._counts,
            commands_clamped=dict(self._clamped),
            commands_guarded=dict(self._guarded),
            messages=tuple(self._messages.values()),
        )

    def _count(self, counter: str, message: str = "") -> None:
        self._counts[counter] = self._counts.get(counter, 0) + 1
        if message:
            self._messages.setdefault(counter, message)

    def _valid_command(self, command: Command) -> Command:
        valid, changes = command.clamp()
        for line in changes:
            name = line.split(" ", 1)[0]
            self._clamped[name] = self._clamped.get(name, 0) + 1
            self._messages.setdefault(f"command {name}", f"command {line}")
        return valid

    def _feasible_command(self, command: Command) -> Command:
        if not self.config.guard:
            return command
        if command != self._asked:
            self._asked, self._guard = command, feasible(command)
        guarded, changes = self._guard
        for line in changes:
            name = line.split(" ", 1)[0]
            self._guarded[name] = self._guarded.get(name, 0) + 1
            self._messages.setdefault(f"guard {name}", f"command {line}")
        return guarded

    def _valid_upper_body(self, upper_body: UpperBody) -> UpperBody:
        sizes = {np.shape(vector) for vector in (upper_body.q, upper_body.dq, upper_body.mask)}
        if sizes != {self.robot.arms.shape} or not np.all(np.isfinite((upper_body.q, upper_body.dq))):
            self._count(
                "upper_body_rejected", "external arm targets are not eight finite numbers: keeping the last good ones"
            )
            return self._last_upper
        low, high = self.robot.lower[self.robot.arms], self.robot.upper[self.robot.arms]
        q = np.clip(upper_body.q, low, high)
        if np.any((q != upper_body.q) & upper_body.mask):
            self._count("upper_body_limited", "external arm targets outside the joint limits: clamped")
            upper_body = dataclasses.replace(upper_body, q=q)
        self._last_upper = upper_body
        return upper_body

    def _controller_output(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand | None:
        """The controller's own answer, or None if there is no usable one."""
        if not state.is_usable:
            self._count("bad_states", "the state is not finite, or has no orientation: holding, then damping")
            return None
        begin = self._clock()
        try:
            if self._missing_s > self.config.hold_s:
                self.controller.reset(state)
            output = self.controller.act(state, command, upper_body)
            usable = output.is_finite and {vector.shape for vector in vars(output).values()} == {self.robot.kp.shape}
        except Exception as error:  # the last line of defence of a running robot
            self._count("failures", f"{self.name} raised {type(error).__name__}: {error}")
            output, usable = None, False
        self.last_tick_s = self._clock() - begin
        if self.last_tick_s > self.period:
            self._count("overruns")
        if output is not None and not usable:
            self._count(
                "bad_outputs",
                f"{self.name} gave a joint command that is not {self.robot.kp.size} finite numbers each: holding, then "
                "damping",
            )
        return output if usable else None

    def _fallback(self, state: RobotState) -> JointCommand:
        self._missing_s += self.period
        if self._missing_s <= self.config.hold_s:
            self._count("held")
            return self._last
        self._count("damped")
        zero = np.zeros_like(self.robot.kd)
        q = state.q if np.all(np.isfinite(state.q)) else self._last.q
        return JointCommand(q=q, dq=zero, kp=zero, kd=self.robot.kd * self.config.damping_gain, tau=zero)

    def limited(self, output: JointCommand) -> JointCommand:
        """A controller's finite joint command within all limits; counts what is changed."""
        q = np.clip(output.q, self._q_low, self._q_high)
        tau = np.clip(output.tau, -self.robot.torque_limit, self.robot.torque_limit)
        for counter, before, after in (("positions_limited", output.q, q), ("torques_limited", output.tau, tau)):
            if np.any(before != after):
                joint = self.robot.joint_names[int(np.argmax(np.abs(before - after)))]
                self._count(counter, f"{counter.replace('_', ' ')}, first at {joint}")
        return dataclasses.replace(output, q=q, tau=tau)

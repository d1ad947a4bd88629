"""The guard around a controller: whatever the controller does, there is a joint command, and its plan can be read."""

import dataclasses
import math
import time
from collections.abc import Callable

import numpy as np

from hugwbc.commands import Command
from hugwbc.controller import Controller, JointCommand, UpperBody, check_controller, override_arms
from hugwbc.numeric import floats
from hugwbc.runtime.safety import StateCheck
from hugwbc.runtime.safety_report import SafetyLog
from hugwbc.state import RobotState

HOLD_TIME = 0.1  # [s] for which the last good joint command is repeated without a new one, before the joints are damped


class Guard:
    """A controller, and what stands in for it.

    A state that cannot be used (`StateCheck`), an exception, None, or what is no finite joint command makes the guard
    repeat the last good joint command for `HOLD_TIME` and then damp the joints. After damping, the controller is reset
    on the first good state.

    Attributes:
        last_tick_s: time that the last call of the controller took [s]; 0 where it was not called.
    """

    def __init__(
        self,
        controller: Controller,
        check: StateCheck,
        limit: Callable[[JointCommand], JointCommand],
        log: SafetyLog,
    ) -> None:
        """Guard a controller of the robot that `check` knows; `limit` brings joint commands within all limits."""
        self.name, self.period = check_controller(controller, "the controller")
        self.controller, self.robot = controller, check.robot
        self._check, self._limit, self._log = check, limit, log
        self._clear(self.robot.nominal)

    def _clear(self, q: np.ndarray) -> None:
        self._begun = False  # whether the controller has been reset
        self._last = JointCommand.position(self.robot, q.copy())
        self._missing_s = self.last_tick_s = 0.0
        self._time = math.inf  # of the last call [s]

    def reset(self, state: RobotState) -> None:
        """Start the controller from this state."""
        self._clear(state.q if state.is_finite else self.robot.nominal)
        if not self._check.fault(state):
            self._log.ask("failures", self.name, lambda: self._begin(state))

    def _begin(self, state: RobotState) -> None:
        self.controller.reset(state)
        self._begun = True

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        """Return the controller's joint command within all limits, or the last good one, or damping."""
        self.last_tick_s = 0.0
        passed, self._time = state.time - self._time, state.time
        output = self._output(state, command, upper_body)
        if output is None:
            # Periods may have been left out.
            self._missing_s += passed if 1.5 * self.period < passed < math.inf else self.period
            return self._fallback(state)
        self._missing_s = 0.0
        self._last = self._limit(override_arms(output, upper_body, self.robot))
        return self._last

    def _output(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand | None:
        """Return the controller's own joint command, or None if it gave no usable one."""
        fault = self._check.fault(state)
        if fault:
            self._log.count("bad_states", f"{fault}: holding, then damping")
            return None
        begin = time.perf_counter()
        answer = self._log.ask("failures", self.name, lambda: (self._call(state, command, upper_body),))
        self.last_tick_s = time.perf_counter() - begin
        if self.last_tick_s > self.period:
            self._log.count("overruns")
        if answer is None:
            return None
        (output,), joints = answer, self.robot.kp.size
        if output is None:
            return None
        if not isinstance(output, JointCommand):
            given = f"act of {self.name} returned a {type(output).__name__} instead of a JointCommand"
            self._log.count("failures", given)
            return None
        # A controller may give the same object again with other numbers in it, and its `is_finite` is cached.
        output = JointCommand(output.q, output.dq, output.kp, output.kd, output.tau)
        if not output.is_finite or output.q.size != joints:
            fits = output.q.size == joints
            names = [field.name for field in dataclasses.fields(output)]
            wrong = ", ".join(name for name in names if not (fits and np.isfinite(getattr(output, name)).all()))
            self._log.count(
                "bad_outputs", f"{self.name} gave a joint command in which {wrong} are not {joints} finite numbers each"
            )
            return None
        return output

    def _call(self, state: RobotState, command: Command, upper_body: UpperBody) -> object:
        if not self._begun or self.damps:
            self._begin(state)
        return self.controller.act(state, command, upper_body)

    @property
    def damps(self) -> bool:
        """Whether the joints are damped for want of a usable joint command or state."""
        return self._missing_s > HOLD_TIME

    def _fallback(self, state: RobotState) -> JointCommand:
        if not self.damps:
            self._log.count("held", f"no joint command from {self.name}: holding the last one, then damping")
            return self._last
        self._log.count("damped")
        zero = np.zeros_like(self.robot.kd)
        q = state.q if np.all(np.isfinite(state.q)) else self._last.q
        return JointCommand(q=q, dq=zero, kp=zero, kd=self.robot.kd, tau=zero)

    def _planned(self, name: str, shape: tuple[int, ...]) -> np.ndarray | None:
        """Return a part of the plan, if the controller has one and gives it in its form."""
        value = self._log.ask("failures", f"{name} of {self.name}", lambda: getattr(self.controller, name, None))
        return floats(value, shape)

    @property
    def phase(self) -> float:
        """The controller's common gait phase in [0, 1); NaN without one."""
        phase = self._planned("phase", ())
        return np.nan if phase is None else float(phase)

    @property
    def footholds(self) -> np.ndarray:
        """The planned footholds, world x and y [m], shape (2, 2); NaN without a plan. The array is the caller's."""
        footholds = self._planned("footholds", (2, 2))
        return np.full((2, 2), np.nan) if footholds is None else footholds.copy()

    @property
    def planned_acceleration(self) -> np.ndarray | None:
        """The planned joint accelerations [rad/s^2], shape (n,); None without a plan."""
        return self._planned("planned_acceleration", self.robot.kp.shape)

    @property
    def stop(self) -> np.ndarray:
        """By how much a stop moves the robot, heading frame [m, m, rad], shape (3,); zeros where nothing tells."""
        stop = self._planned("stop", (3,))
        return stop if stop is not None and np.isfinite(stop).all() else np.zeros(3)

"""Integral correction of the walking velocity, once per step."""

import numpy as np

from hugwbc.mbc.params import ControllerParams

_SETTLING_STEPS = 3  # after a change of command, that do not count


class VelocityTrim:
    """Adds to the velocity plan what the last stride fell short of the command.

    The pelvis sways within a step, hence the error is averaged over two steps before it is integrated. A step during
    which the command changes does not count: the robot lags then, and a correction would overshoot. The small changes
    of a command by hand, or of one that steers by where the robot is, count as none: such a command never rests.

    Attributes:
        value: correction of v_x, v_y, heading frame [m/s], shape (2,).
    """

    def __init__(self, params: ControllerParams) -> None:
        self._gain = params.velocity_integral
        self._bound = params.velocity_integral_bound
        self._change = params.velocity_integral_change
        self._limit = params.max_velocity_trim
        self.reset()

    def reset(self) -> None:
        """No correction."""
        self.value = np.zeros(2)
        self._previous: np.ndarray | None = None
        self._wanted: list[float] | None = None
        self._before: list[float] | None = None  # what was wanted when the step began
        self._settling = 0
        self._clear()

    def _clear(self) -> None:
        self._sum = [0.0, 0.0]
        self._time = 0.0
        self._changed = False

    def measure(self, velocity: np.ndarray, wanted: np.ndarray, dt: float) -> None:
        """Record one tick: measured and commanded velocity, heading frame [m/s], shape (2,)."""
        asked = wanted.tolist()
        before = self._before = self._before or asked
        for axis, actual in enumerate(velocity.tolist()):
            self._sum[axis] += (asked[axis] - actual) * dt
            self._changed |= abs(asked[axis] - before[axis]) > self._change
        self._wanted = asked
        self._time += dt

    def end_step(self) -> None:
        """Correct by the mean error of the last two steps."""
        if self._time <= 0.0:
            return
        self._before = self._wanted
        # A larger error is a push or a start: stepping deals with it, and the integral must not wind up.
        self._settling = _SETTLING_STEPS if self._changed else max(self._settling - 1, 0)
        error = np.clip(np.array(self._sum) / self._time, -self._bound, self._bound)
        if self._settling:
            self._previous = None
            self._clear()
            return
        if self._previous is not None:
            step = self._gain * 0.5 * (error + self._previous)
            self.value = np.clip(self.value + step, -self._limit, self._limit)
        self._previous = error
        self._clear()

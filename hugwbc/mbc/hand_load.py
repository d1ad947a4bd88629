"""Forces on the hands for the QP: what is measured or estimated of them, or else what is told."""

import math

import numpy as np

from hugwbc.arm_servo import hand_loads
from hugwbc.controller import UpperBody
from hugwbc.state import RobotState

_STRONGEST = 250.0  # [N] on one hand that the controller reckons with; more is a fault of the sensors
_NONE = np.zeros((2, 3))


class HandLoad:
    """The force on each hand from outside, smooth enough for the balance.

    Forces as small as the friction of the arms' drives are not told apart from none; they fade out.

    Attributes:
        force: on the left and the right hand, world frame [N], shape (2, 3).
    """

    def __init__(self, rate: float, least: float, *, measured: bool = True) -> None:
        """Set up the filter.

        Args:
            rate: bandwidth [1/s].
            least: force up to which nothing counts [N]; from twice this force on all of it does.
            measured: whether the forces of the state count; otherwise only those that are told.
        """
        self._rate, self._least, self._measured = rate, least, measured
        self.reset()

    def reset(self) -> None:
        """Start with free hands."""
        self.force = _NONE
        self._smooth = np.zeros((2, 3))

    def update(self, state: RobotState, upper_body: UpperBody, dt: float) -> None:
        """Take in one state.

        Args:
            state: with the forces on the hands or without them; then those that `upper_body` expects count.
            upper_body: targets of the arms, with payload and wanted forces.
            dt: time since the last call [s].
        """
        seen = state.hand_force if self._measured else None
        if seen is None:
            loads = hand_loads(upper_body.hand_force, upper_body.payload)
            seen = -loads if loads.any() else _NONE
        if seen is _NONE and not self._smooth.any():
            return
        if not math.isfinite(float(seen.ravel().dot(seen.ravel()))):
            return
        share = 1.0 - math.exp(-self._rate * dt)
        bounded = np.minimum(np.maximum(seen, -_STRONGEST), _STRONGEST)
        self._smooth = self._smooth + share * (bounded - self._smooth)
        length = np.sqrt((self._smooth * self._smooth).sum(axis=1, keepdims=True))
        counts = np.minimum(np.maximum(length / self._least - 1.0, 0.0), 1.0)
        self.force = self._smooth * counts if counts.any() else _NONE

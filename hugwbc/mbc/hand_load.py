"""Forces on the hands for the QP: what is measured or estimated of them, or else what is told."""

import math

import numpy as np

from hugwbc.arm_servo import hand_loads
from hugwbc.controller import UpperBody
from hugwbc.state import RobotState

_STRONGEST = 250.0  # [N] on one hand that the controller reckons with; more is a fault of the sensors
_PROVE = 0.2  # [s]
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
        self._told, self._excess = np.zeros((2, 3)), np.zeros((2, 3))
        self._counts = 0.0

    def update(self, state: RobotState, upper_body: UpperBody, dt: float, *, stepping: bool) -> None:
        """Take in one state.

        Args:
            state: with the forces on the hands or without them; then those that `upper_body` expects count.
            upper_body: targets of the arms, with payload and wanted forces.
            dt: time since the last call [s].
            stepping: whether the robot is walking.
        """
        loads = hand_loads(upper_body.hand_force, upper_body.payload)
        told = -loads if loads.any() else _NONE
        share = 1.0 - math.exp(-self._rate * dt)
        if told is not _NONE or self._told.any():
            if math.isfinite(float(told.ravel().dot(told.ravel()))):
                self._told = self._told + share * (_bounded(told) - self._told)
        self.force = _faded(self._told, self._least)
        seen = state.hand_force if self._measured else None
        if seen is None or not math.isfinite(float(seen.ravel().dot(seen.ravel()))):
            return
        self._excess = self._excess + share * (_bounded(seen) - self._told - self._excess)
        excess = _faded(self._excess, self._least)
        if not excess.any():
            self._counts = 0.0
            return
        if stepping:
            self._counts = min(self._counts + dt / _PROVE, 1.0)
        self.force = self.force + self._counts * excess


def _bounded(force: np.ndarray) -> np.ndarray:
    return np.minimum(np.maximum(force, -_STRONGEST), _STRONGEST)


def _faded(force: np.ndarray, least: float) -> np.ndarray:
    """Return forces without those of at most `least` [N]; from twice that on they count in full."""
    if not force.any():
        return _NONE
    length = np.sqrt((force * force).sum(axis=1, keepdims=True))
    counts = np.minimum(np.maximum(length / least - 1.0, 0.0), 1.0)
    return force * counts if counts.any() else _NONE

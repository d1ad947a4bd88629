"""Desired forces and payloads of the hands, from hand targets to the arm servo."""

import math

import numpy as np

from hugwbc import rotations
from hugwbc.controller import UpperBody
from hugwbc.numeric import changed
from hugwbc.state import RobotState
from hugwbc.targets import HEAVIEST, STIFFNESS, STRONGEST, HandTargets

FORCE_RATE = 100.0  # [N/s], at which a wanted force comes and goes
PAYLOAD_RATE = 10.0  # [kg/s], likewise for a payload
_NO_TIME = 0.0


class HandLoads:
    """Desired forces, payloads and stiffness of the hands, in world axes, within their ranges and without jumps.

    A payload that is not known stays unknown. A payload that was known and no longer is falls to zero first, so that
    the torque that carried it does not stop at once.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all loads at once, for a new episode."""
        self._force = np.zeros((2, 3))
        self._payload = np.zeros(2)

    def apply(self, arms: UpperBody, hands: HandTargets | None, state: RobotState, dt: float) -> UpperBody:
        """Return the arm targets with the loads of this tick.

        Args:
            arms: targets of the arm joints.
            hands: the targets that the hands follow, which must be usable; None without any.
            state: the robot now, whose orientation turns forces to the world.
            dt: time since the last tick [s].
        """
        if hands is None and not arms.indicator:
            self.reset()
            return arms
        dt = dt if 0.0 < dt < math.inf else _NO_TIME
        known = None if hands is None else hands.payload
        self._force = _towards(self._force, _wanted(hands, state), FORCE_RATE * dt)
        payload = np.zeros(2) if known is None else np.minimum(np.maximum(known, 0.0), HEAVIEST)
        self._payload = _towards(self._payload, payload, PAYLOAD_RATE * dt)
        stiffness = (
            None if hands is None or hands.stiffness is None else min(max(hands.stiffness, STIFFNESS[0]), STIFFNESS[1])
        )
        if known is None and stiffness is None and not self._force.any() and not self._payload.any():
            return arms
        return changed(
            arms,
            hand_force=self._force.copy(),
            stiffness=stiffness,
            payload=None if known is None and not self._payload.any() else self._payload.copy(),
        )


def _wanted(hands: HandTargets | None, state: RobotState) -> np.ndarray:
    """Return the desired forces in world axes, at most `STRONGEST` [N], shape (2, 3)."""
    if hands is None or (hands.left_force is None and hands.right_force is None):
        return np.zeros((2, 3))
    force = np.minimum(np.maximum(hands.forces(), -STRONGEST), STRONGEST)
    if hands.frame == "world":
        return force
    turn = rotations.to_matrix(state.orientation) if hands.frame == "pelvis" else rotations.rotation_z(state.yaw)
    force = force @ turn.T
    return force if np.isfinite(force).all() else np.zeros((2, 3))


def _towards(now: np.ndarray, goal: np.ndarray, step: float) -> np.ndarray:
    """Return the value one step closer to a goal; each row keeps the direction of its difference."""
    gap = goal - now
    if gap.ndim == 1:
        return now + np.minimum(np.maximum(gap, -step), step)
    length = np.sqrt((gap * gap).sum(axis=1, keepdims=True))
    return now + gap * np.minimum(1.0, step / np.maximum(length, 1e-12))

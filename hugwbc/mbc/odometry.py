"""Pelvis position and velocity from the legs, for a robot without an estimator."""

import dataclasses

import numpy as np

from hugwbc.kinematics import Kinematics
from hugwbc.robot import SIDES
from hugwbc.state import RobotState


class LegOdometry:
    """Completes a state that lacks position or velocity, on the assumption that standing feet do not move.

    The velocity is minus the mean velocity of the standing soles as seen from a pelvis that does not translate; the
    position is its integral, with the height taken from the lowest standing sole on ground at z = 0.
    """

    def __init__(self) -> None:
        self._kinematics = Kinematics()
        self.reset()

    def reset(self) -> None:
        """Start again above the origin."""
        self._position = np.zeros(3)

    def complete(self, state: RobotState, contact: np.ndarray, dt: float) -> RobotState:
        """The state with position [m] and velocity [m/s] in the world; a complete state comes back as it is.

        Args:
            state: with or without position and velocity.
            contact: whether the left and the right foot stand, shape (2,), bool.
            dt: since the last call [s].
        """
        if state.position is not None and state.velocity is not None:
            return state
        self._kinematics.update(dataclasses.replace(state, position=np.zeros(3), velocity=np.zeros(3)))
        standing = [side for side, stands in zip(SIDES, contact, strict=True) if stands] or list(SIDES)
        soles = [f"{side}_sole" for side in standing]
        velocity = -np.mean([self._kinematics.velocity(sole)[:3] for sole in soles], axis=0)
        self._position += velocity * dt
        self._position[2] = -min(self._kinematics.position(sole)[2] for sole in soles)
        return dataclasses.replace(
            state,
            position=self._position.copy() if state.position is None else state.position,
            velocity=velocity if state.velocity is None else state.velocity,
        )

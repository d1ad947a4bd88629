"""Pelvis position and velocity from the legs, for a robot without an estimator."""

import dataclasses

import numpy as np
import pinocchio as pin

from hugwbc.kinematics import Kinematics
from hugwbc.robot import SIDES
from hugwbc.state import GRAVITY, RobotState


class LegOdometry:
    """Completes a state that lacks position or velocity, on the assumption that standing feet do not move.

    The velocity is minus that of a standing sole as seen from a pelvis that does not translate; of two soles, of the
    one by which the centre of mass changes its velocity less, since a foot that has just come down may still slide. The
    position is the integral, with the height taken from the lowest standing sole on ground at z = 0. While no foot
    stands, the centre of mass falls freely, and the pelvis is where and as fast as that leaves it.
    """

    def __init__(self) -> None:
        self._kinematics = Kinematics()
        self.reset()

    def reset(self) -> None:
        """Start again above the origin."""
        self._position = np.zeros(3)
        self._com, self._com_velocity = np.zeros(3), np.zeros(3)

    def complete(self, state: RobotState, contact: np.ndarray, dt: float) -> RobotState:
        """The state with position [m] and velocity [m/s] in the world; a complete state comes back as it is.

        Args:
            state: with or without position and velocity.
            contact: whether the left and the right foot stand, shape (2,), bool.
            dt: since the last call [s].
        """
        if state.position is not None and state.velocity is not None:
            return state
        kinematics = self._kinematics
        kinematics.update(dataclasses.replace(state, position=np.zeros(3), velocity=np.zeros(3)))
        com = pin.centerOfMass(kinematics.model, kinematics.data, kinematics.q, kinematics.v).copy()
        com_velocity = kinematics.data.vcom[0].copy()
        soles = [f"{side}_sole" for side, stands in zip(SIDES, contact, strict=True) if stands]
        if soles:
            told = [-kinematics.velocity(sole)[:3] for sole in soles]
            velocity = min(told, key=lambda each: float(np.sum((each + com_velocity - self._com_velocity) ** 2)))
            self._position += velocity * dt
            self._position[2] = -min(kinematics.position(sole)[2] for sole in soles)
        else:
            fallen = np.array([0.0, 0.0, GRAVITY * dt])
            self._position += self._com - com + (self._com_velocity - 0.5 * fallen) * dt
            velocity = self._com_velocity - fallen - com_velocity
        # Of the centre of mass: its place from the pelvis, and its velocity.
        self._com, self._com_velocity = com, velocity + com_velocity
        return dataclasses.replace(
            state,
            position=self._position.copy() if state.position is None else state.position,
            velocity=velocity if state.velocity is None else state.velocity,
        )

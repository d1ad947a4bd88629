"""Motion of a foot in the air."""

from typing import Literal

import numpy as np
import pinocchio as pin

from hugwbc import rotations
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.tasks.task import TaskTerms


class SwingFootTask:
    r"""Sole along a trajectory, with a pitch and a yaw; the leg has no joint for the roll.

    .. math::
        \ddot p^* = \ddot p_d + k_p (p_d - p) + k_d (\dot p_d - \dot p), \qquad
        \dot\omega^* = k_p' \log(R^T R_d) - k_d' R^T \omega

    the first in world axes [m], the second about the foot's own y and z axes [rad].

    Attributes:
        position, velocity, acceleration: p_d and its derivatives in the world, shape (3,).
        yaw, pitch: of R_d [rad].
        weight: of the five rows, shape (5,).
    """

    unit = "m, rad"
    level: Literal["position", "velocity"] = "position"

    def __init__(self, params: ControllerParams, side: str) -> None:
        self.name = f"{side} swing foot"
        self.position = np.zeros(3)
        self.velocity = np.zeros(3)
        self.acceleration = np.zeros(3)
        self.yaw = 0.0
        self.pitch = 0.0
        self._frame = f"{side}_sole"
        self._gains = params.swing_gains
        self._rotation_gains = params.swing_rotation_gains
        self.weight = np.array([*params.swing_weight, *params.swing_rotation_weight])

    def evaluate(self, dynamics: Dynamics) -> TaskTerms:
        """Five rows: x, y, z in the world, pitch and yaw in the foot."""
        foot = dynamics.frame(self._frame)
        to_foot = foot.rotation.T
        kp, kd = self._gains
        linear = self.position - foot.position
        acceleration = self.acceleration + kp * linear + kd * (self.velocity - foot.velocity[:3])
        kp, kd = self._rotation_gains
        angular = pin.log3(to_foot @ rotations.rotation_zy(self.yaw, self.pitch))
        turn = kp * angular - kd * (to_foot @ foot.velocity[3:])
        return TaskTerms(
            np.concatenate((foot.jacobian[:3], to_foot[1:] @ foot.jacobian[3:])),
            np.concatenate((foot.drift[:3], to_foot[1:] @ foot.drift[3:])),
            np.concatenate((acceleration, turn[1:])),
            self.weight,
            np.concatenate((linear, angular[1:])),
        )

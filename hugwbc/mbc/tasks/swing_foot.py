"""Motion of a foot in the air."""

from typing import Literal

import numpy as np
import pinocchio as pin

from hugwbc import rotations
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.tasks.task import TaskTerms, line_contact_rows


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
        gains, rotation_gains = params.swing_gains, params.swing_rotation_gains
        self._stiffness, self._damping = np.repeat(np.stack((gains, rotation_gains), axis=1), (3, 2), axis=1)
        self.weight = np.array([*params.swing_weight, *params.swing_rotation_weight])

    def evaluate(self, dynamics: Dynamics) -> TaskTerms:
        """Five rows: x, y, z in the world, pitch and yaw in the foot."""
        foot = dynamics.frame(self._frame)
        rows = line_contact_rows(foot.rotation)
        turn = pin.log3(foot.rotation.T.dot(rotations.rotation_zy(self.yaw, self.pitch)))
        error = np.concatenate((self.position - foot.position, turn[1:]))
        acceleration = self._stiffness * error - self._damping * rows.dot(foot.velocity)
        acceleration[:3] += self.acceleration + self._damping[:3] * self.velocity
        return TaskTerms(rows.dot(foot.jacobian), rows.dot(foot.drift), acceleration, self.weight, error)

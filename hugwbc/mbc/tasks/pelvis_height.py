"""Height of the pelvis above the ground."""

from typing import Literal

import numpy as np

from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.tasks.task import TaskTerms


class PelvisHeightTask:
    r"""Pelvis origin at a height.

    .. math:: \ddot z^* = k_p (z_d - z) + k_d (\dot z_d - \dot z)

    with z the world height of the pelvis origin [m].

    Attributes:
        target: z_d, in the world [m].
        rate: its velocity [m/s].
    """

    name = "pelvis height"
    unit = "m"
    level: Literal["position", "velocity"] = "position"

    def __init__(self, params: ControllerParams) -> None:
        self.target = 0.0
        self.rate = 0.0
        self._gains = params.height_gains
        self._weight = np.array([params.height_weight])

    def evaluate(self, dynamics: Dynamics) -> TaskTerms:
        """One row, along the world's z."""
        pelvis = dynamics.frame("pelvis")
        kp, kd = self._gains
        error = self.target - pelvis.position[2]
        acceleration = kp * error + kd * (self.rate - pelvis.velocity[2])
        return TaskTerms(
            pelvis.jacobian[2:3], pelvis.drift[2:3], np.array([acceleration]), self._weight, np.array([error])
        )

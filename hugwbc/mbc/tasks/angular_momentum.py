"""Angular momentum of the whole body."""

from typing import Literal

import numpy as np

from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.tasks.task import TaskTerms


class AngularMomentumTask:
    r"""Damped angular momentum about the centre of mass.

    .. math:: \dot k^* = -k_d\, k, \qquad k = A_G(q)\, v

    in world axes [kg m^2/s].
    """

    name = "angular momentum"
    unit = "kg m^2/s"
    level: Literal["position", "velocity"] = "velocity"

    def __init__(self, params: ControllerParams) -> None:
        self._weight = np.array(params.momentum_weight)
        self._damping = params.momentum_damping

    def evaluate(self, dynamics: Dynamics) -> TaskTerms:
        """Three rows: about the world's x, y and z."""
        return TaskTerms(
            dynamics.momentum_jacobian,
            dynamics.momentum_drift,
            -self._damping * dynamics.momentum,
            self._weight,
            -dynamics.momentum,
        )

"""Angular momentum of the whole body."""

from typing import Literal

import numpy as np

from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.tasks.task import TaskTerms


class AngularMomentumTask:
    r"""Angular momentum about the centre of mass: damped, or as a plan of contact forces has it.

    .. math:: \dot k^* = \dot k_{ff} - k_d\, k, \qquad k = A_G(q)\, v

    in world axes [kg m^2/s], with :math:`k_d = 0` under a plan.

    Attributes:
        planned: :math:`\dot k_{ff}`, world axes [N m], shape (3,); None without a plan.
    """

    name = "angular momentum"
    unit = "kg m^2/s"
    level: Literal["position", "velocity"] = "velocity"

    def __init__(self, params: ControllerParams) -> None:
        self.planned: np.ndarray | None = None
        self._weight = np.array(params.momentum_weight)
        self._planned_weight = np.array(params.planned_momentum_weight)
        self._damping = params.momentum_damping

    def evaluate(self, dynamics: Dynamics) -> TaskTerms:
        """Three rows: about the world's x, y and z."""
        return TaskTerms(
            dynamics.momentum_jacobian,
            dynamics.momentum_drift,
            -self._damping * dynamics.momentum if self.planned is None else self.planned,
            self._weight if self.planned is None else self._planned_weight,
            -dynamics.momentum,
        )

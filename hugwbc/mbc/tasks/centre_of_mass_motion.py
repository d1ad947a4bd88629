"""Motion of the centre of mass in space, as a plan of contact forces has it."""

from typing import Literal

import numpy as np

from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.tasks.task import TaskTerms


class CentreOfMassMotionTask:
    r"""Acceleration of the centre of mass in all three directions.

    .. math:: \ddot c^* = \ddot c_{ff}

    in world axes. There is no feedback: the plan is made anew, from the measured state, many times per stance.

    Attributes:
        velocity: at take-off, for the error only, in the world [m/s], shape (3,).
        feedforward: planned acceleration, in the world [m/s^2], shape (3,).
    """

    name = "motion of the centre of mass"
    unit = "m/s"
    level: Literal["position", "velocity"] = "velocity"

    def __init__(self, params: ControllerParams) -> None:
        self.velocity = np.zeros(3)
        self.feedforward = np.zeros(3)
        self._weight = np.array(params.motion_weight)

    def evaluate(self, dynamics: Dynamics) -> TaskTerms:
        """Three rows: along the world's x, y and z."""
        return TaskTerms(
            dynamics.com_jacobian,
            dynamics.com_drift,
            self.feedforward,
            self._weight,
            self.velocity - dynamics.com_velocity,
        )

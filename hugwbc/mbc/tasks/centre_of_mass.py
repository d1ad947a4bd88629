"""Horizontal motion of the centre of mass."""

from typing import Literal

import numpy as np

from hugwbc import rotations
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.tasks.task import TaskTerms


class CentreOfMassTask:
    r"""Centre of mass along and across the heading: towards a point, or with the acceleration of a plan.

    .. math:: \ddot c^* = \ddot c_{ff} + k_p (c_d - c) + k_d (0 - \dot c)

    Standing, both axes are pulled to the target. Shifting weight, the axis across follows the linear inverted pendulum,
    :math:`\ddot c_{ff} = \omega^2 (c - p_{cop})` with :math:`k_p = k_d = 0`.

    Attributes:
        target: c_d in the world [m], shape (2,).
        heading: direction of the first row [rad].
        feedforward: [m/s^2], in the heading frame, shape (2,).
        servo: 1 where the axis is pulled to the target, 0 where it only follows the feed-forward, shape (2,).
    """

    name = "centre of mass"
    unit = "m"
    level: Literal["position", "velocity"] = "position"

    def __init__(self, params: ControllerParams) -> None:
        self.target = np.zeros(2)
        self.heading = 0.0
        self.feedforward = np.zeros(2)
        self.servo = np.ones(2)
        self._weight = np.full(2, params.com_weight)
        self._gains = params.com_gains

    def evaluate(self, dynamics: Dynamics) -> TaskTerms:
        """Two rows: along the heading and to its left."""
        to_heading = rotations.rotation_z(-self.heading)[:2, :2]
        kp, kd = self._gains
        error = to_heading.dot(self.target - dynamics.com[:2])
        servo = kp * error - kd * to_heading.dot(dynamics.com_velocity[:2])
        return TaskTerms(
            to_heading.dot(dynamics.com_jacobian[:2]),
            to_heading.dot(dynamics.com_drift[:2]),
            self.feedforward + self.servo * servo,
            self._weight,
            error,
        )

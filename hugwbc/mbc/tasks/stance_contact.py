"""A foot that stands: no motion of the sole's centre line."""

import math
from typing import Literal

import numpy as np

from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.tasks.task import TaskTerms, line_contact_rows


class StanceContactTask:
    r"""Line contact: the sole's centre line, heel to toe, does not move; the foot may roll about it.

    .. math::
        \dot V^* = k_d (V_d - V) + (0, 0, 0, k_p (\theta_d - \theta), 0), \qquad V = (\dot p, \omega_y, \omega_z)

    with the velocity of the sole's centre in world axes [m/s] and the angular velocity about the foot's own y and z
    axes [rad/s]; theta is the sole's slope along its length, theta_d the ground's, toe down positive [rad]. The roll
    row is left out: the sole is 3 cm wide and the leg has no ankle roll, so that two full contacts would be redundant
    (rank 11 of 12) and one would lock the base's sway to its roll.

    Attributes:
        slope: theta_d [rad].
        settle: downward speed [m/s] of a foot that should stand but is still above the ground.
    """

    unit = "m/s, rad/s"
    level: Literal["position", "velocity"] = "velocity"

    def __init__(self, params: ControllerParams, side: str) -> None:
        self.name = f"{side} stance contact"
        self.slope = 0.0
        self.settle = 0.0
        self._frame = f"{side}_sole"
        self._damping = params.contact_damping
        self._pitch_stiffness = params.contact_pitch_stiffness
        self._weight = np.full(5, params.contact_weight)

    def evaluate(self, dynamics: Dynamics) -> TaskTerms:
        """Five rows: x, y, z in the world, pitch and yaw in the foot."""
        foot = dynamics.frame(self._frame)
        rows = line_contact_rows(foot.rotation)
        error = -rows.dot(foot.velocity)
        error[2] -= self.settle
        acceleration = self._damping * error
        slope = math.asin(min(max(-float(foot.rotation[2, 0]), -1.0), 1.0))
        acceleration[3] += self._pitch_stiffness * (self.slope - slope)
        return TaskTerms(rows.dot(foot.jacobian), rows.dot(foot.drift), acceleration, self._weight, error)

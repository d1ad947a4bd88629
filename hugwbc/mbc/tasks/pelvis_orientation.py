"""Orientation of the pelvis: roll, pitch and yaw."""

from typing import Literal

import numpy as np
import pinocchio as pin

from hugwbc import rotations
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.tasks.task import TaskTerms


class PelvisOrientationTask:
    r"""Pelvis upright but for the commanded pitch, and along the heading.

    .. math:: \dot\omega^* = k_p\, R_h^T R \log(R^T R_d) + k_d\, R_h^T (\omega_d - \omega)

    in the heading frame R_h (target yaw only), so that the rows are roll, pitch and yaw [rad].

    Attributes:
        yaw, pitch: of R_d [rad]; its roll is zero.
        yaw_rate, pitch_rate: of R_d [rad/s].
        weight: of the three rows, shape (3,).
    """

    name = "pelvis orientation"
    unit = "rad"
    level: Literal["position", "velocity"] = "position"

    def __init__(self, params: ControllerParams) -> None:
        self.yaw = 0.0
        self.pitch = 0.0
        self.yaw_rate = 0.0
        self.pitch_rate = 0.0
        self._gains = params.orientation_gains
        self.weight = np.array(params.orientation_weight)

    def evaluate(self, dynamics: Dynamics) -> TaskTerms:
        """Three rows: roll, pitch and yaw in the heading frame."""
        pelvis = dynamics.frame("pelvis")
        to_heading = rotations.rotation_z(-self.yaw)
        kp, kd = self._gains
        # R log(R^T R_d) is log(R_d R^T).
        error = to_heading.dot(pin.log3(rotations.rotation_zy(self.yaw, self.pitch).dot(pelvis.rotation.T)))
        acceleration = kp * error - kd * to_heading.dot(pelvis.velocity[3:])
        acceleration[1] += kd * self.pitch_rate
        acceleration[2] += kd * self.yaw_rate
        return TaskTerms(
            to_heading.dot(pelvis.jacobian[3:]), to_heading.dot(pelvis.drift[3:]), acceleration, self.weight, error
        )

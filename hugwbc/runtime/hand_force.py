"""Forces on the hands inferred from joint torques: the H1 has no sensors for them.

The residual of the generalised momentum (`hugwbc.runtime.contact`) low-passes the generalised external force. Its rows
of an arm's four joints hold the force f on that hand alone: r = J^T f, with the hand's Jacobian J over these joints.
Weighted least squares with a prior gives

    f = (J W J^T + 1 / s^2)^-1 J W r.

The weights W are the inverse squares of what each joint leaves unknown. The largest part of it is Coulomb friction: the
drive of a joint at rest holds any torque up to it, which motors do not show. The force of a still hand is known to
about that friction divided by its lever arm, 2 to 3 N on the H1. The prior s keeps directions out that an arm cannot
feel, such as along a stretched arm.
"""

import math

import numpy as np
import pinocchio as pin
from eigenpy import LLT

from hugwbc.kinematics import Kinematics, in_place
from hugwbc.robot import SIDES

_HANDS = len(SIDES)


RATE = 20.0  # [1/s], bandwidth of the estimate; the noise of torques and joint velocities is mostly above it
PRIOR = 60.0  # [N], standard deviation of a force before anything is known about it
TORQUE = 0.3  # [N*m], that of a joint's residual besides friction: motor constants, masses, zero positions


class HandForceObserver:
    """Estimate the force on each hand from outside, from the residual of the generalised momentum.

    A force is taken to act at the hand frame, the tip of the forearm. One that acts elsewhere on the forearm gives the
    force at the hand that loads the joints alike.

    Attributes:
        force: force on the left and the right hand, world frame [N], shape (2, 3).
    """

    def __init__(self, kinematics: Kinematics) -> None:
        """Set up for the robot of a kinematics, whose joint Jacobians are current whenever `infer` is called."""
        self._kinematics, robot = kinematics, kinematics.robot
        self._hands = [kinematics.frame_id(f"{side}_hand") for side in SIDES]
        joints = robot.arms.reshape(_HANDS, -1)
        self._arms = [in_place(columns) for columns in kinematics.columns[joints]]
        self._weights = 1.0 / (robot.friction[joints] ** 2 + TORQUE**2)
        self._prior = np.eye(3) / PRIOR**2
        self.reset()

    def reset(self) -> None:
        """Forget the past: nothing is in the hands."""
        self.force = np.zeros((_HANDS, 3))

    def infer(self, residual: np.ndarray, dt: float) -> None:
        """Take in the residual of one reading.

        Args:
            residual: generalised external force [N, N*m], shape (25,).
            dt: since the last reading [s].
        """
        model, data = self._kinematics.model, self._kinematics.data
        share = 1.0 - math.exp(-RATE * dt)
        self.force = self.force.copy()
        for force, hand, arm, weights in zip(self.force, self._hands, self._arms, self._weights, strict=True):
            jacobian = pin.getFrameJacobian(model, data, hand, pin.LOCAL_WORLD_ALIGNED)[:3, arm]
            weighted = jacobian * weights
            felt = LLT(weighted.dot(jacobian.T) + self._prior).solve(weighted.dot(residual[arm]))
            force += share * (felt - force)

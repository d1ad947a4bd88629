"""Position targets that make soft, PD-driven arms reach where they should, against their own weight."""

import numpy as np
import pinocchio as pin

from hugwbc.kinematics import pinocchio_model
from hugwbc.robot import load_robot
from hugwbc.state import RobotState


class GravityCompensation:
    """Adds to arm targets what a PD joint sags at rest: q_target = q + tau_gravity(q) / kp.

    At rest the joint's torque kp (q_target - q_measured) is then the weight's, and q_measured = q. For controllers
    that, like the learned one, drive the arms by position only; one with feed-forward torque (the QP) needs no such
    thing. With the paper's arm stiffness of 20 N*m/rad the sag is up to 0.32 rad, with an arm stretched out.
    """

    def __init__(self) -> None:
        self.robot = load_robot()
        self._model = pinocchio_model()
        self._data = self._model.createData()
        self._q = pin.neutral(self._model)
        self._columns = np.array(
            [self._model.joints[self._model.getJointId(name)].idx_v for name in self.robot.joint_names]
        )
        self._arm_columns = self._columns[self.robot.arms]
        self._kp = self.robot.kp[self.robot.arms]

    def torque(self, q_arm: np.ndarray, state: RobotState) -> np.ndarray:
        """Torques that hold the arms at rest at positions `q_arm` (8,) [rad] on this pelvis and waist: (8,) [N*m]."""
        self._q[3:6], self._q[6] = state.orientation[1:], state.orientation[0]
        self._q[self._columns + 1] = state.q
        self._q[self._arm_columns + 1] = q_arm
        return pin.computeGeneralizedGravity(self._model, self._data, self._q)[self._arm_columns]

    def __call__(self, q_arm: np.ndarray, state: RobotState) -> np.ndarray:
        """Targets for the PD joints [rad], shape (8,), within the joint limits; `q_arm` itself if a number is bad."""
        arms = self.robot.arms
        limit = self.robot.torque_limit[arms]
        torque = np.minimum(np.maximum(self.torque(q_arm, state), -limit), limit)
        targets = np.minimum(np.maximum(q_arm + torque / self._kp, self.robot.lower[arms]), self.robot.upper[arms])
        return targets if np.isfinite(targets).all() else q_arm.copy()

"""Corrections of the targets of soft, PD-driven arms against their weight and the gait's sway."""

import numpy as np
import pinocchio as pin

from hugwbc.kinematics import joint_columns, pinocchio_model
from hugwbc.robot import Robot, load_robot
from hugwbc.state import RobotState

# Damping of the arm joints instead of the robot's 0.5 [N*m*s/rad]. Shoulder yaw and elbow move little mass: with 2 they
# chatter at a control rate of 50 Hz.
SHOULDER_DAMPING, DISTAL_DAMPING = 2.0, 0.8
LARGEST_OFFSET = 0.5  # [rad], which is 10 N*m at the paper's stiffness


class GravityCompensation:
    """Compensation of the sag of a PD joint at rest: q_target = q + tau_gravity(q) / kp.

    At rest, the joint torque kp (q_target - q_measured) then equals the gravity torque, so that q_measured = q. It is
    for controllers that drive the arms by position only, such as the learned one; a controller with feed-forward
    torque (the QP) must not use it. With the paper's arm stiffness of 20 N*m/rad, a stretched arm sags by up to
    0.32 rad.
    """

    def __init__(self, robot: Robot | None = None) -> None:
        self.robot = robot or load_robot()
        self._model = pinocchio_model(self.robot)
        self._data = self._model.createData()
        self._q = pin.neutral(self._model)
        self._columns = joint_columns(self._model, self.robot)
        self._arm_columns = self._columns[self.robot.arms]
        self._kp = self.robot.kp[self.robot.arms]

    def torque(self, q_arm: np.ndarray, state: RobotState) -> np.ndarray:
        """Return the torques that hold the arms at rest at `q_arm` (8,) [rad] on this body [N*m], shape (8,)."""
        self._q[3:6], self._q[6] = state.orientation[1:], state.orientation[0]
        self._q[self._columns + 1] = state.q
        self._q[self._arm_columns + 1] = q_arm
        return pin.computeGeneralizedGravity(self._model, self._data, self._q)[self._arm_columns]

    def __call__(self, q_arm: np.ndarray, state: RobotState) -> np.ndarray:
        """Return targets for the PD joints within the limits [rad], shape (8,); `q_arm` itself if a number is bad."""
        arms = self.robot.arms
        limit = self.robot.torque_limit[arms]
        torque = np.minimum(np.maximum(self.torque(q_arm, state), -limit), limit)
        targets = np.minimum(np.maximum(q_arm + torque / self._kp, self.robot.lower[arms]), self.robot.upper[arms])
        return targets if np.isfinite(targets).all() else q_arm.copy()


class ArmDamping:
    """Additional damping of soft PD joints: q_target += (kd_wanted - kd) / kp (dq_wanted - dq).

    With the paper's arm gains (20 N*m/rad, 0.5 N*m*s/rad) a shoulder swings at about 2 Hz with a tenth of the critical
    damping. A stride is also about 2 Hz, so the sway of a walk excites the swing. Damping by the measured velocity acts
    one control period late; at this frequency it still damps.
    """

    def __init__(self, robot: Robot | None = None) -> None:
        robot = robot or load_robot()
        self._arms = robot.arms
        distal = np.array([name.endswith(("shoulder_yaw_joint", "elbow_joint")) for name in robot.arm_names])
        wanted = np.where(distal, DISTAL_DAMPING, SHOULDER_DAMPING)
        self.time = np.maximum(wanted - robot.kd[self._arms], 0.0) / robot.kp[self._arms]

    def __call__(self, dq_arm: np.ndarray, state: RobotState) -> np.ndarray:
        """Return the offset of the targets of joints that should move at `dq_arm` (8,) [rad/s]: [rad], shape (8,).

        It is at most `LARGEST_OFFSET`, and zero if a number is bad.
        """
        offset = self.time * (dq_arm - state.dq[self._arms])
        if not np.isfinite(offset).all():
            return np.zeros(8)
        return np.minimum(np.maximum(offset, -LARGEST_OFFSET), LARGEST_OFFSET)

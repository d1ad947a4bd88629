"""Position targets that make soft, PD-driven arms stay where they should, against their weight and the gait's sway."""

import numpy as np
import pinocchio as pin

from hugwbc.kinematics import joint_columns, pinocchio_model
from hugwbc.robot import load_robot
from hugwbc.state import RobotState

# Of the arm joints, in the place of the robot's 0.5 [N*m*s/rad]. Shoulder yaw and elbow move little mass: with 2 they
# chatter when called at 50 Hz.
SHOULDER_DAMPING, DISTAL_DAMPING = 2.0, 0.8
LARGEST_OFFSET = 0.5  # [rad], 10 N*m


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
        self._columns = joint_columns(self._model, self.robot)
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


class ArmDamping:
    """Adds to arm targets the damping that soft PD joints lack: q_target += (kd_wanted - kd) / kp (dq_wanted - dq).

    With the paper's arm gains (20 N*m/rad, 0.5 N*m*s/rad) a shoulder swings at about 2 Hz with a tenth of the critical
    damping, and 2 Hz is the stride: the sway of a walk rocks it up. Damping by the measured velocity takes effect a
    control period later, which at that frequency still is damping.
    """

    def __init__(self) -> None:
        robot = load_robot()
        self._arms = robot.arms
        distal = np.array([name.endswith(("shoulder_yaw_joint", "elbow_joint")) for name in robot.arm_names])
        wanted = np.where(distal, DISTAL_DAMPING, SHOULDER_DAMPING)
        self.time = np.maximum(wanted - robot.kd[self._arms], 0.0) / robot.kp[self._arms]

    def __call__(self, dq_arm: np.ndarray, state: RobotState) -> np.ndarray:
        """What to add to the targets of joints that are to move at `dq_arm` (8,) [rad/s]: [rad], shape (8,).

        At most `LARGEST_OFFSET`, and nothing where a number is bad.
        """
        offset = self.time * (dq_arm - state.dq[self._arms])
        if not np.isfinite(offset).all():
            return np.zeros(8)
        return np.minimum(np.maximum(offset, -LARGEST_OFFSET), LARGEST_OFFSET)

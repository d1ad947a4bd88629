"""The servo of the arms: gains and feed-forward torque for arms under external control, equal for every controller.

A feed-forward torque from the equation of motion makes the arm follow without the sag and lag of a PD law alone:

    tau = RNEA(q, v, a) + friction(dq_d),    torque at the joint = tau + kp (q_d - q) + kd (dq_d - dq),

with RNEA the recursive Newton-Euler algorithm (Featherstone, "Rigid Body Dynamics Algorithms", 2008) of the whole robot
at the commanded positions, velocities and accelerations of the arms. This is the usual computed-torque feed-forward of
a manipulator; teleoperation of the same robot by its maker has the same form (`xr_teleoperate`, `H1_ArmController`).
"""

import dataclasses
import math

import numpy as np
import pinocchio as pin

from hugwbc.controller import UpperBody
from hugwbc.errors import ConfigError
from hugwbc.kinematics import joint_columns, pinocchio_model
from hugwbc.robot import Robot, load_robot
from hugwbc.state import RobotState


@dataclasses.dataclass(frozen=True)
class ArmServoConfig:
    """Gains of the arm servo.

    Attributes:
        stiffness: of every arm joint [N*m/rad]; that of the maker's teleoperation of the H1 (`xr_teleoperate`,
            `kp_low`).
        shoulder_damping: of shoulder pitch and roll, which move the whole arm [N*m*s/rad]. With it a stretched arm of
            0.3 kg m^2 has three quarters of the critical damping.
        distal_damping: of shoulder yaw and elbow, which move the forearm only [N*m*s/rad]; the maker's `kd_low`.

    Raises:
        ConfigError: if a number is not finite and above 0.
    """

    stiffness: float = 140.0
    shoulder_damping: float = 10.0
    distal_damping: float = 3.0

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            if not 0.0 < getattr(self, field.name) < math.inf:
                raise ConfigError(
                    f"ArmServoConfig.{field.name} is {getattr(self, field.name)}; give a finite number above 0"
                )

    def gains(self, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
        """Return stiffness [N*m/rad] and damping [N*m*s/rad] of the arm joints, shapes (8,), read-only."""
        distal = np.array([name.endswith(("shoulder_yaw_joint", "elbow_joint")) for name in robot.arm_names])
        kp = np.full(robot.arms.size, self.stiffness)
        kd = np.where(distal, self.distal_damping, self.shoulder_damping)
        for gains in (kp, kd):  # all commands share these two arrays
            gains.setflags(write=False)
        return kp, kd


class ServoOfArms:
    """What the servo of one robot and that of many share.

    Attributes:
        config: the gains, as given.
        robot: the robot whose arms it moves.
        kp, kd: stiffness [N*m/rad] and damping [N*m*s/rad] of the arm joints, shape (8,).
    """

    def __init__(self, config: ArmServoConfig | None = None, robot: Robot | None = None) -> None:
        """Set up the servo.

        Args:
            config: gains; None for the defaults.
            robot: robot whose arms it moves, with the friction of its drives; None for the H1.
        """
        self.config = config or ArmServoConfig()
        self.robot = robot or load_robot()
        self.kp, self.kd = self.config.gains(self.robot)
        self._arms = self.robot.arms
        self._limit = self.robot.torque_limit[self._arms]

    def friction(self, dq_arm: np.ndarray) -> np.ndarray:
        """Return the friction of the robot's drives at the commanded speeds dq_arm (..., 8) [rad/s]: [N*m], (..., 8).

        The commanded speed stands for the measured one, whose noise would change the sign all the time.
        """
        speeds = np.zeros((*dq_arm.shape[:-1], len(self.robot.joint_names)))
        speeds[..., self._arms] = dq_arm
        return self.robot.friction_torque(speeds)[..., self._arms]


class ArmServo(ServoOfArms):
    """The low-level control of arms under external control.

    It turns the target motion of the arms into all five numbers that a joint drive takes. Its feed-forward torque
    carries the weight of the arms on the pelvis as it is tilted and turns now, and accelerates them as commanded. It
    has no memory: equal targets and states give equal commands. `hugwbc.arm_servo_rows` does the same for many robots.

    The acceleration of the pelvis is not known to every controller and is left to the gains. Therefore `UpperBody.ddq`
    must not contain corrections for a body that sways: an arm whose base accelerates stays behind by its own inertia.
    A torque for that motion would move it twice as far, and its reaction would drive the sway.
    """

    def __init__(self, config: ArmServoConfig | None = None, robot: Robot | None = None) -> None:
        """Set up the servo; arguments as in `ServoOfArms`."""
        super().__init__(config, robot)
        self._model = pinocchio_model(self.robot)
        self._data = self._model.createData()
        self._columns = joint_columns(self._model, self.robot)
        self._arm_columns = self._columns[self._arms]
        self._q = pin.neutral(self._model)
        self._v, self._a = np.zeros(self._model.nv), np.zeros(self._model.nv)

    def __call__(self, upper_body: UpperBody, state: RobotState, dt: float) -> UpperBody:
        """Return the targets with the servo's gains and feed-forward torque.

        The torque of the targets themselves, such as the force that a hand should exert, is added. The positions lead
        by half a control period: the command is held for the whole period, and is right in its middle.

        Args:
            upper_body: targets of the arms; joints that are not taken over are left as they are.
            state: the robot now, which must be usable (`RobotState.is_usable`).
            dt: control period [s].
        """
        if not upper_body.indicator:
            return upper_body
        tau = self.torque(upper_body.q, state, upper_body.dq, upper_body.ddq) + self.friction(upper_body.dq)
        tau = np.minimum(np.maximum(tau + upper_body.tau, -self._limit), self._limit)
        q = upper_body.q + 0.5 * dt * upper_body.dq
        if not (np.isfinite(tau).all() and np.isfinite(q).all()):
            # Targets of an absurd size overflow: hold the gains and leave out the torque.
            q, tau = upper_body.q, np.zeros(self._arms.size)
        return dataclasses.replace(upper_body, q=q, tau=tau, kp=self.kp, kd=self.kd)

    def torque(
        self,
        q_arm: np.ndarray,
        state: RobotState,
        dq_arm: np.ndarray | None = None,
        ddq_arm: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the torques that move the arms on this body as given, without friction [N*m], shape (8,).

        Args:
            q_arm: positions of the arm joints [rad], shape (8,).
            state: the robot now; its arms are replaced by the given ones.
            dq_arm: velocities [rad/s], shape (8,); None for arms and body at rest.
            ddq_arm: accelerations [rad/s^2], shape (8,); None for none.
        """
        self._q[3:6], self._q[6] = state.orientation[1:], state.orientation[0]
        self._q[self._columns + 1] = state.q
        self._q[self._arm_columns + 1] = q_arm
        if dq_arm is None:
            return pin.computeGeneralizedGravity(self._model, self._data, self._q)[self._arm_columns]
        # A constant linear velocity of the base needs no torque, so it may be left at zero.
        self._v[3:6] = state.angular_velocity
        self._v[self._columns] = state.dq
        self._v[self._arm_columns] = dq_arm
        self._a[self._arm_columns] = 0.0 if ddq_arm is None else ddq_arm
        return pin.rnea(self._model, self._data, self._q, self._v, self._a)[self._arm_columns]

"""Left-right mirror of joints, vectors, states and commands, built from joint names and axes.

Reflection in the x-z plane: the y component of a vector changes sign; an axial vector (angular velocity) keeps its y
component and changes sign in x and z. A joint's partner is the joint with the other side in its name; its sign follows
from how its axis is reflected.
"""

import dataclasses
import functools

import numpy as np

from hugwbc.commands import COMMAND_NAMES, Command
from hugwbc.robot import Robot, other_side
from hugwbc.state import RobotState

VECTOR_SIGNS = np.array([1.0, -1.0, 1.0])
AXIAL_SIGNS = np.array([-1.0, 1.0, -1.0])
# Quaternion (w, x, y, z) of the reflected body: the rotation axis is an axial vector.
QUATERNION_SIGNS = np.array([1.0, *AXIAL_SIGNS])
COMMAND_SIGNS = np.array([-1.0 if name in ("v_y", "omega", "w") else 1.0 for name in COMMAND_NAMES])


@dataclasses.dataclass(frozen=True, eq=False)
class Mirror:
    """The index and sign of every joint's mirror image: mirrored = vector[joint_index] * joint_sign.

    Attributes:
        joint_index: index of each joint's partner on the other side, shape (n,).
        joint_sign: +1 or -1, shape (n,).
    """

    joint_index: np.ndarray
    joint_sign: np.ndarray

    @classmethod
    def of(cls, robot: Robot) -> "Mirror":
        """Build the map from the robot's joint names and axes.

        A joint about y keeps its sign and a joint about x or z changes it, because the axis is an axial vector.
        """
        index = robot.indices([other_side(name) for name in robot.joint_names])
        # The mirrored joint's own axis is robot.axes[index]; the reflected axis of this joint is AXIAL_SIGNS * axis.
        sign = np.sum(AXIAL_SIGNS * robot.axes * robot.axes[index], axis=1)
        return cls(index, np.sign(sign))

    def joints(self, vector: np.ndarray) -> np.ndarray:
        """Mirror joint positions, velocities, torques or actions, shape (..., n)."""
        return vector[..., self.joint_index] * self.joint_sign

    def arms(self, vector: np.ndarray, robot: Robot) -> np.ndarray:
        """Mirror a vector of the k arm joints, shape (..., k)."""
        full = np.zeros((*vector.shape[:-1], len(robot.joint_names)))
        full[..., robot.arms] = vector
        return self.joints(full)[..., robot.arms]

    def state(self, state: RobotState) -> RobotState:
        """Mirror a robot state."""
        return dataclasses.replace(
            state,
            q=self.joints(state.q),
            dq=self.joints(state.dq),
            orientation=state.orientation * QUATERNION_SIGNS,
            angular_velocity=state.angular_velocity * AXIAL_SIGNS,
            position=None if state.position is None else state.position * VECTOR_SIGNS,
            velocity=None if state.velocity is None else state.velocity * VECTOR_SIGNS,
            foot_force=None if state.foot_force is None else state.foot_force[::-1] * VECTOR_SIGNS,
            imu_gyro=None if state.imu_gyro is None else state.imu_gyro * AXIAL_SIGNS,
            imu_accelerometer=None if state.imu_accelerometer is None else state.imu_accelerometer * VECTOR_SIGNS,
        )


def mirror_command(command: Command) -> Command:
    """Return the command whose execution is the mirror image of that of the given one."""
    return Command.from_array(command.array() * COMMAND_SIGNS, command.gait.mirrored())


@functools.cache
def load_mirror(robot: Robot) -> Mirror:
    """Return the mirror map of a robot."""
    return Mirror.of(robot)

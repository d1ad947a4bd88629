"""Left-right mirror of joints and vectors, built from joint names and axes.

Reflection in the x-z plane: the y component of a vector changes sign; an axial vector (angular velocity) keeps its y
component and changes sign in x and z. A joint's partner is the joint with the other side in its name; its sign follows
from how its axis is reflected.
"""

import dataclasses
import functools

import numpy as np

from hugwbc.commands import COMMAND_NAMES
from hugwbc.robot import Robot, other_side

VECTOR_SIGNS = np.array([1.0, -1.0, 1.0])
AXIAL_SIGNS = np.array([-1.0, 1.0, -1.0])
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

    def joints(self, vector: np.ndarray) -> np.ndarray:
        """Mirror joint positions, velocities, torques or actions, shape (..., n)."""
        return vector[..., self.joint_index] * self.joint_sign

    def arms(self, vector: np.ndarray, robot: Robot) -> np.ndarray:
        """Mirror a vector of the k arm joints, shape (..., k)."""
        full = np.zeros((*vector.shape[:-1], len(robot.joint_names)))
        full[..., robot.arms] = vector
        return self.joints(full)[..., robot.arms]


@functools.cache
def load_mirror(robot: Robot) -> Mirror:
    """Return the mirror map of a robot, from its joints' names and axes.

    A joint about y keeps its sign and a joint about x or z changes it, because the axis is an axial vector.
    """
    index = robot.indices([other_side(name) for name in robot.joint_names])
    # The mirrored joint's own axis is robot.axes[index]; the reflected axis of this joint is AXIAL_SIGNS * axis.
    sign = np.sum(AXIAL_SIGNS * robot.axes * robot.axes[index], axis=1)
    return Mirror(index, np.sign(sign))

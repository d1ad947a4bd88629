"""Indices of one robot in the state of a model that may contain other bodies."""

import dataclasses
import functools

import mujoco

from hugwbc.errors import ModelError
from hugwbc.robot import Robot

_POSE, _TWIST = 7, 6  # numbers of a free joint: position and quaternion; linear and angular velocity


@dataclasses.dataclass(frozen=True)
class Layout:
    """The robot's part of a model's state, found by the names of its joints.

    Attributes:
        qpos: pelvis position, quaternion (w, x, y, z) and joint positions in the order of `Robot.joint_names`.
        qvel: pelvis velocity, angular velocity and joint velocities in the same order.
        ctrl: the joints' actuators in the same order.
    """

    qpos: slice
    qvel: slice
    ctrl: slice

    @functools.cached_property
    def joints(self) -> slice:
        """The joint positions alone."""
        return slice(self.qpos.start + _POSE, self.qpos.stop)

    @functools.cached_property
    def rates(self) -> slice:
        """The joint velocities alone."""
        return slice(self.qvel.start + _TWIST, self.qvel.stop)


def robot_layout(model: mujoco.MjModel, robot: Robot) -> Layout:
    """Find a robot in a model.

    The state arrays are shared with the physics: a part of them is a view only if it is without gaps.

    Raises:
        ModelError: if the pelvis, a joint or an actuator is missing, if the pelvis has no free joint, or if joints and
            actuators are not next to each other in the order of `Robot.joint_names`.
    """
    try:
        root = int(model.body(robot.base).jntadr[0])
        joints = [model.joint(name) for name in robot.joint_names]
        actuators = [model.actuator(name).id for name in robot.joint_names]
    except KeyError as error:
        raise ModelError(f"the model does not hold {robot.name}: {str(error.args[0]).splitlines()[0]}") from error
    count = len(robot.joint_names)
    first_q, first_v = int(model.jnt_qposadr[root]), int(model.jnt_dofadr[root])
    first = actuators[0]
    if (
        model.jnt_type[root] != mujoco.mjtJoint.mjJNT_FREE
        or [int(joint.qposadr[0]) for joint in joints] != list(range(first_q + _POSE, first_q + _POSE + count))
        or [int(joint.dofadr[0]) for joint in joints] != list(range(first_v + _TWIST, first_v + _TWIST + count))
        or actuators != list(range(first, first + count))
    ):
        raise ModelError(
            f"the model does not hold {robot.name} in one piece: after the free joint of the pelvis, the joints and "
            "actuators must follow in the order of the robot's table; generate its XML with models/build.py"
        )
    return Layout(
        slice(first_q, first_q + _POSE + count), slice(first_v, first_v + _TWIST + count), slice(first, first + count)
    )

"""What the rewards read: a control step of many robots, and constants of the robot."""

import dataclasses
from collections.abc import Callable

import numpy as np
import torch

from hugwbc.learned.env.readings import tensor
from hugwbc.robot import Robot


@dataclasses.dataclass(frozen=True, eq=False)
class Transition:
    """What the rewards read after a control step; n robots, SI units.

    Attributes:
        command: in the order of `COMMAND_NAMES`, shape (n, 8).
        velocity: of the pelvis in the heading frame, shape (n, 3).
        angular_velocity: of the pelvis in its own frame, shape (n, 3).
        yaw_rate: about gravity, shape (n,).
        height, pitch, roll: pelvis height minus nominal, pelvis pitch and roll, shape (n,).
        q, dq, previous_dq: joint positions and velocities, shape (n, 19).
        torque: joint torques, shape (n, 19).
        action, previous_action, older_action: policy outputs, newest first, shape (n, 19).
        clearance: of both soles above the ground, shape (n, 2).
        foot_velocity, foot_force: of both soles in the world, shape (n, 2, 3).
        foot_offset: left minus right sole in the heading frame, shape (n, 3).
        target_clearance: the swing profile of both feet, shape (n, 2).
        contact: expected contact C of both feet, shape (n, 2).
        in_phase: whether both feet have the same homogenised phase, shape (n,), bool.
        intervention: the paper's I(t), shape (n,), bool.
        fallen: early termination, shape (n,), bool.
    """

    command: torch.Tensor
    velocity: torch.Tensor
    angular_velocity: torch.Tensor
    yaw_rate: torch.Tensor
    height: torch.Tensor
    pitch: torch.Tensor
    roll: torch.Tensor
    q: torch.Tensor
    dq: torch.Tensor
    previous_dq: torch.Tensor
    torque: torch.Tensor
    action: torch.Tensor
    previous_action: torch.Tensor
    older_action: torch.Tensor
    clearance: torch.Tensor
    foot_velocity: torch.Tensor
    foot_force: torch.Tensor
    foot_offset: torch.Tensor
    target_clearance: torch.Tensor
    contact: torch.Tensor
    in_phase: torch.Tensor
    intervention: torch.Tensor
    fallen: torch.Tensor


@dataclasses.dataclass(frozen=True, eq=False)
class Body:
    """Constants of the robot that the rewards read, as tensors.

    Attributes:
        nominal, lower, upper: joint positions and limits [rad], shape (19,).
        arms, hips, waist_and_legs: joint indices.
        waist: index of the waist joint.
        dt: control period [s].
    """

    nominal: torch.Tensor
    lower: torch.Tensor
    upper: torch.Tensor
    arms: torch.Tensor
    hips: torch.Tensor
    waist_and_legs: torch.Tensor
    waist: int
    dt: float

    @classmethod
    def of(cls, robot: Robot, dt: float) -> "Body":
        """The constants of a robot that is controlled every `dt` [s]."""
        others = np.setdiff1d(np.arange(len(robot.joint_names)), robot.arms)
        return cls(
            nominal=tensor(robot.nominal),
            lower=tensor(robot.lower),
            upper=tensor(robot.upper),
            arms=torch.as_tensor(robot.arms),
            hips=torch.as_tensor(robot.hip_yaw_roll),
            waist_and_legs=torch.as_tensor(others),
            waist=robot.waist,
            dt=dt,
        )


Term = Callable[[Transition, Body], torch.Tensor]

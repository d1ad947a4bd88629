"""Observations of actor and critic: layout, scales and mirror images; all arrays are torch tensors."""

import dataclasses
import functools
import math

import torch

from hugwbc import gait as gaits
from hugwbc.commands import COMMAND_NAMES
from hugwbc.gait import Gait
from hugwbc.mirror import AXIAL_SIGNS, COMMAND_SIGNS, VECTOR_SIGNS, load_mirror

JOINTS = 19
HISTORY_FRAMES = 5
PROPRIOCEPTION_SIZE = 3 + 3 + 3 * JOINTS  # angular velocity, gravity, q - nominal, dq, last action
COMMAND_SIZE = 3 + 9 + 1  # velocities, behaviour with two clocks, intervention indicator
PRIVILEGED_SIZE = 24
TERRAIN_SHAPE = (17, 13)  # samples along x and y of the heading frame
TERRAIN_SPACING = 0.07  # [m]
TERRAIN_SIZE = math.prod(TERRAIN_SHAPE)
ESTIMATE_SIZE = 3 + 2 + 1  # base velocity, both sole clearances, base height
CRITIC_SIZE = PROPRIOCEPTION_SIZE + COMMAND_SIZE + PRIVILEGED_SIZE + TERRAIN_SIZE

ANGULAR_VELOCITY_SCALE = 0.25
JOINT_VELOCITY_SCALE = 0.05
LINEAR_VELOCITY_SCALE = 2.0
LENGTH_SCALE = 5.0
FORCE_SCALE = 0.002
# Order of the command observation, with the scale that brings each command to about 1. These scales are ours: the
# authors scale l by 0.15, which hides it from the network.
COMMAND_SCALES = {"v_x": 2.0, "v_y": 2.0, "omega": 1.0, "f": 1.0, "l": 4.0, "h": 2.0, "p": 2.0, "w": 1.0}
# Half-widths of the paper's observation noise, in physical units.
NOISE_ANGULAR_VELOCITY, NOISE_GRAVITY, NOISE_Q, NOISE_DQ = 0.2, 0.05, 0.01, 1.5


@dataclasses.dataclass(frozen=True, eq=False)
class Observation:
    """The inputs of the networks, and the target of the estimator.

    Attributes:
        history: last five proprioceptive frames, oldest first, shape (n, 315).
        command: commands, gait parameters, clocks and indicator, shape (n, 13).
        critic: privileged observation, shape (n, 321).
        estimate: target of the estimator, shape (n, 6).
    """

    history: torch.Tensor
    command: torch.Tensor
    critic: torch.Tensor
    estimate: torch.Tensor


def proprioception(
    angular_velocity: torch.Tensor,
    gravity: torch.Tensor,
    q: torch.Tensor,
    dq: torch.Tensor,
    action: torch.Tensor,
) -> torch.Tensor:
    """Build one proprioceptive frame, shape (n, 63).

    Args:
        angular_velocity: angular velocity of the pelvis in its own frame [rad/s], shape (n, 3).
        gravity: unit vector of gravity in the pelvis frame, shape (n, 3).
        q: joint positions minus the nominal ones [rad], shape (n, 19).
        dq: joint velocities [rad/s], shape (n, 19).
        action: the policy's last output, shape (n, 19).
    """
    scaled = (angular_velocity * ANGULAR_VELOCITY_SCALE, gravity, q, dq * JOINT_VELOCITY_SCALE, action)
    return torch.cat(scaled, dim=1)


def noise_amplitude() -> torch.Tensor:
    """Return the half-widths of the paper's noise on a proprioceptive frame, in observation units, shape (63,)."""
    parts = (
        torch.full((3,), NOISE_ANGULAR_VELOCITY * ANGULAR_VELOCITY_SCALE),
        torch.full((3,), NOISE_GRAVITY),
        torch.full((JOINTS,), NOISE_Q),
        torch.full((JOINTS,), NOISE_DQ * JOINT_VELOCITY_SCALE),
        torch.zeros(JOINTS),
    )
    return torch.cat(parts)


@functools.cache
def command_scale() -> torch.Tensor:
    """Return the scales of the eight commands in the observation, shape (8,)."""
    return torch.tensor([COMMAND_SCALES[name] for name in COMMAND_NAMES])


def command_observation(
    command: torch.Tensor, gait: torch.Tensor, clock: torch.Tensor, indicator: torch.Tensor
) -> torch.Tensor:
    """Build the observation of commands, gait parameters, clocks and indicator, shape (n, 13).

    Order: the eight scaled commands, psi, phi_stance, left and right clock, I. Standing has phi_stance = 1 (always in
    stance), which distinguishes it from a jump at mid-stance; the other gaits have the paper's 0.5.

    Args:
        command: in the order of `COMMAND_NAMES`, shape (n, 8).
        gait: values of `Gait`, shape (n,).
        clock: clock signals of both feet, shape (n, 2).
        indicator: the paper's I(t), shape (n,), bool.
    """
    offset = torch.where(gait == Gait.WALKING, 0.5, 0.0)
    duty = torch.where(gait == Gait.STANDING, 1.0, gaits.DEFAULT_DUTY)
    extra = torch.stack((offset, duty, clock[:, 0], clock[:, 1], indicator.to(command.dtype)), dim=1)
    return torch.cat((command * command_scale(), extra), dim=1)


def estimate_target(velocity: torch.Tensor, clearance: torch.Tensor, height: torch.Tensor) -> torch.Tensor:
    """Build the target of the estimator: base velocity, sole clearances, base height, shape (n, 6).

    Args:
        velocity: velocity of the pelvis in the heading frame [m/s], shape (n, 3).
        clearance: clearance of both soles [m], shape (n, 2).
        height: pelvis height minus the nominal one [m], shape (n,).
    """
    return torch.cat((velocity * LINEAR_VELOCITY_SCALE, clearance * LENGTH_SCALE, height[:, None] * LENGTH_SCALE), 1)


def privileged(
    velocity: torch.Tensor,
    height_error: torch.Tensor,
    clearance: torch.Tensor,
    friction: torch.Tensor,
    foot_force: torch.Tensor,
    link_contact: torch.Tensor,
) -> torch.Tensor:
    """Build the privileged part of the critic's observation, shape (n, 24).

    Args:
        velocity: velocity of the pelvis in the heading frame [m/s], shape (n, 3).
        height_error: measured minus commanded height [m], shape (n,).
        clearance: clearance of both soles [m], shape (n, 2).
        friction: friction coefficient of the robot's geometry, shape (n,).
        foot_force: ground reaction on both feet [N], shape (n, 2, 3).
        link_contact: contact flags of trunk, hips, thighs, shanks, shoulders and arms, shape (n, 11), bool.
    """
    return torch.cat(
        (
            velocity * LINEAR_VELOCITY_SCALE,
            height_error[:, None] * LENGTH_SCALE,
            clearance * LENGTH_SCALE,
            friction[:, None],
            foot_force.flatten(1) * FORCE_SCALE,
            link_contact.to(velocity.dtype),
        ),
        dim=1,
    )


@functools.cache
def terrain_points() -> torch.Tensor:
    """Return the sample points of the terrain in the heading frame [m], shape (221, 2); x from -0.42 to 0.70 m."""
    x = (torch.arange(TERRAIN_SHAPE[0]) - 6) * TERRAIN_SPACING
    y = (torch.arange(TERRAIN_SHAPE[1]) - 6) * TERRAIN_SPACING
    return torch.cartesian_prod(x, y)


@functools.cache
def _mirror_maps() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    mirror = load_mirror()
    joints = torch.as_tensor(mirror.joint_index)
    signs = torch.as_tensor(mirror.joint_sign, dtype=torch.float32)
    blocks = [torch.arange(6)] + [6 + k * JOINTS + joints for k in range(3)]
    axes = torch.tensor([*AXIAL_SIGNS, *VECTOR_SIGNS], dtype=torch.float32)
    frame_index, frame_sign = torch.cat(blocks), torch.cat((axes, signs, signs, signs))
    offsets = torch.arange(HISTORY_FRAMES)[:, None] * PROPRIOCEPTION_SIZE
    return (offsets + frame_index).flatten(), frame_sign.repeat(HISTORY_FRAMES), joints, signs


@functools.cache
def _command_mirror() -> tuple[torch.Tensor, torch.Tensor]:
    index = torch.arange(COMMAND_SIZE)
    left_clock = len(COMMAND_NAMES) + 2
    index[[left_clock, left_clock + 1]] = torch.tensor([left_clock + 1, left_clock])
    return index, torch.cat((torch.as_tensor(COMMAND_SIGNS, dtype=torch.float32), torch.ones(5)))


def _on(device: torch.device, tensors: tuple[torch.Tensor, ...]) -> tuple[torch.Tensor, ...]:
    return tuple(tensor.to(device) for tensor in tensors)


def mirror_history(history: torch.Tensor) -> torch.Tensor:
    """Mirror a proprioceptive history, shape (n, 315)."""
    index, sign, _, _ = _on(history.device, _mirror_maps())
    return history.index_select(1, index) * sign


def mirror_command_observation(observation: torch.Tensor) -> torch.Tensor:
    """Mirror a command observation, shape (n, 13): lateral commands change sign, the clocks swap."""
    index, sign = _on(observation.device, _command_mirror())
    return observation.index_select(1, index) * sign


def mirror_estimate(estimate: torch.Tensor) -> torch.Tensor:
    """Mirror an output of the estimator, shape (n, 6): v_y changes sign, the soles swap."""
    mirrored = estimate[:, [0, 1, 2, 4, 3, 5]]
    mirrored[:, 1] *= -1.0
    return mirrored


def mirror_action(action: torch.Tensor) -> torch.Tensor:
    """Mirror an action, shape (n, 19)."""
    _, _, joints, signs = _on(action.device, _mirror_maps())
    return action.index_select(1, joints) * signs

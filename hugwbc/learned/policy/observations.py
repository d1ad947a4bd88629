"""Observations of actor and critic: layout, scales and mirror images; all arrays are torch tensors."""

import dataclasses
import functools
import math

import torch

from hugwbc import gait as gaits
from hugwbc.gait import Gait
from hugwbc.learned.policy.layout import (
    ANGULAR_VELOCITY_SCALE as ANGULAR_VELOCITY_SCALE,
    BIAS_SCALE as BIAS_SCALE,
    COMMAND_SCALES as COMMAND_SCALES,
    COMMAND_SIZE as COMMAND_SIZE,
    CRITIC_CORE_SIZE as CRITIC_CORE_SIZE,
    CRITIC_SIZE as CRITIC_SIZE,
    ESTIMATE_SIZE as ESTIMATE_SIZE,
    FIRST_COMMAND_SIZE as FIRST_COMMAND_SIZE,
    FORCE_SCALE as FORCE_SCALE,
    HISTORY_FRAMES as HISTORY_FRAMES,
    JOINT_VELOCITY_SCALE as JOINT_VELOCITY_SCALE,
    JOINTS as JOINTS,
    LATENCY_SCALE as LATENCY_SCALE,
    LENGTH_SCALE as LENGTH_SCALE,
    LINEAR_VELOCITY_SCALE as LINEAR_VELOCITY_SCALE,
    LOAD_SCALE as LOAD_SCALE,
    MASS_SCALE as MASS_SCALE,
    NOISE_ANGULAR_VELOCITY as NOISE_ANGULAR_VELOCITY,
    NOISE_DQ as NOISE_DQ,
    NOISE_GRAVITY as NOISE_GRAVITY,
    NOISE_Q as NOISE_Q,
    PAYLOAD_SCALE as PAYLOAD_SCALE,
    PRIVILEGED_SIZE as PRIVILEGED_SIZE,
    PROPRIOCEPTION_SIZE as PROPRIOCEPTION_SIZE,
    TERRAIN_SHAPE as TERRAIN_SHAPE,
    TERRAIN_SIZE as TERRAIN_SIZE,
    TERRAIN_SPACING as TERRAIN_SPACING,
    command_scales,
    first_layout_matrix,
)
from hugwbc.learned.policy.symmetry import SignedPermutation
from hugwbc.mirror import AXIAL_SIGNS, COMMAND_SIGNS, VECTOR_SIGNS, load_mirror
from hugwbc.robot import load_robot


@dataclasses.dataclass(frozen=True, eq=False)
class Observation:
    """The inputs of the networks, and the target of the estimator.

    Attributes:
        history: last five proprioceptive frames, oldest first, shape (n, 315).
        command: commands, gait, clocks and indicator, shape (n, 18).
        critic: privileged observation, shape (n, 342); on a plane, where all heights of the terrain are one number, it
            has that number once, shape (n, 122).
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
    return torch.from_numpy(command_scales())


def command_observation(
    command: torch.Tensor, gait: torch.Tensor, phases: torch.Tensor, indicator: torch.Tensor
) -> torch.Tensor:
    """Build the observation of commands, gait, clocks and indicator, shape (n, 18).

    Order: the eight scaled commands, one number for each gait (1 for the commanded one), sin 2 pi phi of the left and
    the right foot, cos 2 pi phi of both, I. The paper has psi and one clock per foot. Then a jump and hops on either
    leg look alike where both clocks are equal, and no clock tells phi from 0.5 - phi.

    Args:
        command: in the order of `COMMAND_NAMES`, shape (n, 8).
        gait: values of `Gait`, shape (n,).
        phases: homogenised phases of both feet, shape (n, 2).
        indicator: the paper's I(t), shape (n,), bool.
    """
    chosen = torch.nn.functional.one_hot(gait.long(), len(Gait)).to(command.dtype)
    quarter_later = torch.cos(2.0 * math.pi * phases)
    parts = (
        command * command_scale(),
        chosen,
        gaits.clock(phases),
        quarter_later,
        indicator.to(command.dtype)[:, None],
    )
    return torch.cat(parts, dim=1)


@functools.cache
def first_layout() -> torch.Tensor:
    """Return the matrix that makes the first layout of the command observation of the present one, shape (13, 18)."""
    return torch.from_numpy(first_layout_matrix())


def in_layout(observation: torch.Tensor, size: int) -> torch.Tensor:
    """Return a command observation, shape (n, 18), in the layout of a size: 18, or 13 for the first one."""
    if observation.shape[1] == size:
        return observation
    # Every row of the matrix has one entry, or is a sum of one-hot columns of which one is set: the product is exact.
    return observation @ first_layout().to(observation.device).T


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
    bias: torch.Tensor,
    load: torch.Tensor,
    body: torch.Tensor,
) -> torch.Tensor:
    """Build the privileged part of the critic's observation, shape (n, 40).

    Args:
        velocity: velocity of the pelvis in the heading frame [m/s], shape (n, 3).
        height_error: measured minus commanded height [m], shape (n,).
        clearance: clearance of both soles [m], shape (n, 2).
        friction: friction coefficient of the robot's geometry, shape (n,).
        foot_force: ground reaction on both feet [N], shape (n, 2, 3).
        link_contact: contact flags of trunk, hips, thighs, shanks, shoulders and arms, shape (n, 11), bool.
        bias: filtered errors of v_x, v_y [m/s] and omega [rad/s], which some rewards depend on, shape (n, 3).
        load: payload of the left and the right hand [kg], then the forces on the left hand, the right hand and the
            trunk in the heading frame [N], shape (n, 11).
        body: mass of the robot relative to its description, and latency [s], shape (n, 2).
    """
    payload, forces = load[:, :2], load[:, 2:]
    mass, latency = body.unbind(1)
    return torch.cat(
        (
            velocity * LINEAR_VELOCITY_SCALE,
            height_error[:, None] * LENGTH_SCALE,
            clearance * LENGTH_SCALE,
            friction[:, None],
            foot_force.flatten(1) * FORCE_SCALE,
            link_contact.to(velocity.dtype),
            bias * BIAS_SCALE,
            payload * PAYLOAD_SCALE,
            forces * LOAD_SCALE,
            (mass[:, None] - 1.0) * MASS_SCALE,
            latency[:, None] * LATENCY_SCALE,
        ),
        dim=1,
    )


@functools.cache
def terrain_points() -> torch.Tensor:
    """Return the sample points of the terrain in the heading frame [m], shape (221, 2); x from -0.42 to 0.70 m."""
    x = (torch.arange(TERRAIN_SHAPE[0]) - 6) * TERRAIN_SPACING
    y = (torch.arange(TERRAIN_SHAPE[1]) - 6) * TERRAIN_SPACING
    return torch.cartesian_prod(x, y)


# Mirror maps ----------------------------------------------------------------------------------------------------------


@functools.cache
def action_mirror() -> SignedPermutation:
    """Return the mirror map of joints and actions, n = 19."""
    mirror = load_mirror()
    return SignedPermutation(
        torch.as_tensor(mirror.joint_index), torch.as_tensor(mirror.joint_sign, dtype=torch.float32)
    )


@functools.cache
def frame_mirror() -> SignedPermutation:
    """Return the mirror map of a proprioceptive frame, n = 63."""
    pelvis = SignedPermutation.of_signs([*AXIAL_SIGNS.tolist(), *VECTOR_SIGNS.tolist()])
    return SignedPermutation.joined([pelvis, *[action_mirror()] * 3])


@functools.cache
def history_mirror() -> SignedPermutation:
    """Return the mirror map of a history, n = 315."""
    return SignedPermutation.joined([frame_mirror()] * HISTORY_FRAMES)


@functools.cache
def command_mirror() -> SignedPermutation:
    """Return the mirror map of a command observation, n = 18: hops change legs, clocks change feet."""
    commands = SignedPermutation.of_signs(COMMAND_SIGNS.tolist())
    gait = SignedPermutation(
        torch.tensor([int(Gait(value).mirrored()) for value in range(len(Gait))]), torch.ones(len(Gait))
    )
    clock = SignedPermutation.swapped([1.0])
    return SignedPermutation.joined([commands, gait, clock, clock, SignedPermutation.of_signs([1.0])])


@functools.cache
def estimate_mirror() -> SignedPermutation:
    """Return the mirror map of an output of the estimator, n = 6: v_y changes sign, the soles swap."""
    same = SignedPermutation.of_signs([1.0])
    velocity = SignedPermutation.of_signs(VECTOR_SIGNS.tolist())
    return SignedPermutation.joined([velocity, SignedPermutation.swapped([1.0]), same])


@functools.cache
def critic_mirror() -> SignedPermutation:
    """Return the mirror map of the critic's observation without the terrain, n = 121."""
    vector, same = VECTOR_SIGNS.tolist(), SignedPermutation.of_signs([1.0])
    forces = SignedPermutation.swapped(vector)
    privileged_parts = [
        SignedPermutation.of_signs(vector),
        same,
        SignedPermutation.swapped([1.0]),
        same,
        forces,
        _link_mirror(),
        SignedPermutation.of_signs([1.0, -1.0, -1.0]),
        SignedPermutation.swapped([1.0]),
        forces,
        SignedPermutation.of_signs(vector),
        same,
        same,
    ]
    return SignedPermutation.joined([frame_mirror(), command_mirror(), *privileged_parts])


def _link_mirror() -> SignedPermutation:
    names = list(load_robot().contact_links)
    swap = {"left": "right", "right": "left"}
    partners = ["_".join([swap.get(part, part) for part in name.split("_")]) for name in names]
    return SignedPermutation(torch.tensor([names.index(name) for name in partners]), torch.ones(len(names)))


@functools.cache
def terrain_mirror() -> SignedPermutation:
    """Return the mirror map of the terrain's samples, n = 221: y changes sign."""
    index = torch.arange(TERRAIN_SIZE).view(TERRAIN_SHAPE).flip(1).flatten()
    return SignedPermutation(index, torch.ones(TERRAIN_SIZE))


def mirror_history(history: torch.Tensor) -> torch.Tensor:
    """Mirror a proprioceptive history, shape (n, 315)."""
    return history_mirror()(history)


def mirror_command_observation(observation: torch.Tensor) -> torch.Tensor:
    """Mirror a command observation, shape (n, 18): lateral commands change sign, hopping legs and clocks swap."""
    return command_mirror()(observation)


def mirror_estimate(estimate: torch.Tensor) -> torch.Tensor:
    """Mirror an output of the estimator, shape (n, 6): v_y changes sign, the soles swap."""
    return estimate_mirror()(estimate)


def mirror_action(action: torch.Tensor) -> torch.Tensor:
    """Mirror an action, shape (n, 19)."""
    return action_mirror()(action)

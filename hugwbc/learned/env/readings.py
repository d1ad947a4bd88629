"""The simulation's state as float32 tensors, with the derived quantities that rewards and observations share."""

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
import torch

from hugwbc.learned.env.rough_ground import RoughGround
from hugwbc.sim.batch import BatchSimulation

if TYPE_CHECKING:
    from hugwbc.learned.env.transition import Transition

TRACKED = ("v_x", "v_y", "omega", "h", "p", "w")  # the commands whose execution shows at once
CONTACT_THRESHOLD = 5.0  # [N], above which a foot is on the ground


def tensor(array: np.ndarray) -> torch.Tensor:
    """A float32 copy of an array."""
    return torch.from_numpy(np.ascontiguousarray(array, dtype=np.float32))


@dataclasses.dataclass(frozen=True, eq=False)
class Readings:
    """State of n robots after a control step; SI units. The heading frame turns with the pelvis' yaw only.

    Attributes:
        q, dq: joint positions and velocities, shape (n, 19).
        torque: joint torques of the last physics step, shape (n, 19).
        angular_velocity: of the pelvis in its own frame, shape (n, 3).
        gravity: unit vector of gravity in the pelvis frame, shape (n, 3).
        roll, pitch: of the pelvis, shape (n,).
        position: of the pelvis in the world, shape (n, 3).
        heading: its yaw, shape (n,).
        velocity: of the pelvis in the heading frame, shape (n, 3).
        yaw_rate: about gravity, shape (n,).
        height: of the pelvis above the ground below it, minus the nominal one, shape (n,).
        clearance: of both soles above the ground below each, shape (n, 2).
        foot_offset: left minus right sole in the heading frame, shape (n, 3).
        foot_velocity: of both soles in the world, shape (n, 2, 3).
        foot_force: ground reaction on both feet in the world, shape (n, 2, 3).
        link_force: contact force magnitude on `Robot.contact_links`, shape (n, 11).
    """

    q: torch.Tensor
    dq: torch.Tensor
    torque: torch.Tensor
    angular_velocity: torch.Tensor
    gravity: torch.Tensor
    roll: torch.Tensor
    pitch: torch.Tensor
    position: torch.Tensor
    heading: torch.Tensor
    velocity: torch.Tensor
    yaw_rate: torch.Tensor
    height: torch.Tensor
    clearance: torch.Tensor
    foot_offset: torch.Tensor
    foot_velocity: torch.Tensor
    foot_force: torch.Tensor
    link_force: torch.Tensor


def read(simulation: BatchSimulation, ground: RoughGround | None = None) -> Readings:
    """Copy the current state of all robots of a batch, which stand on the given ground or on a plane."""
    qpos, qvel = tensor(simulation.qpos), tensor(simulation.qvel)
    w, x, y, z = torch.nn.functional.normalize(qpos[:, 3:7], dim=1).unbind(1)
    heading = torch.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    # Minus the third row of the rotation matrix: the world's down direction seen from the pelvis.
    gravity = -torch.stack((2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)), dim=1)
    angular_velocity = qvel[:, 3:6]
    soles = tensor(simulation.sole_position())
    height, clearance = qpos[:, 2] - simulation.robot.nominal_height, soles[..., 2]
    if ground is not None:
        height = height - ground.height_at(qpos[:, :2])
        clearance = clearance - ground.height_at(soles[..., :2])
    return Readings(
        q=qpos[:, 7:],
        dq=qvel[:, 6:],
        torque=tensor(simulation.torque),
        angular_velocity=angular_velocity,
        gravity=gravity,
        roll=torch.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        pitch=torch.asin((2.0 * (w * y - x * z)).clamp(-1.0, 1.0)),
        position=qpos[:, :3],
        heading=heading,
        velocity=_to_heading(qvel[:, :3], heading),
        # World z component of the angular velocity: its projection on the up direction, which is minus gravity.
        yaw_rate=-(gravity * angular_velocity).sum(1),
        height=height,
        clearance=clearance,
        foot_offset=_to_heading(soles[:, 0] - soles[:, 1], heading),
        foot_velocity=tensor(simulation.sole_velocity()),
        foot_force=tensor(simulation.foot_force()),
        link_force=tensor(simulation.link_force()),
    )


def tracked(r: "Readings | Transition", waist: int) -> torch.Tensor:
    """What robots execute of the commands `TRACKED`, from their readings or from a transition, shape (n, 6).

    Args:
        r: the state.
        waist: index of the waist joint.
    """
    return torch.stack((r.velocity[:, 0], r.velocity[:, 1], r.yaw_rate, r.height, r.pitch, r.q[:, waist]), dim=1)


def _to_heading(vector: torch.Tensor, heading: torch.Tensor) -> torch.Tensor:
    cos, sin = heading.cos(), heading.sin()
    x, y, z = vector.unbind(1)
    return torch.stack((cos * x + sin * y, cos * y - sin * x, z), dim=1)


def feet_on_ground(foot_force: torch.Tensor) -> torch.Tensor:
    """Which feet carry more than `CONTACT_THRESHOLD`, shape (n, 2), bool; forces on both feet [N], shape (n, 2, 3)."""
    return foot_force.square().sum(2) > CONTACT_THRESHOLD**2

"""Data that rewards and observations read: the state of the simulation and a control step, as float32 tensors.

Quantities are in SI units. The heading frame has its origin at the pelvis and turns with the pelvis' yaw only.
"""

import dataclasses

import numpy as np
import torch

from hugwbc.commands import COMMAND_NAMES, MEASURED_NAMES
from hugwbc.gait import held
from hugwbc.learned.env.rough_ground import RoughGround
from hugwbc.learned.policy.critic_observations import Observation
from hugwbc.robot import Robot
from hugwbc.sim.batch import RobotBatch
from hugwbc.sim.engine import FALL_HEIGHT, FALL_PITCH, FALL_ROLL

BIAS_TIME = 0.5  # [s], time constant of the filter of velocity errors
CONTACT_THRESHOLD = 5.0  # [N], above which a foot counts as on the ground
_MEASURED_COLUMNS = [COMMAND_NAMES.index(name) for name in MEASURED_NAMES]


def tensor(values: np.ndarray | torch.Tensor, device: torch.device | None = None) -> torch.Tensor:
    """Copy numbers to a float32 tensor."""
    if isinstance(values, torch.Tensor):
        return values.to(torch.float32, copy=True)
    return torch.tensor(values, dtype=torch.float32, device=device)


@dataclasses.dataclass(frozen=True, eq=False)
class Readings:
    """State of n robots after a control step.

    Attributes:
        q, dq: joint positions and velocities, shape (n, joints).
        torque: joint torques of the last physics step, shape (n, joints).
        angular_velocity: of the pelvis in its own frame, shape (n, 3).
        gravity: unit vector of gravity in the pelvis frame, shape (n, 3).
        roll, pitch: of the pelvis, shape (n,).
        position: of the pelvis in the world, shape (n, 3).
        heading: yaw of the pelvis, shape (n,).
        velocity: of the pelvis in the heading frame, shape (n, 3).
        yaw_rate: about gravity, shape (n,).
        height: of the pelvis above the ground below it, minus the nominal height, shape (n,).
        clearance: of both soles above the ground below each, shape (n, 2).
        foot_offset: left minus right sole in the heading frame, shape (n, 3).
        foot_velocity: of both soles in the world, shape (n, 2, 3).
        foot_force: ground reaction on both feet in the world, shape (n, 2, 3).
        link_force: magnitude of the contact force on each of `Robot.contact_links`, shape (n, links).
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


@dataclasses.dataclass(frozen=True, eq=False)
class Transition(Readings):
    """A control step of n robots, as the rewards read it: their state after it, and what led there.

    Attributes:
        command: in the order of `COMMAND_NAMES`, shape (n, 8).
        gait: values of `Gait`, shape (n,).
        bias: errors of v_x, v_y and omega, filtered over `BIAS_TIME`, shape (n, 3).
        previous_dq: joint velocities one step before, shape (n, joints).
        action, previous_action, older_action: last three policy outputs, newest first, shape (n, joints).
        touch_down: whether each foot came to the ground in this step, shape (n, 2), bool.
        descent: downward speed of each sole one step before, shape (n, 2).
        target_clearance: swing profile of both feet, shape (n, 2).
        contact: expected contact C of both feet, shape (n, 2).
        bounce: height and vertical speed of jumps and hops by the clock (`hugwbc.gait.bounce`), shape (n, 2).
        in_phase: whether both feet have the same phase, shape (n,), bool.
        intervention: the paper's I(t), shape (n,), bool.
        fallen: whether the episode ends early, by a fall or a simulation that diverged, shape (n,), bool.
    """

    command: torch.Tensor
    gait: torch.Tensor
    bias: torch.Tensor
    previous_dq: torch.Tensor
    action: torch.Tensor
    previous_action: torch.Tensor
    older_action: torch.Tensor
    touch_down: torch.Tensor
    descent: torch.Tensor
    target_clearance: torch.Tensor
    contact: torch.Tensor
    bounce: torch.Tensor
    in_phase: torch.Tensor
    intervention: torch.Tensor
    fallen: torch.Tensor


@dataclasses.dataclass(frozen=True, eq=False)
class StepResult:
    """Outcome of a control step.

    Attributes:
        reward: sum of the weighted terms, shape (n,).
        terminated: whether the episode ended with a fall, or with a simulation that diverged, shape (n,), bool.
        truncated: whether it only ran out of time, shape (n,), bool.
        final: observations of the robots whose episode ended, in the order of their indices, before their reset.
        disturbed: whether something happened to each robot in the step that was not its doing (a new command, a push, a
            force or an intervention that began or ended), shape (n,), bool.
    """

    reward: torch.Tensor
    terminated: torch.Tensor
    truncated: torch.Tensor
    final: Observation
    disturbed: torch.Tensor

    @property
    def done(self) -> torch.Tensor:
        """Whether the episode ended, shape (n,), bool."""
        return self.terminated | self.truncated


@dataclasses.dataclass(frozen=True, eq=False)
class Body:
    """Constants of the robot that the rewards read, as tensors.

    Attributes:
        nominal, lower, upper: nominal joint positions and their limits [rad], shape (joints,).
        arms, held, hips, waist_and_legs: indices of joints; `held` are those in no chain, such as a G1's waist roll and
            pitch, and `waist_and_legs` are all but the arms.
        waist: index of the waist joint.
        dt: control period [s].
    """

    nominal: torch.Tensor
    lower: torch.Tensor
    upper: torch.Tensor
    arms: torch.Tensor
    held: torch.Tensor
    hips: torch.Tensor
    waist_and_legs: torch.Tensor
    waist: int
    dt: float

    @classmethod
    def of(cls, robot: Robot, dt: float, device: torch.device | None = None) -> "Body":
        """Collect the constants of a robot that is controlled every `dt` [s], on a device."""
        others = np.setdiff1d(np.arange(len(robot.joint_names)), robot.arms)
        return cls(
            nominal=tensor(robot.nominal, device),
            lower=tensor(robot.lower, device),
            upper=tensor(robot.upper, device),
            arms=torch.as_tensor(robot.arms, device=device),
            held=torch.as_tensor(robot.held, device=device),
            hips=torch.as_tensor(robot.hip_yaw_roll, device=device),
            waist_and_legs=torch.as_tensor(others, device=device),
            waist=robot.waist,
            dt=dt,
        )


def read(simulation: RobotBatch, ground: RoughGround | None = None) -> Readings:
    """Copy the current state of all robots of a batch, on rough ground or on a plane at height zero."""
    qpos, qvel = tensor(simulation.qpos), tensor(simulation.qvel)
    w, x, y, z = torch.nn.functional.normalize(qpos[:, 3:7], dim=1).unbind(1)
    heading = torch.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    # Minus the third row of the rotation matrix: the world's down direction seen from the pelvis.
    gravity = -torch.stack((2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)), dim=1)
    # MuJoCo stores a free joint's linear velocity in the world and its angular velocity in the body's frame.
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
        # Rounding can take the argument of asin beyond 1, where it would give NaN.
        pitch=torch.asin((2.0 * (w * y - x * z)).clamp(-1.0, 1.0)),
        position=qpos[:, :3],
        heading=heading,
        velocity=to_heading(qvel[:, :3], heading),
        # World z component of the angular velocity: its projection on the up direction, which is minus gravity.
        yaw_rate=-(gravity * angular_velocity).sum(1),
        height=height,
        clearance=clearance,
        foot_offset=to_heading(soles[:, 0] - soles[:, 1], heading),
        foot_velocity=tensor(simulation.sole_velocity()),
        foot_force=tensor(simulation.foot_force()),
        link_force=tensor(simulation.link_force()),
    )


def has_fallen(readings: Readings, robot: Robot) -> torch.Tensor:
    """Return whether robots are inclined too far or their pelvis is too low, which ends an episode, shape (n,), bool.

    The paper also ends episodes at contacts of the trunk. Before one of the limits here is passed, only the robot's
    own arms touch the trunk, moved by the intervention. That is not a fall, and the policy cannot avoid it.
    """
    tilted = (readings.pitch.abs() > FALL_PITCH) | (readings.roll.abs() > FALL_ROLL)
    return tilted | (readings.height + robot.nominal_height < FALL_HEIGHT * robot.nominal_height)


def held_foot_down(readings: Readings, gait: torch.Tensor) -> torch.Tensor:
    """Return whether the held foot of a hopping robot is on the ground, shape (n,), bool."""
    return (held(gait) & feet_on_ground(readings.foot_force)).any(1)


def to_heading(vector: torch.Tensor, heading: torch.Tensor) -> torch.Tensor:
    """Return vectors of the world, shape (..., 3), in frames that are turned by a heading [rad], shape (...)."""
    cos, sin = heading.cos(), heading.sin()
    x, y, z = vector.unbind(-1)
    return torch.stack((cos * x + sin * y, cos * y - sin * x, z), dim=-1)


def command_errors(s: Readings, command: torch.Tensor, waist: int) -> torch.Tensor:
    """Return the absolute errors of `MEASURED_NAMES`, shape (n, 6), under commands, (n, 8), given the waist's index."""
    measured = s.velocity[:, 0], s.velocity[:, 1], s.yaw_rate, s.height, s.pitch, s.q[:, waist]
    return (torch.stack(measured, dim=1) - command[:, _MEASURED_COLUMNS]).abs()


def feet_on_ground(foot_force: torch.Tensor) -> torch.Tensor:
    """Return which feet meet a force of more than `CONTACT_THRESHOLD`, shape (n, 2), bool.

    Args:
        foot_force: ground reaction on both feet [N], shape (n, 2, 3).
    """
    return foot_force.square().sum(2) > CONTACT_THRESHOLD**2

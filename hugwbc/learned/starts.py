"""Where episodes start: near the nominal pose; on one leg, for hopping."""

import functools

import numpy as np
import torch

from hugwbc.gait import Gait
from hugwbc.learned.command_sampling import uniform
from hugwbc.learned.ground import RoughGround
from hugwbc.learned.readings import tensor
from hugwbc.mirror import load_mirror
from hugwbc.robot import load_robot

START_JOINT_NOISE = 0.1  # [rad], half-width at the start of an episode
START_VELOCITY = 0.3  # [m/s] and [rad/s], half-width of the pelvis' velocities at the start
# The whole robot leans over its left leg, whose hip brings the foot further in, below the centre of mass; the right
# leg is folded. Nearly balanced, so that there is time for a first hop.
_LEAN = 0.1  # [rad]
_LEFT_STANCE = {
    "left_hip_roll_joint": -0.14,
    "right_hip_pitch_joint": -0.4,
    "right_knee_joint": 0.8,
    "right_ankle_joint": -0.3,
}


@functools.cache
def _offsets(gait: Gait) -> tuple[float, np.ndarray]:
    robot = load_robot()
    joints = np.zeros(len(robot.joint_names))
    for name, offset in _LEFT_STANCE.items():
        joints[robot.index(name)] = offset
    return (-_LEAN, joints) if gait is Gait.HOPPING_LEFT else (_LEAN, load_mirror().joints(joints))


def stand_on_one_leg(qpos: np.ndarray, gait: Gait) -> np.ndarray:
    """Positions of robots that stand on both legs, upright, changed to a stand on the leg that is to hop.

    Args:
        qpos: pelvis position, quaternion (w, x, y, z) of a yaw only, joint positions, shape (k, 26).
        gait: hopping on the left or on the right leg.
    """
    roll, joints = _offsets(gait)
    qpos = qpos.copy()
    cos, sin = np.cos(roll / 2.0), np.sin(roll / 2.0)
    w, z = qpos[:, 3].copy(), qpos[:, 6].copy()
    qpos[:, 3:7] = np.stack((w * cos, w * sin, z * sin, z * cos), axis=1)
    qpos[:, 7:] += joints
    return qpos


def draw_starts(
    nominal: np.ndarray, robots: torch.Tensor, ground: RoughGround | None, generator: torch.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities of robots that start: nominal with noise, a random heading, and a push of the pelvis.

    Args:
        nominal: pelvis position above the origin, quaternion (w, x, y, z), joint positions, shape (26,).
        robots: indices, shape (k,).
        ground: on whose levels they start; None for a plane, where all start at the origin.
        generator: of the draws.

    Returns:
        Positions as `nominal`, shape (k, 26); velocities, shape (k, 25), zero in the joints.
    """
    count = robots.numel()
    yaw = uniform(generator, count, -np.pi, np.pi).numpy()
    qpos = np.tile(nominal, (count, 1))
    qpos[:, 3], qpos[:, 6] = np.cos(yaw / 2.0), np.sin(yaw / 2.0)
    joints = len(nominal) - 7
    qpos[:, 7:] += _symmetric(generator, count, joints, START_JOINT_NOISE)
    if ground is not None:
        sample = torch.rand((count, 2), generator=generator)
        qpos[:, :3] += ground.starts(robots, tensor(yaw), sample).numpy()
    qvel = np.zeros((count, 6 + joints))
    qvel[:, :6] = _symmetric(generator, count, 6, START_VELOCITY)
    return qpos, qvel


def _symmetric(generator: torch.Generator, rows: int, columns: int, half_width: float) -> np.ndarray:
    sample = torch.rand((rows, columns), generator=generator)
    return (half_width * (2.0 * sample - 1.0)).numpy()

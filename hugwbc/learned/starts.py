"""Where episodes start: on one leg, for hopping."""

import functools

import numpy as np

from hugwbc.gait import Gait
from hugwbc.mirror import load_mirror
from hugwbc.robot import load_robot

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

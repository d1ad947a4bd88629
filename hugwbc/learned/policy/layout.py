"""Sizes, order and scales of what a policy network reads and returns; nothing of it needs torch."""

import functools
import math

import numpy as np

from hugwbc import gait as gaits
from hugwbc.commands import COMMAND_NAMES
from hugwbc.gait import Gait

JOINTS = 19
HISTORY_FRAMES = 5
PROPRIOCEPTION_SIZE = 3 + 3 + 3 * JOINTS  # angular velocity, gravity, q - nominal, dq, last action
COMMAND_SIZE = 8 + len(Gait) + 4 + 1  # commands, one of the gaits, two clocks of each foot, intervention indicator
FIRST_COMMAND_SIZE = 8 + 2 + 2 + 1  # of the first layout: psi and phi_stance for the gait, one clock of each foot
PRIVILEGED_SIZE = 24 + 16
TERRAIN_SHAPE = (17, 13)  # samples along x and y of the heading frame
TERRAIN_SPACING = 0.07  # [m]
TERRAIN_SIZE = math.prod(TERRAIN_SHAPE)
ESTIMATE_SIZE = 3 + 2 + 1  # base velocity, both sole clearances, base height
CRITIC_CORE_SIZE = PROPRIOCEPTION_SIZE + COMMAND_SIZE + PRIVILEGED_SIZE  # what is left of it without the terrain
CRITIC_SIZE = CRITIC_CORE_SIZE + TERRAIN_SIZE

ANGULAR_VELOCITY_SCALE = 0.25
JOINT_VELOCITY_SCALE = 0.05
LINEAR_VELOCITY_SCALE = 2.0
LENGTH_SCALE = 5.0
FORCE_SCALE = 0.002
BIAS_SCALE, PAYLOAD_SCALE, LOAD_SCALE, MASS_SCALE, LATENCY_SCALE = 5.0, 0.25, 0.02, 5.0, 50.0
# Order of the command observation, with the scale that brings each command to about 1. These scales are ours: the
# authors scale l by 0.15, which hides it from the network.
COMMAND_SCALES = {"v_x": 2.0, "v_y": 2.0, "omega": 1.0, "f": 1.0, "l": 4.0, "h": 2.0, "p": 2.0, "w": 1.0}
# Half-widths of the paper's observation noise, in physical units.
NOISE_ANGULAR_VELOCITY, NOISE_GRAVITY, NOISE_Q, NOISE_DQ = 0.2, 0.05, 0.01, 1.5

# Widths of the policy's layers.
LATENT_SIZE = 32
ACTION_SIZE = JOINTS
ENCODER_HIDDEN = (256, 128)
ESTIMATOR_HIDDEN = (64, 32)
POLICY_HIDDEN = (256, 128, 64)

_GAIT, _CLOCK = len(COMMAND_NAMES), len(COMMAND_NAMES) + len(Gait)  # first columns


@functools.cache
def command_scales() -> np.ndarray:
    """Return the scales of the eight commands in the observation, shape (8,), float32."""
    return np.array([COMMAND_SCALES[name] for name in COMMAND_NAMES], dtype=np.float32)


@functools.cache
def first_layout_matrix() -> np.ndarray:
    """Return the matrix that makes the first layout of the command observation of the present one, shape (13, 18).

    Order of the first layout: the eight scaled commands, psi (0.5 walking, else 0), phi_stance (1 standing, else 0.5),
    the clocks of the left and the right foot, I.
    """
    matrix = np.zeros((FIRST_COMMAND_SIZE, COMMAND_SIZE), dtype=np.float32)
    matrix[:_GAIT, :_GAIT] = np.eye(_GAIT)
    psi, stance, clock = _GAIT, _GAIT + 1, _GAIT + 2
    matrix[psi, _GAIT + Gait.WALKING] = 0.5
    matrix[stance, _GAIT : _GAIT + len(Gait)] = gaits.DEFAULT_DUTY
    matrix[stance, _GAIT + Gait.STANDING] = 1.0
    matrix[clock, _CLOCK] = matrix[clock + 1, _CLOCK + 1] = matrix[-1, -1] = 1.0
    return matrix

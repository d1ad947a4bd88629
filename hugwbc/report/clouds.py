"""Hand positions under the training's noise, by level of its curriculum."""

import numpy as np
import torch

from hugwbc.evaluation.conditions import NOISE_INTERVAL
from hugwbc.kinematics import Kinematics
from hugwbc.learned.env.arm_intervention import NoiseTargets
from hugwbc.robot import SIDES, load_robot
from hugwbc.state import RobotState

LEVELS = (0.25, 0.5, 0.75, 1.0)  # of the curriculum's alpha
SAMPLES = 400


def hand_clouds(level: float, samples: int = SAMPLES) -> tuple[np.ndarray, np.ndarray]:
    """Return positions of both hands in the pelvis frame under the noise of a curriculum level [m], (samples, 3).

    The arms follow alpha * noise + (1 - alpha) * policy, the paper's blend; the nominal posture stands for the policy.
    """
    source = NoiseTargets(samples, NOISE_INTERVAL, torch.Generator().manual_seed(0))
    # The robots change targets at different times. After two intervals, none of them is at its nominal start any more.
    for _ in range(2 * NOISE_INTERVAL):
        source.step()
    robot = load_robot()
    kinematics = Kinematics(robot)
    nominal = robot.nominal[robot.arms]
    postures = level * source.targets().double().numpy() + (1.0 - level) * nominal
    hands = np.empty((len(SIDES), samples, 3))
    for index, posture in enumerate(postures):
        q = robot.nominal.copy()
        q[robot.arms] = posture
        kinematics.update(RobotState(q, np.zeros_like(q), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)))
        hands[:, index] = [kinematics.position(f"{side}_hand") for side in SIDES]
    return hands[0], hands[1]

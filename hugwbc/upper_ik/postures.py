"""Arm postures all over the workspace, from which a search for a way to put a hand somewhere begins."""

import dataclasses
import functools

import numpy as np

from hugwbc import rotations
from hugwbc.robot import load_robot
from hugwbc.upper_ik.config import ArmIKConfig
from hugwbc.upper_ik.descent import Descent, lengths

# Left arm [rad]: hanging, raised sideways over the head, raised forward, raised backward.
POSTURES = np.array([[0.0, 0.1, 0.0, 0.0], [-0.3, 2.6, 0.0, 0.8], [-1.6, 0.3, 0.0, 0.8], [2.4, 0.1, 0.0, 0.8]])
MIRROR = np.array([1.0, -1.0, -1.0, 1.0])
SEEDS = np.stack((POSTURES, POSTURES * MIRROR))  # of both arms
COUNT = 2000
TRAVEL_COST = 0.02  # [m/rad], what a posture that is farther to go to must bring a hand nearer
APART = 0.8  # [rad], of postures that are worth to be tried both


@dataclasses.dataclass(frozen=True, eq=False)
class PostureTable:
    """Postures of the left arm that touch nothing, and where they put its hand.

    Attributes:
        q: joint positions [rad], shape (n, 4).
        hands: positions in the frame of the waist's turning part [m], shape (n, 3).
    """

    q: np.ndarray
    hands: np.ndarray

    def candidates(self, arm: int, point: np.ndarray, waist: float, q: np.ndarray, count: int) -> np.ndarray:
        """Postures from which to search for one that puts a hand to a point, the most promising first.

        Args:
            arm: 0 for the left, 1 for the right one.
            point: where the hand should be, in the pelvis frame [m], shape (3,).
            waist: angle of the waist [rad].
            q: where the arm is [rad], shape (4,): of postures alike near the point, the nearest to it is best.
            count: how many postures, each of another kind.

        Returns:
            Joint positions [rad], shape (count, 4).
        """
        mirror = MIRROR if arm else np.ones(4)
        local = rotations.rotation_z(-waist) @ point * ([1.0, -1.0, 1.0] if arm else [1.0, 1.0, 1.0])
        cost = lengths(self.hands - local) + TRAVEL_COST * np.abs(self.q - q * mirror).max(axis=1)
        found = []
        for _ in range(count):
            found.append(self.q[cost.argmin()])
            cost = np.where(np.abs(self.q - found[-1]).max(axis=1) < APART, np.inf, cost)
        return np.array(found) * mirror


@functools.lru_cache(maxsize=1)
def posture_table() -> PostureTable:
    """Random postures within the limits, the same in every process; takes some 60 ms once."""
    robot = load_robot()
    descent = Descent(ArmIKConfig())
    rng = np.random.default_rng(0)
    postures, hands = [], []
    q = robot.nominal[robot.arms].copy()
    while len(postures) < COUNT:
        q[:4] = rng.uniform(descent.lower[:4], descent.upper[:4])
        hand = descent.forward(q, robot.nominal)[0]
        if descent.clearance()[0] > descent.config.collision_margin:
            postures.append(q[:4].copy())
            hands.append(hand)
    return PostureTable(np.array(postures), np.array(hands))

"""Looking for a better arm posture where the direct way to a hand target has ended in a dead end.

Descent stops where joint limits block the way, above all after the arm has been wound up by earlier targets. A second,
virtual pair of arms then starts from a few known postures; what it finds is worth a detour of the real arm.
"""

import dataclasses

import numpy as np

from hugwbc.robot import load_robot
from hugwbc.upper_ik.config import ArmIKConfig
from hugwbc.upper_ik.descent import Descent, Goal

# Left arm [rad]: hanging, raised sideways over the head, raised forward, raised backward; the right arm's are mirrored.
POSTURES = np.array([[0.0, 0.1, 0.0, 0.0], [-0.3, 2.6, 0.0, 0.8], [-1.6, 0.3, 0.0, 0.8], [2.4, 0.1, 0.0, 0.8]])
_MIRROR = np.array([1.0, -1.0, -1.0, 1.0])
STEPS = 4  # in a tick
STEP_TIME = 0.02  # [s]
SETTLED = 0.001  # [m]; a hand that gets no nearer than that in one tick has arrived
MOVED = 0.05  # [m]; a target that moved as far is worth another search


class Scout:
    """Virtual arms that search from posture to posture, each arm for itself, and then stay with the best they found.

    Attributes:
        q: their joint positions [rad], shape (8,).
        residual: of both hands [m], shape (2,).
        done: whether each arm's search is over, shape (2,), bool: a target was reached, or all postures were tried.
    """

    def __init__(self, config: ArmIKConfig) -> None:
        # Nothing moves that could break: large steps.
        self._descent = Descent(
            dataclasses.replace(config, hand_speed=4.0, hand_deceleration=1e3, touch_speed=4.0, speed_fraction=1.0)
        )
        self._seeds = np.stack((POSTURES, POSTURES * _MIRROR))
        self._seed = np.full(2, -1)
        self._goal = np.zeros((2, 3))
        self._best = np.zeros((2, 4))
        self._best_residual = np.full(2, np.inf)
        self._settled = np.zeros(2, dtype=bool)
        self.q = load_robot().nominal[load_robot().arms].copy()
        self.residual = np.full(2, np.inf)
        self.done = np.zeros(2, dtype=bool)

    def rest(self, arm: int) -> None:
        """Forget an arm's search: the next one begins with the first posture."""
        self._seed[arm] = -1
        self._best_residual[arm] = np.inf
        self.done[arm] = False

    def search(self, arm: int, goal: np.ndarray) -> None:
        """Begin an arm's search, or go on to its next posture if it has settled; a target that moved starts over."""
        joints = slice(4 * arm, 4 * arm + 4)
        if self.done[arm] and np.linalg.norm(goal[arm] - self._goal[arm]) > MOVED:
            self.rest(arm)
        if self.done[arm] or (self._seed[arm] >= 0 and not self._settled[arm]):
            return
        if self._seed[arm] >= 0 and self.residual[arm] < self._best_residual[arm]:
            self._best[arm], self._best_residual[arm] = self.q[joints], self.residual[arm]
        self._seed[arm] += 1
        self._goal[arm] = goal[arm]
        reached = self._best_residual[arm] <= self._descent.config.tolerance
        self.done[arm] = reached or self._seed[arm] == len(POSTURES)
        self.q[joints] = self._best[arm] if self.done[arm] else self._seeds[arm, self._seed[arm]]

    def advance(self, goal: np.ndarray, body: np.ndarray) -> None:
        """Let both arms descend for a few steps towards the targets (2, 3) [m], on a body (19,) [rad].

        Raises:
            RuntimeError: if placo cannot solve it.
        """
        self._descent.place(self.q, body)
        before = np.linalg.norm(goal - self._descent.hands, axis=1)
        for _ in range(STEPS):
            self._descent.step(Goal(goal), STEP_TIME)
        self.q = self._descent.q
        self.residual = self._descent.residual
        self._settled = (before - self.residual < SETTLED) | (self.residual <= self._descent.config.tolerance)

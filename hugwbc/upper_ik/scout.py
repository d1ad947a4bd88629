"""Looking ahead: where the direct way to a hand target will end, and whether another posture brings the hand nearer.

Descent stops where joint limits or the body block the way, above all after the arm has been wound up by earlier
targets. A second, virtual pair of arms goes ahead of the real one in larger steps, and then starts from postures
all over the workspace; what it finds is worth a detour of the real arm.
"""

import dataclasses

import numpy as np

from hugwbc.robot import load_robot
from hugwbc.upper_ik.config import ArmIKConfig
from hugwbc.upper_ik.descent import Descent, Goal
from hugwbc.upper_ik.postures import posture_table

STARTS = 3  # from other postures, after the one from where the arm is
STEPS = 4  # in a tick
STEP_TIME = 0.02  # [s]
SETTLED = 0.003  # [m]; a hand that gets no nearer than that in one tick has arrived
MOVED = 0.05  # [m]; a target that moved as far is worth another search


class Scout:
    """Virtual arms that search from posture to posture, each arm for itself, and then stay with the best they found.

    Attributes:
        q: their joint positions [rad], shape (8,).
        residual: of both hands [m], shape (2,).
        direct: where the direct way will end: distance from the target [m], shape (2,), infinite while not known.
        done: whether each arm's search is over, shape (2,), bool: a target was reached, or all postures were tried.
    """

    def __init__(self, config: ArmIKConfig) -> None:
        # Nothing moves that could break: large steps.
        self._descent = Descent(
            dataclasses.replace(config, hand_speed=4.0, hand_deceleration=1e3, touch_speed=4.0, speed_fraction=1.0)
        )
        self._postures = posture_table()  # now: the first time it takes as long as many ticks of a control loop
        self._starts: list[list[np.ndarray]] = [[], []]
        self._searching = np.zeros(2, dtype=bool)
        self._goal = np.zeros((2, 3))
        self._best = np.zeros((2, 4))
        self._best_residual = np.full(2, np.inf)
        self._settled = np.zeros(2, dtype=bool)
        self._waist = load_robot().waist
        self.q = load_robot().nominal[load_robot().arms].copy()
        self.residual = np.full(2, np.inf)
        self.direct = np.full(2, np.inf)
        self.done = np.zeros(2, dtype=bool)

    def reset(self, q: np.ndarray) -> None:
        """Forget both arms' searches, and be where the real arms are: positions (8,) [rad]."""
        for arm in range(2):
            self.rest(arm)
        self.q = q.copy()

    def rest(self, arm: int) -> None:
        """Forget an arm's search: the next one begins with where the arm then is."""
        self._searching[arm] = self.done[arm] = False

    def search(self, arm: int, goal: np.ndarray, q: np.ndarray, body: np.ndarray) -> None:
        """Begin an arm's search, or go on to its next start if it has settled; a target that moved starts over.

        Args:
            arm: 0 for the left, 1 for the right one.
            goal: targets [m], shape (2, 3).
            q: where the real arms are [rad], shape (8,).
            body: joint positions of the robot [rad], shape (19,).
        """
        if self.done[arm] and np.linalg.norm(goal[arm] - self._goal[arm]) > MOVED:
            self.rest(arm)
        joints = slice(4 * arm, 4 * arm + 4)
        if self.done[arm]:
            return
        if not self._searching[arm]:
            self._begin(arm, goal[arm])
            self.q[joints] = q[joints]
        elif self._settled[arm]:
            self._go_on(arm, joints, q, float(body[self._waist]))

    def _begin(self, arm: int, point: np.ndarray) -> None:
        self._searching[arm] = True
        self._goal[arm] = point
        self._best_residual[arm] = self.direct[arm] = np.inf

    def _go_on(self, arm: int, joints: slice, q: np.ndarray, waist: float) -> None:
        if self._best_residual[arm] == np.inf:
            self.direct[arm] = self.residual[arm]
            starts = self._postures.candidates(arm, self._goal[arm], waist, q[joints], STARTS)
            self._starts[arm] = list(starts)
        if self.residual[arm] < self._best_residual[arm]:
            self._best[arm], self._best_residual[arm] = self.q[joints], self.residual[arm]
        self.done[arm] = self._best_residual[arm] <= self._descent.config.tolerance or not self._starts[arm]
        self.q[joints] = self._best[arm] if self.done[arm] else self._starts[arm].pop(0)

    def advance(self, goal: np.ndarray, body: np.ndarray) -> None:
        """Let both arms descend towards the targets (2, 3) [m], on a body (19,) [rad]: fast while they search.

        Raises:
            RuntimeError: if placo cannot solve it.
        """
        steps = STEPS if np.any(self._searching & ~self.done) else 1
        self._descent.place(self.q, body)
        before = np.linalg.norm(goal - self._descent.hands, axis=1)
        self._descent.descend(Goal(goal), STEP_TIME, steps)
        self.q = self._descent.q
        self.residual = self._descent.residual
        self._settled = (before - self.residual < SETTLED) | (self.residual <= self._descent.config.tolerance)

"""Ways of an arm to another posture, in joint space and past the body, where the straight way is a dead end."""

import itertools

import numpy as np

from hugwbc.upper_ik.config import ArmIKConfig
from hugwbc.upper_ik.descent import Descent, lengths
from hugwbc.upper_ik.postures import SEEDS

ARRIVED = 0.02  # [rad]; end of a detour
CORNER = 0.15  # [rad]; as near to a posture on its way, an arm turns to the next one: it cannot turn on the spot
PROBE = 0.2  # [rad] between two looks ahead
# By way of none or one of the known postures.
WAYS = [way for count in range(2) for way in itertools.permutations(range(SEEDS.shape[1]), count)]


class Detours:
    """Leads arms, each for itself, to postures that were found for them, on straight lines from posture to posture.

    A way is taken if the forearm touches nothing on it; the body and the other arm are as they are now. One way is
    looked at in a call: where the direct one is not clear, those by way of known postures follow.

    Attributes:
        active: whether each arm is on a detour, shape (2,), bool.
        count: of detours begun.
    """

    def __init__(self, config: ArmIKConfig, descent: Descent) -> None:
        self._config = config
        self._descent = descent
        self._tried = [0, 0]
        self._vias: list[list[np.ndarray]] = [[], []]
        self.active = np.zeros(2, dtype=bool)
        self.count = 0

    def reset(self) -> None:
        """Leave every detour."""
        self.active[:] = False
        self._tried = [0, 0]

    def forget(self, arm: int) -> None:
        """There is nothing to go to any more: leave the detour; to what is found next, any way may be tried."""
        self.active[arm] = False
        self._tried[arm] = 0

    def look(self, arm: int, q: np.ndarray, posture: np.ndarray, body: np.ndarray) -> None:
        """Look at the next way of an arm from positions (8,) to its posture in (8,); begin it if it is clear."""
        if self._tried[arm] == len(WAYS):
            return
        vias = [SEEDS[arm, seed] for seed in WAYS[self._tried[arm]]]
        self._tried[arm] += 1
        joints = slice(4 * arm, 4 * arm + 4)
        corners = [q[joints], *vias, posture[joints]]
        if all(self._is_clear(arm, q, *leg, body) for leg in itertools.pairwise(corners)):
            self.active[arm], self._vias[arm], self._tried[arm] = True, vias, 0
            self.count += 1

    def _is_clear(self, arm: int, q: np.ndarray, start: np.ndarray, end: np.ndarray, body: np.ndarray) -> bool:
        joints = slice(4 * arm, 4 * arm + 4)
        probe = q.copy()
        self._descent.forward(probe, body)
        least = min(0.0, self._descent.clearance()[arm])
        for part in np.linspace(0.0, 1.0, 1 + int(np.ceil(np.abs(end - start).max() / PROBE)))[1:]:
            probe[joints] = start + part * (end - start)
            self._descent.forward(probe, body)
            if self._descent.clearance()[arm] < least:
                return False
        return True

    def follow(
        self, q: np.ndarray, direct: np.ndarray, postures: np.ndarray, body: np.ndarray, dt: float
    ) -> np.ndarray:
        """Where the arms at positions `q` are to be a tick later: on their detours, or, without one, at `direct`.

        Args:
            q: arm positions now [rad], shape (8,).
            direct: where the arms would be by the direct way [rad], shape (8,).
            postures: to which the detours lead [rad], shape (8,).
            body: joint positions of the robot [rad], shape (19,).
            dt: length of the tick [s].
        """
        target = direct.copy()
        for arm in np.flatnonzero(self.active):
            joints = slice(4 * arm, 4 * arm + 4)
            vias = self._vias[arm]
            while vias and np.abs(vias[0] - q[joints]).max() <= CORNER:
                vias.pop(0)
            way = (vias[0] if vias else postures[joints]) - q[joints]
            longest = float(np.abs(way).max())
            # Half the deceleration that the limiter has: it is to have some in hand at the end.
            brake = np.inf if vias else np.sqrt(self._config.acceleration * longest)
            target[joints] = q[joints] + way * min(1.0, min(self._config.detour_speed, brake) * dt / max(longest, 1e-9))
            self.active[arm] = bool(vias) or longest > ARRIVED
        return self._slow_hands(q, target, body, dt)

    def _slow_hands(self, q: np.ndarray, target: np.ndarray, body: np.ndarray, dt: float) -> np.ndarray:
        """Shorter steps of the arms on a detour where a hand would be faster than it may be."""
        start = self._descent.forward(q, body).copy()
        travel = lengths(self._descent.forward(target, body) - start)
        part = np.minimum(1.0, self._config.hand_speed * dt / np.maximum(travel, 1e-9))
        part = np.where(self.active, part, 1.0)
        return q + np.repeat(part, 4) * (target - q)

"""Look ahead to where the direct way to a hand target ends, and detour to a posture closer to it.

Descent stops where joint limits or the body block the way, above all after earlier targets have wound up the arm. A
second, virtual pair of arms (`Scout`) goes ahead of the real one in larger steps, and then starts again from postures
all over the workspace (`PostureTable`). If one of them brings the hand nearer, the real arm goes there (`Detours`). In
this module, k is the number of joints of one arm.
"""

import dataclasses
import functools
import itertools

import numpy as np

from hugwbc import rotations
from hugwbc.errors import ModelError
from hugwbc.robot import SIDES, Robot, load_mirror
from hugwbc.upper_ik.arm_solver import ArmIKConfig
from hugwbc.upper_ik.descent import Descent, Goal, lengths

COUNT = 2000  # random postures in the table, at most
TRIES = 20_000  # draws, at most, to find `COUNT` that are free of collisions; an H1 takes 2171, a G1 3209
TRAVEL_COST = 0.02  # [m/rad]; a posture farther away must bring the hand nearer by this much
APART = 0.8  # [rad], the least difference of two postures that are both worth trying

STARTS = 3  # searches from other postures, after the one from the arm's own posture
STEPS = 4  # of a search in a tick
STEP_TIME = 0.02  # [s]
SETTLED = 0.003  # [m]; a virtual hand that gets nearer by less than this in one tick has arrived
MOVED = 0.05  # [m]; a target that moved this far is worth another search

ARRIVED = 0.02  # [rad]; distance to the posture at which a detour ends
CORNER = 0.15  # [rad]; this near to a corner an arm turns to the next one, because it cannot turn on the spot
ROUNDING = 0.001  # [m]; an arm that is stalled next to an obstacle may slide along it
PROBE = 0.2  # [rad] between two collision checks on a route


def own(arm: int, q: np.ndarray) -> slice:
    """Return the places of an arm, 0 for the left and 1 for the right, in a vector of the joints of both."""
    half = q.size // 2
    return slice(half * arm, half * (arm + 1))


def arm_mirror(robot: Robot) -> np.ndarray:
    """Return the signs that turn a posture of one arm into its mirror image, shape (k,)."""
    return load_mirror(robot).joint_sign[robot.arms.reshape(len(SIDES), -1)[1]]


def seeds(robot: Robot) -> np.ndarray:
    """Return the known postures of both arms, `Robot.arm_postures`, as mirror images [rad], shape (2, n, k)."""
    postures = np.array(list(robot.arm_postures.values()))
    return np.stack((postures, postures * arm_mirror(robot)))


@dataclasses.dataclass(frozen=True, eq=False)
class PostureTable:
    """A table of collision-free postures of the left arm and of the hand positions that they give."""

    q: np.ndarray  # joint positions [rad], shape (n, k)
    hands: np.ndarray  # hand positions in the pelvis frame with the waist at zero [m], shape (n, 3)
    mirror: np.ndarray  # signs that turn a posture into that of the right arm, shape (k,)

    def candidates(self, arm: int, point: np.ndarray, waist: float, q: np.ndarray, count: int) -> np.ndarray:
        """Return starts of a search for a posture with the hand at a point, the most promising first.

        Args:
            arm: 0 for the left, 1 for the right arm.
            point: target of the hand in the pelvis frame [m], shape (3,).
            waist: angle of the waist [rad].
            q: current positions of the arm [rad], shape (k,); of postures equally near the point, the nearest to `q`
                comes first.
            count: number of postures, which differ by at least `APART`.

        Returns:
            Joint positions [rad], shape (count, k).
        """
        mirror = self.mirror if arm else np.ones_like(self.mirror)
        local = rotations.rotation_z(-waist) @ point * ([1.0, -1.0, 1.0] if arm else [1.0, 1.0, 1.0])
        cost = lengths(self.hands - local) + TRAVEL_COST * np.abs(self.q - q * mirror).max(axis=1)
        found = []
        for _ in range(count):
            found.append(self.q[cost.argmin()])
            cost = np.where(np.abs(self.q - found[-1]).max(axis=1) < APART, np.inf, cost)
        return np.array(found) * mirror


@functools.lru_cache(maxsize=64)  # robots of models that are not ours are new each time
def posture_table(robot: Robot) -> PostureTable:
    """Build the table of random postures, the same in every process; the first call of a robot takes about 0.1 s."""
    descent = Descent(ArmIKConfig(), robot)
    rng = np.random.default_rng(0)
    postures, hands = [], []
    q = robot.nominal[robot.arms].copy()
    left = own(0, q)
    for _ in range(TRIES):
        q[left] = rng.uniform(descent.lower[left], descent.upper[left])
        hand = descent.forward(q, robot.nominal)[0]
        if descent.clearance()[0] > descent.config.collision_margin:
            postures.append(q[left].copy())
            hands.append(hand)
        if len(postures) == COUNT:
            break
    if not postures:
        raise ModelError(
            f"the left arm of {robot.name} touches something in all of {TRIES} random postures; give smaller "
            "collision_boxes or capsules, or fewer collision_pairs, to its table"
        )
    return PostureTable(np.array(postures), np.array(hands), arm_mirror(robot))


class Scout:
    """Virtual arms that search from posture to posture, each on its own, and keep the best one found.

    Attributes:
        q: joint positions of the virtual arms [rad], shape (2 k,).
        residual: distances of the virtual hands to their targets [m], shape (2,).
        direct: distance to the target at which the direct way ends [m], shape (2,); infinite until it is known.
        done: whether each arm's search is over, because its target was reached or all postures were tried; shape (2,),
            bool.
    """

    def __init__(self, config: ArmIKConfig, robot: Robot) -> None:
        # Virtual arms cannot break, so steps may be large.
        self._descent = Descent(
            dataclasses.replace(config, hand_speed=4.0, hand_deceleration=1e3, touch_speed=4.0, speed_fraction=1.0),
            robot,
        )
        self._postures = posture_table(robot)  # built now, because that takes as long as many control periods
        self._starts: list[list[np.ndarray]] = [[], []]
        self._searching = np.zeros(2, dtype=bool)
        self._goal = np.zeros((2, 3))
        self._best = np.zeros((2, robot.arms.size // 2))
        self._best_residual = np.full(2, np.inf)
        self._settled = np.zeros(2, dtype=bool)
        self._waist = robot.waist
        self.q = robot.nominal[robot.arms].copy()
        self.residual = np.full(2, np.inf)
        self.direct = np.full(2, np.inf)
        self.done = np.zeros(2, dtype=bool)

    def reset(self, q: np.ndarray) -> None:
        """Forget both searches and move to the real arms' positions (2 k,) [rad]."""
        for arm in range(2):
            self.rest(arm)
        self.q = q.copy()

    def rest(self, arm: int) -> None:
        """Forget an arm's search; the next one starts from the arm's position at that time."""
        self._searching[arm] = self.done[arm] = False

    def search(self, arm: int, goal: np.ndarray, q: np.ndarray, body: np.ndarray) -> None:
        """Start an arm's search, or go on from its next start once it has settled.

        A search that is done starts over if its target has moved by more than `MOVED`.

        Args:
            arm: 0 for the left, 1 for the right arm.
            goal: targets [m], shape (2, 3).
            q: positions of the real arms [rad], shape (2 k,).
            body: joint positions of the robot [rad], shape (n,).
        """
        if self.done[arm] and np.linalg.norm(goal[arm] - self._goal[arm]) > MOVED:
            self.rest(arm)
        joints = own(arm, q)
        if self.done[arm]:
            return
        if not self._searching[arm]:
            self._searching[arm], self._goal[arm], self.q[joints] = True, goal[arm], q[joints]
            self._best_residual[arm] = self.direct[arm] = np.inf
        elif self._settled[arm]:
            self._go_on(arm, joints, q, float(body[self._waist]))

    def _go_on(self, arm: int, joints: slice, q: np.ndarray, waist: float) -> None:
        if self._best_residual[arm] == np.inf:
            self.direct[arm] = self.residual[arm]
            starts = self._postures.candidates(arm, self._goal[arm], waist, q[joints], STARTS)
            self._starts[arm] = list(starts)
        if self.residual[arm] < self._best_residual[arm]:
            self._best[arm], self._best_residual[arm] = self.q[joints], self.residual[arm]
        self.done[arm] = self._best_residual[arm] <= self._descent.config.tolerance or not self._starts[arm]
        self.q[joints] = self._best[arm] if self.done[arm] else self._starts[arm].pop(0)

    def advance(self, goal: Goal, body: np.ndarray) -> None:
        """Let both arms descend towards places and orientations on a body (n,) [rad], fast while they search.

        Raises:
            RuntimeError: if placo cannot solve a step.
        """
        steps = STEPS if np.any(self._searching & ~self.done) else 1
        self._descent.place(self.q, body)
        before = np.linalg.norm(goal.points - self._descent.hands, axis=1)
        # A posture that is nearer only because it turns the hand away would be left again.
        wanted = Goal(goal.points, turns=goal.turns, level=goal.level, weight=goal.weight)
        self._descent.descend(wanted, STEP_TIME, steps)
        self.q = self._descent.q
        self.residual = self._descent.residual
        self._settled = (before - self.residual < SETTLED) | (self.residual <= self._descent.config.tolerance)


class Detours:
    """Detours of the arms, each on its own, to postures found by `Scout`, in straight lines in joint space.

    A route is taken if the arm is free of collisions on it, with the body and the other arm as they are now, and left
    where they have come into its way. Each call checks one route: first the direct one, then those via known postures.
    """

    def __init__(self, config: ArmIKConfig, descent: Descent, robot: Robot) -> None:
        self._config = config
        self._descent = descent
        # Of each arm: the postures on its routes, direct and via one of the known ones.
        self._ways = [[[], *([posture] for posture in postures)] for postures in seeds(robot)]
        self._tried = [0, 0]
        self._vias: list[list[np.ndarray]] = [[], []]
        self.active = np.zeros(2, dtype=bool)  # whether each arm is on a detour, shape (2,), bool
        self.count = 0  # number of detours that were started

    def reset(self) -> None:
        """Abandon all detours."""
        self.active[:] = False
        self._tried = [0, 0]

    def forget(self, arm: int) -> None:
        """Abandon the detour and allow every route to the next posture."""
        self.active[arm] = False
        self._tried[arm] = 0

    def look(self, arm: int, q: np.ndarray, posture: np.ndarray, body: np.ndarray) -> None:
        """Check an arm's next route from positions (2 k,) to its posture in (2 k,), and start on it if it is clear."""
        if self._tried[arm] == len(self._ways[arm]):
            return
        vias = self._ways[arm][self._tried[arm]].copy()
        self._tried[arm] += 1
        joints = own(arm, q)
        corners = [q[joints], *vias, posture[joints]]
        if all(self._is_clear(arm, q, *leg, body) for leg in itertools.pairwise(corners)):
            self.active[arm], self._vias[arm], self._tried[arm] = True, vias, 0
            self.count += 1

    def _is_clear(self, arm: int, q: np.ndarray, start: np.ndarray, end: np.ndarray, body: np.ndarray) -> bool:
        joints = own(arm, q)
        probe = q.copy()
        self._descent.forward(probe, body)
        least = self._least_room(self._descent.clearance())[arm]
        for part in np.linspace(0.0, 1.0, 1 + int(np.ceil(np.abs(end - start).max() / PROBE)))[1:]:
            probe[joints] = start + part * (end - start)
            self._descent.forward(probe, body)
            if self._descent.clearance()[arm] < least:
                return False
        return True

    def follow(
        self, q: np.ndarray, direct: np.ndarray, postures: np.ndarray, body: np.ndarray, dt: float
    ) -> np.ndarray:
        """Return the arm positions one tick later: on the detour, or `direct` for an arm without one.

        Args:
            q: current arm positions [rad], shape (2 k,).
            direct: arm positions of the direct way [rad], shape (2 k,).
            postures: postures to which the detours lead [rad], shape (2 k,).
            body: joint positions of the robot [rad], shape (n,).
            dt: length of the tick [s].
        """
        target = direct.copy()
        for arm in np.flatnonzero(self.active):
            joints = own(arm, q)
            vias = self._vias[arm]
            while vias and np.abs(vias[0] - q[joints]).max() <= CORNER:
                vias.pop(0)
            way = (vias[0] if vias else postures[joints]) - q[joints]
            longest = float(np.abs(way).max())
            # Brake with half of the limiter's deceleration, which leaves a reserve at the end.
            brake = np.inf if vias else np.sqrt(self._config.acceleration * longest)
            target[joints] = q[joints] + way * min(1.0, min(self._config.detour_speed, brake) * dt / max(longest, 1e-9))
            self.active[arm] = bool(vias) or longest > ARRIVED
        return self._restrain(q, target, direct, body, dt)

    def _least_room(self, clearance: list[float]) -> np.ndarray:
        """Return the clearance to keep on detours from a posture with the given clearance [m], shape (2,)."""
        return np.minimum(self._config.collision_margin, clearance) - ROUNDING

    def _restrain(
        self, q: np.ndarray, target: np.ndarray, direct: np.ndarray, body: np.ndarray, dt: float
    ) -> np.ndarray:
        """Leave detours that have become blocked, and shorten steps in which a hand would exceed its speed limit."""
        start, clearance = self._descent.forward(q, body).copy(), self._descent.clearance()
        travel = lengths(self._descent.forward(target, body) - start)
        blocked = self.active & (self._descent.clearance() < self._least_room(clearance))
        self.active &= ~blocked
        for arm in np.flatnonzero(blocked):
            self._tried[arm] = len(self._ways[arm])  # it would be blocked again
        fastest = np.array([self._descent.stoppable(room) for room in clearance])
        half = q.size // 2
        part = np.minimum(1.0, fastest * dt / np.maximum(travel, 1e-9))
        return np.where(np.repeat(self.active, half), q + np.repeat(part, half) * (target - q), direct)

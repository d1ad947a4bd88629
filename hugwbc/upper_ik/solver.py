"""Inverse kinematics of both arms: two hand positions to eight joint targets."""

import dataclasses
import math

import numpy as np

from hugwbc import rotations
from hugwbc.errors import TargetError
from hugwbc.robot import load_robot
from hugwbc.state import RobotState
from hugwbc.targets import HandTargets
from hugwbc.upper_ik.config import ArmIKConfig
from hugwbc.upper_ik.descent import Descent
from hugwbc.upper_ik.scout import Scout

LONGEST_STEP = 0.005  # [s]; a longer tick is cut into equal steps, so that slow loops converge as fast loops do
ARRIVED = 0.02  # [rad]; end of a detour


@dataclasses.dataclass(frozen=True, eq=False)
class IKSolution:
    """Arm targets for one tick; joints in the order of `Robot.arms`, hands in the order left, right.

    Attributes:
        q: joint positions [rad], shape (8,).
        dq: their velocities [rad/s], shape (8,).
        residual: distance of each hand at `q` from its target [m], shape (2,); NaN while no target was ever usable.
        reachable: False where the hand is off its target and no longer gets nearer: `q` is the nearest pose that was
            found. Shape (2,), bool.
        ok: False if the target or the state was unusable and `q` holds its last value.
    """

    q: np.ndarray
    dq: np.ndarray
    residual: np.ndarray
    reachable: np.ndarray
    ok: bool


class ArmIK:
    """Tracks hand targets with an arm configuration of its own, which it integrates from call to call.

    The measured arms are read at `reset` only: feeding them back would make the sag of soft joints drift into the
    targets. A hand goes to its target directly (see `Descent`); where that ends short of it, a search for a better
    posture goes on in the background (see `Scout`), and the arm moves there if it finds one.

    Attributes:
        rejected: how many calls had unusable numbers (a target or the waist angle that is not finite, a target in the
            world frame without a known pelvis position, a time step that is not positive); each held the last
            configuration.
        failures: how many calls the solver failed in; each held the last configuration.
        lower, upper: joint position limits of the solution [rad], shape (8,).
        velocity_limit: joint speed limits of the solution [rad/s], shape (8,).
    """

    def __init__(self, config: ArmIKConfig | None = None) -> None:
        """Build the kinematics from the robot's URDF, at the nominal arm posture."""
        self.config = config or ArmIKConfig()
        self.robot = load_robot()
        self.rejected = 0
        self.failures = 0
        self._descent = Descent(self.config)
        self._scout = Scout(self.config)
        self.lower, self.upper = self._descent.lower, self._descent.upper
        self.velocity_limit = self._descent.velocity_limit
        self._q = self._descent.q
        self._rest = self._descent.forward(self.robot.nominal[self.robot.arms], 0.0).copy()
        self.reset(self._q)

    @property
    def q(self) -> np.ndarray:
        """The current arm configuration [rad], shape (8,)."""
        return self._q.copy()

    def reset(self, q: np.ndarray) -> None:
        """Continue from arm positions (8,) [rad], moved into the limits; values that are not finite are ignored."""
        self._q = np.clip(np.where(np.isfinite(q), q, self._q), self.lower, self.upper)
        self._residual = np.full(2, np.nan)
        self._reachable = np.ones(2, dtype=bool)
        self._detour = np.zeros(2, dtype=bool)
        for arm in range(2):
            self._scout.rest(arm)

    def hands(self, q: np.ndarray, waist: float) -> np.ndarray:
        """Positions of both hands in the pelvis frame [m], shape (2, 3), at arm positions (8,) and a waist angle."""
        return self._descent.forward(q, waist)

    def solve(self, targets: HandTargets, state: RobotState, dt: float) -> IKSolution:
        """Advance the arm configuration by one tick towards the targets. Never raises on bad numbers: holds, counts.

        Args:
            targets: hand positions; a hand without one goes to its place beside the body.
            state: gives the waist angle and, for targets in another frame than the pelvis', the pelvis pose.
            dt: time since the last call [s].
        """
        goal = targets_in_pelvis(targets, state, self._rest)
        waist = float(state.q[self.robot.waist])
        if goal is None or not np.isfinite(waist) or not 0.0 < dt < np.inf:
            self.rejected += 1
            return self._hold()
        try:
            q = self._descend(goal, waist, dt)
            q = self._go_round(q, goal, waist, dt)
        except RuntimeError:  # placo reports an infeasible problem so
            self.failures += 1
            return self._hold()
        dq = (q - self._q) / dt
        self._q = q
        return IKSolution(q.copy(), dq, self._residual.copy(), self._reachable.copy(), ok=True)

    def _descend(self, goal: np.ndarray, waist: float, dt: float) -> np.ndarray:
        count = max(1, math.ceil(dt / LONGEST_STEP - 1e-9))
        self._descent.place(self._q, waist)
        for _ in range(count):
            self._descent.step(goal, dt / count)
        self._residual, self._reachable = self._descent.residual, ~self._descent.stalled
        return self._descent.q

    def _go_round(self, q: np.ndarray, goal: np.ndarray, waist: float, dt: float) -> np.ndarray:
        """The arm positions `q` of the direct way, or those of a detour for an arm that is stuck on it."""
        seeking = ~self._reachable | self._detour
        if not seeking.any():
            return q
        for arm in range(2):
            if not seeking[arm]:
                self._scout.rest(arm)
            elif not self._detour[arm]:
                self._scout.search(arm, goal)
        self._scout.advance(goal, waist)
        better = self._scout.done & (self._scout.residual < self._residual - self.config.detour_gain)
        self._detour |= ~self._reachable & better
        if not self._detour.any():
            return q
        reach = np.minimum(self.config.detour_speed, self.velocity_limit) * dt
        joints = np.repeat(self._detour, 4)
        q = np.where(joints, self._q + np.clip(self._scout.q - self._q, -reach, reach), q)
        self._residual = np.linalg.norm(goal - self._descent.forward(q, waist), axis=1)
        self._reachable = self._reachable | self._detour
        self._detour &= np.abs(self._scout.q - q).reshape(2, 4).max(axis=1) > ARRIVED
        return q

    def _hold(self) -> IKSolution:
        return IKSolution(self._q.copy(), np.zeros(8), self._residual.copy(), self._reachable.copy(), ok=False)


def check_targets(targets: HandTargets, state: RobotState) -> None:
    """Tell a user, before a loop starts, that the loop would have to reject these targets.

    Raises:
        TargetError: if a position is not finite, or if the frame is the world's and the state has no position.
    """
    HandTargets.of(targets.left, targets.right, targets.frame)
    if targets.frame == "world" and state.position is None:
        raise TargetError(
            "hand targets in the world frame need the pelvis position, but the state has none; "
            "add an estimator, or give the targets in the pelvis frame"
        )


def targets_in_pelvis(targets: HandTargets, state: RobotState, rest: np.ndarray) -> np.ndarray | None:
    """Both target positions in the pelvis frame [m], shape (2, 3), or None if they or the pelvis pose are unusable.

    Args:
        targets: a hand without a target gets its `rest` position.
        state: gives the pelvis pose.
        rest: where the hands hang beside the body [m], shape (2, 3).
    """
    points = rest.copy()
    for hand, point in enumerate((targets.left, targets.right)):
        if point is None:
            continue
        if np.shape(point) != (3,):
            return None
        if targets.frame == "world":
            if state.position is None:
                return None
            point = rotations.rotate_inverse(state.orientation, point - state.position)
        elif targets.frame == "heading":
            point = rotations.rotate_inverse(state.orientation, rotations.rotation_z(state.yaw) @ point)
        points[hand] = point
    return points if np.all(np.isfinite(points)) else None

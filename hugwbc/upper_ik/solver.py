"""Inverse kinematics of both arms: from the positions of two hands to the joints of both arms."""

import dataclasses
import math

import numpy as np
from eigenpy import LLT

from hugwbc import rotations
from hugwbc.robot import Robot
from hugwbc.state import RobotState
from hugwbc.targets import HandTargets, frame_axes
from hugwbc.upper_ik.arm_solver import ArmIKConfig
from hugwbc.upper_ik.descent import NOWHERE, Descent, Goal, lengths
from hugwbc.upper_ik.detour import MOVED, Detours, Scout
from hugwbc.upper_ik.takeover import JointLimiter

FOLLOWED = 0.03  # [m]; a hand nearer to its target follows it
FAR = 0.1  # [m]; a hand farther from its target looks ahead whether the direct way leads there
LONGEST_STEP = 0.01  # [s]; a longer tick is cut into equal steps, so that slow loops converge like fast ones
LONGEST_TICK = 0.5  # [s]; a longer tick, of a loop that paused, counts as this long
_DAMPING = 0.05  # [m]; keeps the joint speeds of a stretched arm bounded
_RIDGE = _DAMPING**2 * np.eye(3)


@dataclasses.dataclass(frozen=True, eq=False)
class IKSolution:
    """The arm targets of one tick; joints in the order of `Robot.arms`, hands in the order left, right.

    Attributes:
        q: joint positions [rad], shape (k,).
        dq: joint velocities [rad/s], shape (k,).
        ddq: joint accelerations of the targets' own motion [rad/s^2], shape (k,); without what the arms do to correct
            for the body's motion, and zero where the targets' motion is not smooth.
        residual: distance of each hand at `q` to its target [m], shape (2,); NaN before the first usable target.
        reachable: False for a hand that is off its target and no longer gets nearer, so that `q` is the nearest pose
            found; shape (2,), bool.
        ok: False if the targets or the state were unusable, or the solver failed: the arms brake and hold.
    """

    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray
    residual: np.ndarray
    reachable: np.ndarray
    ok: bool


class ArmIK:
    """Inverse kinematics that integrates an arm configuration of its own from call to call.

    The measured arms are read at `reset` only; feeding them back would let the sag of soft joints drift into the
    targets. A hand goes to its target directly (see `Descent`). While it is far away or gets no nearer, a search for a
    better posture runs in the background (see `Scout`). The arm goes there (see `Detours`) if the direct way ends short
    of what was found.

    Attributes:
        lower, upper: joint position limits of the solution [rad], shape (k,).
        velocity_limit: joint speed limits of the solution [rad/s], shape (k,).
        acceleration_limit: joint acceleration limit of the solution [rad/s^2].
    """

    def __init__(self, robot: Robot, config: ArmIKConfig | None = None) -> None:
        """Build the kinematics of a robot from its URDF, at the nominal arm posture."""
        self.config = config or ArmIKConfig()
        self.robot = robot
        self._descent = Descent(self.config, self.robot)
        self._scout = Scout(self.config, self.robot)
        self._detours = Detours(self.config, self._descent, self.robot)
        self.lower, self.upper = self._descent.lower, self._descent.upper
        self.velocity_limit = self._descent.velocity_limit
        self.acceleration_limit = self.config.acceleration
        self._limiter = JointLimiter(self.lower, self.upper, self.velocity_limit, self.acceleration_limit)
        self._limiter.place(self._descent.q)
        self._path = PathAcceleration(self.config.hand_speed, self.acceleration_limit, self._descent.q.size)
        self._rest = self._descent.forward(self._limiter.q, self.robot.nominal).copy()
        self.reset(self._limiter.q)

    @property
    def q(self) -> np.ndarray:
        """The current arm configuration [rad], shape (k,)."""
        return self._limiter.q.copy()

    @property
    def without_collisions(self) -> int:
        """Number of steps that had to be solved without collision avoidance."""
        return self._descent.without_collisions

    def reset(self, q: np.ndarray) -> None:
        """Continue at rest from arm positions (k,) [rad], clamped to the limits; joints that are not finite stay."""
        self._limiter.place(np.clip(np.where(np.isfinite(q), q, self._limiter.q), self.lower, self.upper))
        self._body = self.robot.nominal.copy()
        self._ddq = np.zeros_like(self._limiter.q)
        self._path.reset()
        self._residual = np.full(2, np.nan)
        self._reachable = np.ones(2, dtype=bool)
        self._detours.reset()
        self._last_points: np.ndarray | None = None
        self._hands: np.ndarray | None = None  # where the last step has brought them, before the body moved on [m]
        self._jumped = np.zeros(2, dtype=bool)
        self._going, self._went = np.zeros(2, dtype=bool), np.full((2, 3), np.inf)  # on a detour; targets of the last
        self._scout.reset(self._limiter.q)

    def hands(self, q: np.ndarray, waist: float) -> np.ndarray:
        """Return both hands in the pelvis frame [m], shape (2, 3), at arm positions (k,) and a waist angle [rad]."""
        self._body[self.robot.waist] = waist
        return self._descent.forward(q, self._body)

    def clearance(self, q: np.ndarray) -> np.ndarray:
        """Return the least distance of each arm to everything that it could touch.

        Waist and hips are as in the last state.

        Args:
            q: arm positions [rad], shape (k,).

        Returns:
            Distances of the surfaces, negative in a collision [m], shape (2,).
        """
        self._descent.forward(q, self._body)
        return np.array(self._descent.clearance())

    def solve(self, targets: HandTargets, state: RobotState, dt: float) -> IKSolution:
        """Advance the arm configuration by one tick towards the targets.

        Bad numbers never raise: the arms brake and hold (`IKSolution.ok`). Bad are a target or waist angle that is not
        finite, a target in the world frame without a pelvis position, and a time step that is not positive.

        Args:
            targets: hand positions; a hand without one goes to its rest position next to the body.
            state: gives waist and hip angles and, for targets in other frames than the pelvis's, the pelvis pose.
            dt: time since the last call [s]; at most `LONGEST_TICK` counts.
        """
        dt = min(dt, LONGEST_TICK) if dt < np.inf else dt
        goal = goal_in_pelvis(targets, state, self._rest)
        if goal is None or not math.isfinite(state.q[self.robot.waist]) or not 0.0 < dt < np.inf:
            return self._hold(dt)
        carried = self._carried(np.where(np.isfinite(state.q), state.q, self._body), dt)
        goal = dataclasses.replace(goal, speed=self._speed(goal.points, dt), carried=carried)
        try:
            count = max(1, math.ceil(dt / LONGEST_STEP - 1e-9))
            self._descent.descend(goal, dt / count, count)
            q, self._residual, self._reachable = self._descent.q, self._descent.residual, ~self._descent.stalled
            # A stream's targets stand still between two messages: their differences say nothing.
            smooth = (self._residual < FOLLOWED) & ~self._detours.active & (targets.stamp is None)
            turn = _turn_to_pelvis(targets.frame, state)
            self._ddq = self._path.update(targets.array(), smooth, turn, self._descent.jacobians(), dt)
            q = self._go_round(q, goal, dt)
        except RuntimeError:  # this is how placo reports an infeasible problem
            return self._hold(dt)
        moved = self._limiter.follow(q, (q - self._limiter.q) / dt, dt)
        if np.abs(moved - q).max() > 1e-9:
            self._residual = lengths(goal.points - self._descent.forward(moved, self._body))
        self._hands = self._descent.hands
        return self._solution(ok=True)

    def _speed(self, points: np.ndarray, dt: float) -> np.ndarray:
        """Return the speed of the target points (2, 3) [m/s], shape (2,); 0 for a point that jumped."""
        last, self._last_points = self._last_points, points
        if last is None:
            return np.zeros(2)
        moved = lengths(points - last)
        self._jumped = moved > MOVED
        return np.where(moved <= self.config.hand_speed * dt, moved / dt, 0.0)

    def _carried(self, body: np.ndarray, dt: float) -> np.ndarray:
        """Place the arms on a body (n,), and return the speed at which it has carried the hands along [m/s], (2,).

        Speeds at which a hand stays on its target within the tolerance anyway (`Descent`) count as 0.
        """
        self._body, before = body, self._hands
        self._descent.place(self._limiter.q, body)
        if before is None:
            return np.zeros(2)
        speed = np.minimum(lengths(self._descent.hands - before) / dt, self.config.hand_speed)
        return np.where(speed**2 > 2.0 * self.config.hand_deceleration * self.config.tolerance, speed, 0.0)

    def _go_round(self, q: np.ndarray, goal: Goal, dt: float) -> np.ndarray:
        """Return arm positions: `q` of the direct way, or those of a detour for an arm that is stuck on it."""
        detours = self._detours
        # A detour of one hand would drop an object that both hold.
        seeking = (~self._reachable | detours.active | (self._residual > FAR)) & (not goal.together)
        for arm in range(2):
            seeking[arm] &= self._may_go_round(arm, goal)
            if self._jumped[arm] or not seeking[arm]:
                self._scout.rest(arm)
                detours.forget(arm)
        if not seeking.any():
            return q
        for arm in np.flatnonzero(seeking & ~detours.active):
            self._scout.search(arm, goal.points, self._limiter.q, self._body)
        try:
            self._scout.advance(goal, self._body)
        except RuntimeError:  # the real arms keep their step, and the next search starts from them
            for arm in range(2):
                self._scout.rest(arm)
                detours.forget(arm)
            return q
        expected = np.where(self._reachable, np.minimum(self._scout.direct, self._residual), self._residual)
        better = self._scout.done & (self._scout.residual < expected - self.config.detour_gain)
        looking = np.flatnonzero(better & ~detours.active)
        for arm in looking:
            detours.look(arm, self._limiter.q, self._scout.q, self._body)
        if detours.active.any():
            self._reachable = self._reachable | detours.active
            q = detours.follow(self._limiter.q, q, self._scout.q, self._body, dt)
        elif not looking.size:
            return q
        self._residual = lengths(goal.points - self._descent.forward(q, self._body))
        return q

    def _may_go_round(self, arm: int, goal: Goal) -> bool:
        """Return whether an arm may seek a detour: with an orientation, only one until its target has moved.

        Where a hand cannot have both place and orientation, it ends beside its target. Each posture nearer to the
        target would turn it away from the orientation, and the direct way would lead back.
        """
        if self._jumped[arm] or goal.turns[arm] is None or np.linalg.norm(goal.points[arm] - self._went[arm]) > MOVED:
            self._went[arm] = np.inf
        began, self._going[arm] = self._going[arm], self._detours.active[arm]
        if began and not self._going[arm] and goal.turns[arm] is not None:
            self._went[arm] = goal.points[arm]
        return bool(np.isinf(self._went[arm, 0]))

    def _hold(self, dt: float) -> IKSolution:
        self._ddq[:], self._hands = 0.0, None
        self._path.reset()
        if 0.0 < dt < np.inf:
            self._limiter.stop(dt)
        else:
            self._limiter.place(self._limiter.q)
        return self._solution(ok=False)

    def _solution(self, *, ok: bool) -> IKSolution:
        limiter = self._limiter
        return IKSolution(
            limiter.q.copy(), limiter.dq.copy(), self._ddq.copy(), self._residual.copy(), self._reachable.copy(), ok
        )


class PathAcceleration:
    """Differences of the targets' motion in the frame in which they were given.

    The arm command itself also moves to correct for a body that sways. Its derivative would feed that motion, and the
    noise of its measurement, forward as torque (`hugwbc.arm_servo.ArmServo`). The targets alone contain neither. A hand
    that should move with velocity v needs the joint speeds J^T (J J^T + d^2)^-1 v, with its Jacobian J and a damping d;
    their difference between two ticks is the acceleration.
    """

    def __init__(self, speed: float, largest: float, joints: int) -> None:
        """Set the bounds.

        Args:
            speed: of a target beyond which it has jumped [m/s].
            largest: acceleration of a joint [rad/s^2].
            joints: number of joints of both arms, k.
        """
        self._speed, self._largest, self._joints = speed, largest, joints
        self.reset()

    def reset(self) -> None:
        """Forget the last targets."""
        self._points = np.full((2, 3), np.nan)
        self._rates = np.full((2, self._joints // 2), np.nan)

    def update(
        self, points: np.ndarray, smooth: np.ndarray, turn: np.ndarray | None, jacobians: np.ndarray, dt: float
    ) -> np.ndarray:
        """Return the accelerations of the arm joints in this tick [rad/s^2], shape (k,).

        They are zero for a hand without two successive velocities: its target is new, jumps, or is not followed.

        Args:
            points: targets in their own frame [m], shape (2, 3); NaN for a hand without one.
            smooth: whether the arm follows a target that moves smoothly, shape (2,), bool.
            turn: rotation from that frame to the pelvis frame, shape (3, 3); None for none.
            jacobians: of the hands in the pelvis frame, shape (2, 3, k / 2).
            dt: time since the last call [s].
        """
        velocity = (points - self._points) / dt
        self._points = points
        within = smooth & (np.sqrt((velocity * velocity).sum(axis=1)) <= self._speed)  # false for NaN
        velocity = np.where(within[:, None], velocity, np.nan)
        if turn is not None:
            velocity = velocity @ turn.T
        rates = np.array(
            [
                jacobian.T.dot(LLT(jacobian.dot(jacobian.T) + _RIDGE).solve(each))
                for jacobian, each in zip(jacobians, velocity, strict=True)
            ]
        )
        change = (rates - self._rates) / dt
        self._rates = rates
        change = np.where(np.isfinite(change), change, 0.0)
        return np.minimum(np.maximum(change, -self._largest), self._largest).ravel()


def goal_in_pelvis(targets: HandTargets, state: RobotState, rest: np.ndarray) -> Goal | None:
    """Return the targets in the pelvis frame, or None if they or the pelvis pose are unusable.

    Args:
        targets: the targets; a hand without one gets its `rest` position.
        state: gives the pelvis pose.
        rest: positions of hands that hang next to the body [m], shape (2, 3).
    """
    if not targets.is_usable or (targets.frame == "world" and state.position is None):
        return None
    points, directions = rest.copy(), NOWHERE.copy()
    turn = _turn_to_pelvis(targets.frame, state)
    for hand, (point, direction) in enumerate(
        ((targets.left, targets.left_direction), (targets.right, targets.right_direction))
    ):
        if point is not None:
            away = point if targets.frame != "world" else point - state.position
            points[hand] = away if turn is None else turn @ away
        if direction is not None:
            directions[hand] = direction if turn is None else turn @ direction
    turns = [None if given is None else _axes(given, turn, state) for given in targets.orientations]
    if not all(np.isfinite(numbers).all() for numbers in (points, turn, *turns) if numbers is not None):
        return None
    level = np.array([given is not None and not given.any() for given in targets.orientations])
    return Goal(points, directions, targets.together, turns, level, targets.orientation_weight)


def _axes(orientation: np.ndarray, turn: np.ndarray | None, state: RobotState) -> np.ndarray:
    """Return the axes of a hand in the pelvis frame, shape (3, 3); of one that is level, those of the world."""
    if not orientation.any():
        return rotations.to_matrix(state.orientation).T
    axes = rotations.to_matrix(orientation / np.sqrt(orientation.dot(orientation)))
    return axes if turn is None else turn @ axes


def _turn_to_pelvis(frame: str, state: RobotState) -> np.ndarray | None:
    """Return the rotation from a hand frame to the pelvis frame, shape (3, 3); None for the pelvis frame itself."""
    if frame == "pelvis":
        return None
    return rotations.to_matrix(state.orientation).T @ frame_axes(frame, state.orientation)

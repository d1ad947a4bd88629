"""Takeover of the arms by external targets, and hand-back, without a jump: joint motion within limits."""

import enum

import numpy as np

from hugwbc.controller import UpperBody
from hugwbc.numeric import smooth_step
from hugwbc.robot import Robot

TAKE_TIME = 0.5  # [s], of the blend from the arms' own position to the external targets
RETURN_TIME = 1.0  # [s], of the blend back
SPEED_SHARE = 0.5  # of the joint velocity limits, which the arm command never exceeds
ACCELERATION = 100.0  # [rad/s^2], likewise


class JointLimiter:
    """A limiter that follows a moving goal as closely as the limits allow, without overshoot where possible.

    In a tick the velocity changes by at most `acceleration_limit * dt`. Towards a goal and towards a position limit it
    stays below the speed from which the joint can still stop in time. Position limits have priority: if the length of
    the ticks changes during a stop, the acceleration may exceed its limit, but the position never does.

    Attributes:
        q: positions [rad], shape (n,).
        dq: velocities [rad/s], shape (n,).
        lower, upper: position limits [rad], shape (n,).
        velocity_limit: highest speeds [rad/s], shape (n,).
        acceleration_limit: highest acceleration of all joints [rad/s^2].
    """

    def __init__(
        self, lower: np.ndarray, upper: np.ndarray, velocity_limit: np.ndarray, acceleration_limit: float
    ) -> None:
        self.lower, self.upper = lower, upper
        self.velocity_limit = velocity_limit
        self.acceleration_limit = acceleration_limit
        self.place(np.clip(np.zeros_like(lower), lower, upper))

    def place(self, q: np.ndarray) -> None:
        """Start at rest from positions (n,) [rad]."""
        self.q = np.array(q, dtype=float)
        self.dq = np.zeros_like(self.q)

    def follow(self, goal: np.ndarray, goal_dq: np.ndarray, dt: float) -> np.ndarray:
        """Move for `dt` [s] towards a goal that moves at `goal_dq`, and return the new positions; all of shape (n,)."""
        behind = goal - self.q - goal_dq * dt
        speed = self._stopping_speed(np.concatenate((np.abs(behind), *self._room())), dt).reshape(3, -1)
        return self._move(goal_dq + np.copysign(speed[0], behind), speed[1], speed[2], dt)

    def stop(self, dt: float) -> np.ndarray:
        """Brake for `dt` [s] and return the new positions, shape (n,)."""
        up, down = self._stopping_speed(np.stack(self._room()), dt)
        return self._move(np.zeros_like(self.q), up, down, dt)

    def _room(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the room up and down to the position limits; outside them, only the way back is open."""
        return np.maximum(self.upper - self.q, 0.0), np.maximum(self.q - self.lower, 0.0)

    def _move(self, wanted: np.ndarray, up: np.ndarray, down: np.ndarray, dt: float) -> np.ndarray:
        """Move at the wanted speeds, clamped to the limits and to the highest speeds up and down; all of shape (n,)."""
        change = self.acceleration_limit * dt
        dq = np.minimum(np.maximum(wanted, self.dq - change), self.dq + change)
        self.dq = np.minimum(
            np.maximum(dq, -np.minimum(self.velocity_limit, down)), np.minimum(self.velocity_limit, up)
        )
        self.q = self.q + self.dq * dt
        return self.q.copy()

    def _stopping_speed(self, distance: np.ndarray, dt: float) -> np.ndarray:
        """Return the highest speed from which full braking in steps of `dt` ends within a distance.

        A stop in n steps, at speeds v, v - a dt, ..., covers n v dt - n (n - 1) / 2 a dt^2. Here n is the number of
        steps for which the last of these speeds is above 0 and at most a dt.
        """
        unit = self.acceleration_limit * dt
        steps = np.maximum(np.ceil(0.5 * np.sqrt(1.0 + 8.0 * distance / (unit * dt)) - 0.5), 1.0)
        return distance / (steps * dt) + 0.5 * unit * (steps - 1.0)


class Phase(enum.Enum):
    """The state of the hand-over: who moves the arms."""

    RELEASED = "released"  # the controller
    TAKEN = "taken"  # external targets, blended in at first
    RETURNING = "returning"  # on the way back to the controller's own pose


class Takeover:
    """A blend and rate limit for external arm targets from IK, a motion file or noise.

    The stream of arm commands starts at rest at the position that the caller names and keeps within the velocity and
    acceleration limits, whatever comes in.

    Attributes:
        phase: who moves the arms.
        velocity_limit: highest speed of the arm command [rad/s], shape (k,).
    """

    def __init__(self, robot: Robot) -> None:
        arms = robot.arms
        self.velocity_limit = robot.velocity_limit[arms] * SPEED_SHARE
        # These are the position limits of the safety filter. A controller without feed-forward torque may command its
        # own arms beyond the joint limits to carry their weight, and the blends start and end at its own command.
        lowest, highest = robot.target_range
        self._limiter = JointLimiter(lowest[arms], highest[arms], self.velocity_limit, ACCELERATION)
        self._rest = robot.nominal[arms]
        self._all = np.ones(arms.size, dtype=bool)
        self._from, self._elapsed = self._rest, 0.0
        self.reset()

    def reset(self) -> None:
        """Release the arms at once, at the nominal pose, for a new episode."""
        self.phase = Phase.RELEASED
        self._limiter.place(self._rest)

    def follow(
        self,
        q: np.ndarray,
        dq: np.ndarray,
        dt: float,
        start: np.ndarray | None = None,
        ddq: np.ndarray | None = None,
    ) -> UpperBody:
        """Return the arm command for one tick of external control.

        Args:
            q: target positions [rad], shape (k,).
            dq: target velocities [rad/s], shape (k,).
            dt: time since the last tick [s].
            start: the arm command before a takeover [rad], shape (k,), read only while the arms are released. None
                starts where the last takeover ended, at first in the nominal pose.
            ddq: accelerations of the targets' planned motion [rad/s^2], shape (k,). None takes those of the arm
                command, which would be wrong for targets that follow the measured body (`UpperBody.ddq`).
        """
        if self.phase is not Phase.TAKEN:
            known = self.phase is Phase.RELEASED and start is not None and np.all(np.isfinite(start))
            self._begin(Phase.TAKEN, np.asarray(start) if known else None)
        return self._advance(q, dq, ddq, TAKE_TIME, dt)

    def blend(self) -> None:
        """Restart the blend at the current arm command after the target source changed."""
        if self.phase is Phase.TAKEN:
            self._begin(Phase.TAKEN, None)

    def release(self, own: np.ndarray | None, dt: float) -> UpperBody:
        """Return the arm command for one tick of the way back; `UpperBody.none()` at its end.

        Args:
            own: the controller's own arm positions [rad], shape (k,); None returns to the nominal positions.
            dt: time since the last tick [s].
        """
        goal = self._rest if own is None else own
        if self.phase is Phase.TAKEN:
            self._begin(Phase.RETURNING, None)
        elif self.phase is Phase.RETURNING and self._arrived(goal, dt):
            self.phase = Phase.RELEASED
        if self.phase is Phase.RELEASED:
            return UpperBody.none()
        return self._advance(goal, np.zeros_like(goal), None, RETURN_TIME, dt)

    def _begin(self, phase: Phase, start: np.ndarray | None) -> None:
        """Start a blend at rest from positions (k,), or from the current arm command at its speed."""
        self.phase = phase
        if start is not None:
            self._limiter.place(start)
        self._from = self._limiter.q.copy()
        self._elapsed = 0.0

    def _arrived(self, goal: np.ndarray, dt: float) -> bool:
        within = bool(np.all(np.abs(goal - self._limiter.q) <= self.velocity_limit * dt))
        return within and self._elapsed >= RETURN_TIME

    def _advance(
        self, goal: np.ndarray, goal_dq: np.ndarray, goal_ddq: np.ndarray | None, blend_time: float, dt: float
    ) -> UpperBody:
        if not 0.0 < dt < np.inf:
            return UpperBody(self._limiter.q.copy(), np.zeros_like(goal), self._all)
        last, ddq = self._limiter.dq, None
        if np.isfinite(goal).all() and np.isfinite(goal_dq).all():
            before = smooth_step(self._elapsed / blend_time)
            self._elapsed += dt
            blend = smooth_step(self._elapsed / blend_time)
            # The derivative of the blend instead of a difference of positions, which would carry the sensors' noise.
            dq = blend * goal_dq + (blend - before) / dt * (goal - self._from)
            self._limiter.follow(self._from + blend * (goal - self._from), dq, dt)
            ddq = None if goal_ddq is None else blend * goal_ddq
        else:
            self._limiter.stop(dt)
        if ddq is None:
            ddq = (self._limiter.dq - last) / dt
        return UpperBody(self._limiter.q.copy(), self._limiter.dq.copy(), self._all, ddq)

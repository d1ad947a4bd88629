"""Joint motion within position, velocity and acceleration limits."""

import numpy as np


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
        steps for which this distance is enough.
        """
        unit = self.acceleration_limit * dt
        steps = np.maximum(np.ceil(0.5 * np.sqrt(1.0 + 8.0 * distance / (unit * dt)) - 0.5), 1.0)
        return distance / (steps * dt) + 0.5 * unit * (steps - 1.0)

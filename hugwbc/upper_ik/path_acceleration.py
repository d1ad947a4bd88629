"""Joint accelerations of the hand targets' own motion, for the feed-forward of the arm servo."""

import numpy as np
from eigenpy import LLT

_DAMPING = 0.05  # [m]; keeps the joint speeds of a stretched arm bounded
_RIDGE = _DAMPING**2 * np.eye(3)


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

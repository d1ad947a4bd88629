"""Trajectory of the swing foot: a quintic, re-planned at every tick from its own state to a moving target."""

import numpy as np

from hugwbc.mbc.params import ControllerParams

_SHORTEST = 0.02  # [s], below which a quintic to a moving target would ask for unbounded accelerations
_REST = np.zeros(3)


def quintic_advance(
    state: tuple[np.ndarray, np.ndarray, np.ndarray],
    target: tuple[np.ndarray, np.ndarray, np.ndarray],
    duration: np.ndarray,
    dt: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and acceleration after `dt` on the quintic from a state to a target.

    Args:
        state: position, velocity and acceleration now, each of shape (k,).
        target: position, velocity and acceleration after `duration`, each of shape (k,).
        duration: [s], positive, shape (k,).
        dt: [s]; beyond the end of the quintic, its end.
    """
    axes = np.array([*state, *target, duration]).T.tolist()
    x, v, a = np.array([_quintic(axis, dt) for axis in axes]).T
    return x, v, a


def _quintic(axis: list[float], dt: float) -> tuple[float, float, float]:
    """One axis of `quintic_advance`: on three numbers, floats are several times faster than arrays."""
    x, v, a, x_end, v_end, a_end, T = axis
    position = x_end - (x + v * T + 0.5 * a * T**2)
    velocity = v_end - (v + a * T)
    acceleration = a_end - a
    c3 = (10.0 * position - 4.0 * velocity * T + 0.5 * acceleration * T**2) / T**3
    c4 = (-15.0 * position + 7.0 * velocity * T - acceleration * T**2) / T**4
    c5 = (6.0 * position - 3.0 * velocity * T + 0.5 * acceleration * T**2) / T**5
    t = min(dt, T)
    return (
        x + t * (v + t * (0.5 * a + t * (c3 + t * (c4 + t * c5)))),
        v + t * (a + t * (3.0 * c3 + t * (4.0 * c4 + t * 5.0 * c5))),
        a + t * (6.0 * c3 + t * (12.0 * c4 + t * 20.0 * c5)),
    )


class SwingTrajectory:
    """Sole of one foot from lift-off through the apex to the foothold.

    Attributes:
        position, velocity, acceleration: of the plan, in the world [m], [m/s], [m/s^2], shape (3,).
    """

    def __init__(self, params: ControllerParams) -> None:
        self._params = params
        self.start(np.zeros(3))

    def start(self, position: np.ndarray) -> None:
        """Begin a swing at rest."""
        self.position = np.array(position, dtype=float)
        self.velocity = np.zeros(3)
        self.acceleration = np.zeros(3)

    def advance(
        self,
        foothold: np.ndarray,
        apex: float,
        ground: float,
        elapsed: float,
        remaining: float,
        dt: float,
        *,
        landing: float | None = None,
        overdue: float = 0.0,
    ) -> None:
        """Move the plan on by `dt`.

        Args:
            foothold: where the sole's centre is to land, world x and y [m], shape (2,).
            apex: sole height above the ground half way [m].
            ground: height of the ground [m].
            landing: height of the ground at the foothold, if it is another [m].
            overdue: time for which the foot should already have touched the ground [s].
            elapsed: since lift-off [s].
            remaining: until touch-down [s].
            dt: [s].
        """
        to_apex = 0.5 * (elapsed + remaining) - elapsed
        if to_apex > 0.0:
            height, speed, until = ground + apex, 0.0, to_apex
        else:
            searching = self._params.search_speed if overdue > 0.0 else self._params.landing_speed
            height = (ground if landing is None else landing) + self._params.landing_height
            height, speed, until = height - self._params.search_speed * overdue, -searching, remaining
        self.position, self.velocity, self.acceleration = quintic_advance(
            (self.position, self.velocity, self.acceleration),
            (np.array([*foothold.tolist(), height]), np.array([0.0, 0.0, speed]), _REST),
            np.array([max(remaining, _SHORTEST)] * 2 + [max(until, _SHORTEST)]),
            dt,
        )

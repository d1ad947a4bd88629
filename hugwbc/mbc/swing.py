"""Trajectory of the swing foot: polynomials, planned again at every tick from its own state to a moving target."""

import numpy as np

from hugwbc.mbc.params import ControllerParams

BRISKNESS = 4.0
"""Acceleration at the start of a swing and deceleration at its end, per way and squared duration. Of all quintics from
rest to rest that are symmetric in time, the one with this has the least peak of the acceleration."""
PEAK = 4.65
"""That greatest acceleration. With a smooth start and a smooth end it is 10 / sqrt(3) = 5.77."""
_SHORTEST = 0.02  # [s]; a shorter quintic to a moving target would ask for unbounded accelerations


def quintic_advance(
    x: float, v: float, a: float, x_end: float, v_end: float, a_end: float, T: float, dt: float
) -> tuple[float, float, float]:
    """Return position, velocity and acceleration `dt` [s] later, at most T, on the quintic to a state after T [s].

    It works on one axis at a time: on three numbers, floats are several times faster than arrays.
    """
    # How far constant acceleration misses the target at T in position, velocity and acceleration, as lengths.
    position = x_end - (x + v * T + 0.5 * a * T * T)
    velocity = (v_end - (v + a * T)) * T
    acceleration = (a_end - a) * T * T
    cube = T * T * T
    c3 = (10.0 * position - 4.0 * velocity + 0.5 * acceleration) / cube
    c4 = (-15.0 * position + 7.0 * velocity - acceleration) / (cube * T)
    c5 = (6.0 * position - 3.0 * velocity + 0.5 * acceleration) / (cube * T * T)
    t = min(dt, T)
    return (
        x + t * (v + t * (0.5 * a + t * (c3 + t * (c4 + t * c5)))),
        v + t * (a + t * (3.0 * c3 + t * (4.0 * c4 + t * 5.0 * c5))),
        a + t * (6.0 * c3 + t * (12.0 * c4 + t * 20.0 * c5)),
    )


FALL = 1.875
"""Highest speed of a foot's fall, over the apex and the duration of the fall: half-way down, as of a quintic from rest
to rest."""
WAY = quintic_advance(0.0, 0.0, BRISKNESS, 1.0, 0.0, -BRISKNESS, 1.0, 0.75)[:2]
"""How far the foot has come then along the ground, and its speed, over the whole way and the duration of the swing."""


def cubic_advance(x: float, v: float, x_end: float, v_end: float, T: float, dt: float) -> tuple[float, float, float]:
    """Return position, velocity and acceleration after `dt` on the cubic from a state to a target.

    Between two states of rest its highest speed is 1.5 times the mean; that of a quintic is 1.875 times. Arguments as
    in `quintic_advance`.
    """
    position, velocity = x_end - (x + v * T), (v_end - v) * T
    c2 = (3.0 * position - velocity) / (T * T)
    c3 = (velocity - 2.0 * position) / (T * T * T)
    t = min(dt, T)
    return x + t * (v + t * (c2 + t * c3)), v + t * (2.0 * c2 + t * 3.0 * c3), 2.0 * c2 + t * 6.0 * c3


class SwingTrajectory:
    """Path of one sole from lift-off through the apex to the foothold.

    It starts from its own planned state and not from the measured foot, so that tracking errors do not feed back.

    Attributes:
        position, velocity, acceleration: planned motion, world axes [m], [m/s], [m/s^2], shape (3,).
    """

    def __init__(self, params: ControllerParams) -> None:
        self._params = params
        self.start(np.zeros(3))

    def start(self, position: np.ndarray) -> None:
        """Start a swing at rest at a position in the world [m], shape (3,)."""
        self._axes = tuple((x, 0.0, 0.0) for x in position.tolist())
        self.position, self.velocity, self.acceleration = np.array(self._axes).T
        self._origin: tuple[float, float] | None = None

    def shift(self, offset: np.ndarray) -> None:
        """Move the plan after the estimate of the position jumped by `offset` [m], shape (3,)."""
        self._axes = tuple((x + by, v, a) for (x, v, a), by in zip(self._axes, offset.tolist(), strict=True))
        self.position = self.position + offset
        if self._origin is not None:
            self._origin = self._origin[0] + float(offset[0]), self._origin[1] + float(offset[1])

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
        briskness: float = 0.0,
    ) -> None:
        """Advance the plan by one tick.

        Args:
            foothold: where the centre of the sole should land, world x and y [m], shape (2,).
            apex: height of the sole above the ground half-way [m].
            ground: height of the ground in the world [m].
            elapsed: time since lift-off [s].
            remaining: time until touch-down [s].
            dt: duration of the tick [s].
            landing: height of the ground at the foothold, if different [m].
            overdue: time for which the foot should already have touched the ground [s].
            briskness: acceleration along the ground with which the swing starts, and deceleration with which it ends,
                per way and squared duration.
        """
        to_apex = 0.5 * (elapsed + remaining) - elapsed
        if to_apex > 0.0:
            height, speed, until = ground + apex, 0.0, to_apex
        else:
            # Ends a little below the ground and moving down, so that it touches. When overdue, it keeps searching.
            searching = self._params.search_speed if overdue > 0.0 else self._params.landing_speed
            height = (ground if landing is None else landing) + self._params.landing_height
            height, speed, until = height - self._params.search_speed * overdue, -searching, remaining
        x, y = foothold.tolist()
        pace = (elapsed + remaining) ** -2
        if self._origin is None:
            (from_x, *_), (from_y, *_), rise = self._axes
            self._origin = from_x, from_y
            start = briskness * pace
            self._axes = (from_x, 0.0, start * (x - from_x)), (from_y, 0.0, start * (y - from_y)), rise
        ahead, aside = x - self._origin[0], y - self._origin[1]
        stop = -briskness * pace
        remaining, until = max(remaining, _SHORTEST), max(until, _SHORTEST)
        self._axes = (
            quintic_advance(*self._axes[0], x, 0.0, stop * ahead, remaining, dt),
            quintic_advance(*self._axes[1], y, 0.0, stop * aside, remaining, dt),
            # The rise strains the speed of the knee: for the same apex a cubic needs a fifth less of it than a quintic.
            # The fall lands softly, by a quintic that starts with the cubic's acceleration.
            cubic_advance(*self._axes[2][:2], height, speed, until, dt)
            if to_apex > 0.0
            else quintic_advance(*self._axes[2], height, speed, 0.0, until, dt),
        )
        self.position, self.velocity, self.acceleration = np.array(self._axes).T

"""Paths of a hand over time: points, lines, grids, circles, swings and random walks.

A path starts at t = 0; after its end, if it has one, the hand stays at its last position. Coordinates are in the frame
that the hand motion names (see `hugwbc.targets.HandTargets`). Recorded paths are read from CSV files.
"""

import functools
import itertools
import logging
import math
import pathlib
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from hugwbc.errors import ConfigError, TargetError
from hugwbc.numeric import smooth_step
from hugwbc.scripts.sampled import check_times, read_table
from hugwbc.settings import Count, NotNegative, Positive, Seed, settings
from hugwbc.targets import FARTHEST

Coordinate = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST)]  # [m]
Point = tuple[Coordinate, Coordinate, Coordinate]
Axis = Literal["x", "y", "z"]
MOST_POINTS = 100_000  # in a grid; at one second each, they take more than a day


@settings
class HandPath:
    """The position of a hand over time; base class of all paths."""

    def at(self, t: float) -> np.ndarray:
        """Return the position at time `t` [s] since the path's start [m], shape (3,)."""
        raise NotImplementedError

    def mirrored(self) -> "HandPath":
        """Return the mirrored path for the other hand: y changes sign."""
        return Mirrored(self)


@settings
class Mirrored(HandPath):
    """The path of the other hand with the sign of y changed."""

    path: HandPath

    def at(self, t: float) -> np.ndarray:  # noqa: D102
        return self.path.at(t) * [1.0, -1.0, 1.0]


@settings
class Hold(HandPath):
    """A hand that stays at a point [m]."""

    point: Point

    def at(self, t: float) -> np.ndarray:  # noqa: D102
        return np.array(self.point, dtype=float)


@settings
class Line(HandPath):
    """Straight legs from point to point, each with a minimum-jerk speed profile.

    Attributes:
        points: at least two points [m].
        leg_time: time of each leg [s].
        dwell: pause at each point, including the first [s].
        repeat: whether to go back through the points and start again, for ever.
    """

    points: Annotated[tuple[Point, ...], Field(min_length=2)]
    leg_time: Positive = 1.0
    dwell: NotNegative = 0.0
    repeat: bool = False

    def at(self, t: float) -> np.ndarray:  # noqa: D102
        legs = len(self.points) - 1
        leg, within = divmod(max(t, 0.0), self.leg_time + self.dwell)
        way = leg + smooth_step((within - self.dwell) / self.leg_time)
        if self.repeat:
            way = legs - abs(way % (2 * legs) - legs)
        way = min(way, float(legs))
        index = min(int(way), legs - 1)
        before, after = np.asarray(self.points[index]), np.asarray(self.points[index + 1])
        return before + (way - index) * (after - before)


@settings
class Grid(HandPath):
    """A visit to every point of a box-shaped grid, from neighbour to neighbour: x changes slowest, z fastest.

    Attributes:
        centre: centre of the box [m].
        size: size of the box along x, y and z [m].
        count: number of points along x, y and z.
        leg_time: time from point to point [s].
        dwell: pause at each point [s].
    """

    centre: Point
    size: Point
    count: tuple[Count, Count, Count] = (2, 2, 2)
    leg_time: Positive = 1.0
    dwell: NotNegative = 0.5

    def __post_init__(self) -> None:
        if not 2 <= math.prod(self.count) <= MOST_POINTS:
            raise ConfigError(f"count is {self.count}; give 2 to {MOST_POINTS} points in all", at=("count",))

    @functools.cached_property
    def _line(self) -> Line:
        ticks = [np.linspace(-0.5, 0.5, n) if n > 1 else np.zeros(1) for n in self.count]
        points: list[Point] = []
        for x, y, z in itertools.product(*(range(len(tick)) for tick in ticks)):
            row = x * len(ticks[1]) + y
            y = y if x % 2 == 0 else len(ticks[1]) - 1 - y
            z = z if row % 2 == 0 else len(ticks[2]) - 1 - z
            offset = np.array([ticks[0][x], ticks[1][y], ticks[2][z]]) * self.size
            points.append(tuple((np.asarray(self.centre) + offset).tolist()))
        return Line(tuple(points), self.leg_time, self.dwell)

    @property
    def points(self) -> tuple[Point, ...]:
        """The points in the order of the visit [m]."""
        return self._line.points

    def at(self, t: float) -> np.ndarray:  # noqa: D102
        return self._line.at(t)


@settings
class Circle(HandPath):
    """A circle, run through counter-clockwise about an axis through its centre.

    Attributes:
        centre: centre of the circle [m].
        radius: radius of the circle [m].
        axis: axis of rotation. The hand starts on the x side of a circle about z, y of x, and z of y.
        period: time of a turn [s].
        phase: angle at which the hand starts, in turns.
    """

    centre: Point
    radius: Positive
    axis: Axis = "x"
    period: Positive = 4.0
    phase: float = 0.0

    def at(self, t: float) -> np.ndarray:  # noqa: D102
        angle = 2.0 * math.pi * (t / self.period + self.phase)
        normal = "xyz".index(self.axis)
        point = np.array(self.centre, dtype=float)
        point[(normal + 1) % 3] += self.radius * math.cos(angle)
        point[(normal + 2) % 3] += self.radius * math.sin(angle)
        return point


@settings
class Swing(HandPath):
    """A swing about a point: position = centre + amplitude * sin(2 pi (t / period + phase)), for each axis.

    Attributes:
        centre: middle of the swing [m].
        amplitude: amplitudes along x, y and z [m].
        phase: phase of each axis, in periods; (0, 0.25, 0) makes an ellipse of x and y.
        period: time of a swing there and back [s].
    """

    centre: Point
    amplitude: Point = (0.0, 0.0, 0.0)
    phase: Point = (0.0, 0.0, 0.0)
    period: Positive = 4.0

    def at(self, t: float) -> np.ndarray:  # noqa: D102
        angle = 2.0 * math.pi * (t / self.period + np.asarray(self.phase))
        return np.asarray(self.centre) + np.asarray(self.amplitude) * np.sin(angle)


@settings
class Wander(HandPath):
    """A random walk between points drawn uniformly from a box, for ever; equal seeds give equal walks.

    Attributes:
        centre: centre of the box [m].
        size: size of the box along x, y and z [m].
        leg_time: time from point to point [s].
        seed: seed of the points.
    """

    centre: Point
    size: Point
    leg_time: Positive = 1.0
    seed: Seed = 0

    def at(self, t: float) -> np.ndarray:  # noqa: D102
        leg, within = divmod(max(t, 0.0), self.leg_time)
        before, after = _wander_corner(self, int(leg)), _wander_corner(self, int(leg) + 1)
        return before + smooth_step(within / self.leg_time) * (after - before)


@functools.lru_cache(maxsize=256)
def _wander_corner(path: Wander, index: int) -> np.ndarray:
    draw = np.random.default_rng((path.seed, index)).uniform(-0.5, 0.5, 3)
    return np.asarray(path.centre) + draw * path.size


_log = logging.getLogger(__name__)
_COLUMNS = "t,x,y,z"


@settings
class Recorded(HandPath):
    """A path through samples, linear between them; it starts with the first, whatever the clock."""

    time: tuple[float, ...]  # times of the samples, increasing [s]
    points: tuple[Point, ...]  # positions at these times [m]

    def __post_init__(self) -> None:
        if not self.time or len(self.points) != len(self.time):
            raise TargetError(
                f"recorded path has {len(self.time)} times and {len(self.points)} points; give one x, y, z each"
            )
        check_times("recorded path", np.array(self.time))
        if self.time[0] != 0.0:
            _log.warning("a recorded path starts at t = %.10g s on its clock; it is played from there", self.time[0])

    @functools.cached_property
    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Times since the first sample [s], shape (n,), and positions [m], shape (n, 3)."""
        return np.array(self.time, dtype=float) - self.time[0], np.array(self.points, dtype=float)

    def at(self, t: float) -> np.ndarray:  # noqa: D102
        time, points = self.samples
        return np.array([np.interp(t, time, points[:, axis]) for axis in range(3)])


def read_path(path: str | pathlib.Path) -> Recorded:
    """Read a recorded path from a CSV file with a header line and the columns t, x, y, z [s, m]."""
    names, table = read_table(path, _COLUMNS)
    if names != _COLUMNS.split(","):
        raise TargetError(f"{path}:1: the header is {','.join(names) or 'missing'}; write {_COLUMNS}")
    gaps = np.flatnonzero(~np.isfinite(table).all(axis=1))
    if gaps.size:
        raise TargetError(
            f"{path}: {gaps.size} of {len(table)} samples are not finite, the first at t = {table[gaps[0], 0]:g} s; "
            "fill the gap, or delete these lines to go straight across"
        )
    return Recorded(tuple(table[:, 0].tolist()), tuple(map(tuple, table[:, 1:].tolist())))

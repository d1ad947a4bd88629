"""Paths of a hand over time: points, lines, grids, circles, swings and random walks.

A path starts at t = 0, and its last position holds for ever. Coordinates are in the frame that the hand motion names
(see `hugwbc.targets.HandTargets`). Recorded paths are in `hugwbc.scripts.recorded_path`.
"""

import dataclasses
import functools
import itertools
import math
from typing import Literal, get_args

import numpy as np

from hugwbc.blends import smooth_step
from hugwbc.errors import TargetError, UnknownNameError
from hugwbc.targets import position

Point = tuple[float, float, float]
Axis = Literal["x", "y", "z"]
AXES: tuple[Axis, ...] = get_args(Axis)
MOST_POINTS = 100_000  # in a grid; at one second each, they take more than a day


@dataclasses.dataclass(frozen=True)
class HandPath:
    """The position of a hand over time; base class of all paths."""

    def at(self, t: float) -> np.ndarray:
        """Return the position at time `t` [s] since the path's start [m], shape (3,)."""
        raise NotImplementedError

    def mirrored(self) -> "HandPath":
        """Return the mirrored path for the other hand: y changes sign."""
        return Mirrored(self)


@dataclasses.dataclass(frozen=True)
class Mirrored(HandPath):
    """The path of the other hand with the sign of y changed."""

    path: HandPath

    def at(self, t: float) -> np.ndarray:
        """Return the position [m] at time `t` [s], shape (3,)."""
        return self.path.at(t) * [1.0, -1.0, 1.0]


@dataclasses.dataclass(frozen=True)
class Hold(HandPath):
    """A hand that stays at a point [m]."""

    point: Point

    def __post_init__(self) -> None:
        position("hand path's point", self.point)

    def at(self, t: float) -> np.ndarray:
        """Return the point [m], shape (3,)."""
        return np.array(self.point, dtype=float)


@dataclasses.dataclass(frozen=True)
class Line(HandPath):
    """Straight legs from point to point, each with a minimum-jerk speed profile.

    Attributes:
        points: at least two points [m].
        leg_time: time of each leg [s].
        dwell: pause at each point, including the first [s].
        repeat: whether to go back through the points and start again, for ever.
    """

    points: tuple[Point, ...]
    leg_time: float = 1.0
    dwell: float = 0.0
    repeat: bool = False

    def __post_init__(self) -> None:
        if len(self.points) < 2:
            raise TargetError(f"line's points are {self.points}; give at least two points x, y, z")
        for index, point in enumerate(self.points):
            position(f"line's point {index + 1}", point)
        _check_times("line", leg_time=self.leg_time)
        if not (math.isfinite(self.dwell) and self.dwell >= 0.0):
            raise TargetError(f"line's dwell is {self.dwell}; give a finite number of seconds from 0")

    def at(self, t: float) -> np.ndarray:
        """Return the position [m] at time `t` [s], shape (3,)."""
        legs = len(self.points) - 1
        leg, within = divmod(max(t, 0.0), self.leg_time + self.dwell)
        way = leg + smooth_step((within - self.dwell) / self.leg_time)
        if self.repeat:
            way = legs - abs(way % (2 * legs) - legs)
        way = min(way, float(legs))
        index = min(int(way), legs - 1)
        before, after = np.asarray(self.points[index]), np.asarray(self.points[index + 1])
        return before + (way - index) * (after - before)


@dataclasses.dataclass(frozen=True)
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
    count: tuple[int, int, int] = (2, 2, 2)
    leg_time: float = 1.0
    dwell: float = 0.5

    def __post_init__(self) -> None:
        position("grid's centre", self.centre)
        position("grid's size", self.size)
        whole = len(self.count) == 3 and all(math.isfinite(n) and n == int(n) and n >= 1 for n in self.count)
        if not whole or not 2 <= math.prod(self.count) <= MOST_POINTS:
            raise TargetError(
                f"grid's count is {self.count}; give three whole numbers from 1, in all 2 to {MOST_POINTS} points"
            )
        self._line.at(0.0)  # raises on bad times now instead of in the control loop

    @functools.cached_property
    def _line(self) -> Line:
        ticks = [np.linspace(-0.5, 0.5, int(n)) if n > 1 else np.zeros(1) for n in self.count]
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

    def at(self, t: float) -> np.ndarray:
        """Return the position [m] at time `t` [s], shape (3,)."""
        return self._line.at(t)


@dataclasses.dataclass(frozen=True)
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
    radius: float
    axis: Axis = "x"
    period: float = 4.0
    phase: float = 0.0

    def __post_init__(self) -> None:
        position("circle's centre", self.centre)
        _check_times("circle", period=self.period)
        if not (math.isfinite(self.radius) and self.radius > 0.0 and math.isfinite(self.phase)):
            raise TargetError(
                f"circle's radius is {self.radius} and phase {self.phase}; give finite ones, radius above 0"
            )
        if self.axis not in AXES:
            raise UnknownNameError("axis", self.axis, AXES)

    def at(self, t: float) -> np.ndarray:
        """Return the position [m] at time `t` [s], shape (3,)."""
        angle = 2.0 * math.pi * (t / self.period + self.phase)
        normal = AXES.index(self.axis)
        point = np.array(self.centre, dtype=float)
        point[(normal + 1) % 3] += self.radius * math.cos(angle)
        point[(normal + 2) % 3] += self.radius * math.sin(angle)
        return point


@dataclasses.dataclass(frozen=True)
class Swing(HandPath):
    """A swing about a point: position = centre + amplitude * sin(2 pi (t / period + phase)), for each axis.

    Attributes:
        centre: middle of the swing [m].
        amplitude: amplitudes along x, y and z [m].
        phase: phase of each axis, in periods; (0, 0.25, 0) makes an ellipse of x and y.
        period: time of a swing [s].
    """

    centre: Point
    amplitude: Point = (0.0, 0.0, 0.0)
    phase: Point = (0.0, 0.0, 0.0)
    period: float = 4.0

    def __post_init__(self) -> None:
        for name in ("centre", "amplitude", "phase"):
            position(f"swing's {name}", getattr(self, name))
        _check_times("swing", period=self.period)

    def at(self, t: float) -> np.ndarray:
        """Return the position [m] at time `t` [s], shape (3,)."""
        angle = 2.0 * math.pi * (t / self.period + np.asarray(self.phase))
        return np.asarray(self.centre) + np.asarray(self.amplitude) * np.sin(angle)


@dataclasses.dataclass(frozen=True)
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
    leg_time: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        position("wander's centre", self.centre)
        position("wander's size", self.size)
        _check_times("wander", leg_time=self.leg_time)
        if not math.isfinite(self.seed) or self.seed != int(self.seed) or self.seed < 0:
            raise TargetError(f"wander's seed is {self.seed}; give a whole number from 0")

    def at(self, t: float) -> np.ndarray:
        """Return the position [m] at time `t` [s], shape (3,)."""
        leg, within = divmod(max(t, 0.0), self.leg_time)
        before, after = self._corner(int(leg)), self._corner(int(leg) + 1)
        return before + smooth_step(within / self.leg_time) * (after - before)

    def _corner(self, index: int) -> np.ndarray:
        return _wander_corner(self, index)


@functools.lru_cache(maxsize=256)
def _wander_corner(path: Wander, index: int) -> np.ndarray:
    draw = np.random.default_rng((int(path.seed), index)).uniform(-0.5, 0.5, 3)
    return np.asarray(path.centre) + draw * path.size


def _check_times(kind: str, **times: float) -> None:
    for name, value in times.items():
        if not (math.isfinite(value) and value > 0.0):
            raise TargetError(f"{kind}'s {name} is {value}; give a finite number of seconds above 0")

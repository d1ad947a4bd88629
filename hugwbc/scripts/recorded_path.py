"""Recorded paths of a hand: samples over time, read from CSV files."""

import functools
import logging
import pathlib

import numpy as np

from hugwbc.errors import TargetError
from hugwbc.scripts.hand_paths import HandPath, Point
from hugwbc.scripts.sampled import check_times, read_table
from hugwbc.settings import settings

_log = logging.getLogger(__name__)
_COLUMNS = "t,x,y,z"


@settings
class Recorded(HandPath):
    """A path through samples, linear between them; it starts with the first, whatever the clock.

    Attributes:
        time: times of the samples, increasing [s].
        points: positions at these times [m].
    """

    time: tuple[float, ...]
    points: tuple[Point, ...]

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

    def at(self, t: float) -> np.ndarray:
        """Return the position [m] at time `t` [s], shape (3,)."""
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

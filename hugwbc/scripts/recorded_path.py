"""Recorded paths of a hand: samples over time, read from CSV files."""

import csv
import functools
import pathlib

import numpy as np

from hugwbc.errors import TargetError
from hugwbc.scripts.hand_paths import HandPath, Point
from hugwbc.settings import settings


@settings
class Recorded(HandPath):
    """A path through samples, linear between them.

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
        if np.any(np.diff(self.time) <= 0.0):
            raise TargetError("recorded path's times do not rise; sort the samples and remove repeated times")

    @functools.cached_property
    def _arrays(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array(self.time, dtype=float), np.array(self.points, dtype=float)

    def at(self, t: float) -> np.ndarray:
        """Return the position [m] at time `t` [s], shape (3,)."""
        time, points = self._arrays
        return np.array([np.interp(t, time, points[:, axis]) for axis in range(3)])


def read_path(path: str | pathlib.Path) -> Recorded:
    """Read a recorded path from a CSV file with a header line and the columns t, x, y, z [s, m].

    Empty lines are skipped.
    """
    try:  # spreadsheets start their files with a byte order mark
        with pathlib.Path(path).open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise TargetError(f"cannot read the hand path {path}: {error}; give a CSV file with columns t,x,y,z") from error
    if not rows or [name.strip() for name in rows[0]] != ["t", "x", "y", "z"]:
        raise TargetError(f"{path}:1: the header is {','.join(rows[0]) if rows else 'missing'}; write t,x,y,z")
    samples: list[list[float]] = []
    for number, row in enumerate(rows[1:], start=2):
        if not row:
            continue
        try:
            t, x, y, z = map(float, row)
        except ValueError:
            raise TargetError(f"{path}:{number}: '{','.join(row)}' is not four numbers t,x,y,z") from None
        samples.append([t, x, y, z])
    return Recorded(tuple(s[0] for s in samples), tuple((s[1], s[2], s[3]) for s in samples))

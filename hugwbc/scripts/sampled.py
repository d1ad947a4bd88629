"""Samples over time: tables, and checks that tell seconds, metres and radians from other units."""

import csv
import pathlib

import numpy as np

from hugwbc.errors import ConfigError

_APART = (1.0, 100.0)  # [s] between recorded samples, and declared ones, from which times may be in another unit
_UNITS = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}


def read_table(path: str | pathlib.Path, columns: str) -> tuple[list[str], np.ndarray]:
    """Return the names in the first line of a CSV file and its numbers, (rows, names); `columns` is for messages."""
    try:  # spreadsheets start their files with a byte order mark
        with pathlib.Path(path).open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"cannot read {path}: {error}; give a CSV file with the columns {columns}") from error
    names = [name.strip() for name in rows[0]] if rows else []
    table = []
    for number, row in enumerate(rows[1:], start=2):
        if row and len(row) != len(names):
            raise ConfigError(f"{path}:{number}: {len(row)} numbers for {len(names)} columns; give {columns}")
        try:
            table += [[float(value) for value in row]] if row else []
        except ValueError as error:
            raise ConfigError(f"{path}:{number}: {error}; give numbers for {columns}") from None
    return names, np.array(table).reshape(len(table), len(names))


def check_times(what: str, time: np.ndarray) -> None:
    """Refuse times that do not rise."""
    wrong = np.flatnonzero(~(np.diff(time) > 0.0))  # a NaN fails the comparison
    if wrong.size:
        before, after = time[wrong[0] : wrong[0] + 2]
        raise ConfigError(
            f"{what}: {wrong.size} times do not rise, the first from {before:.10g} to {after:.10g} s; sort the "
            "samples, and write times with enough decimals"
        )


def check_pace(
    what: str,
    time: np.ndarray,
    moved: np.ndarray,
    unit: str,
    pace: tuple[float, float],
    least: float,
    *,
    exact: bool = False,
) -> None:
    """Refuse samples that jump, or that are so slow that their times must be in another unit than seconds.

    Args:
        what: the subject of messages.
        time: times that rise [s], shape (n,).
        moved: how far it goes from each sample to the next, shape (n - 1,).
        unit: of `moved`.
        pace: speed that whatever moves reaches, and speed that it never reaches [unit/s].
        least: distance that is no noise of a measurement [unit].
        exact: whether the samples are declared, not recorded: they may be slow, and a short distance may be a jump.
    """
    if not moved.size:
        return
    steps = np.diff(time)
    step = float(np.median(steps))
    speed = moved / np.maximum(steps, step)  # stamps are rounded, and messages arrive in bursts
    if step >= _APART[exact] and speed.max() < pace[0] and moved.sum() > least:
        name = next((name for name, factor in _UNITS.items() if step <= factor), "nanoseconds")
        raise ConfigError(
            f"{what} moves by at most {speed.max():.2g} {unit}/s, with {step:g} s between samples: "
            f"its times look like {name}; give seconds"
        )
    jumps = np.flatnonzero((speed > pace[1]) & (exact | (moved > least)))
    if jumps.size:
        first = jumps[0]
        raise ConfigError(
            f"{what} jumps by {moved[first]:.3g} {unit} within {steps[first]:.3g} s at {time[first] - time[0]:.3f} s; "
            f"{jumps.size / moved.size:.1%} of its steps are faster than {pace[1]:g} {unit}/s; fill or cut the gap, "
            "and give all samples in the same unit"
        )


def resampled(values: np.ndarray, fps: float, to: float) -> np.ndarray:
    """Return rows at another rate, two at least, by linear interpolation; an incomplete last interval is dropped."""
    index = np.arange(max(1, int((len(values) - 1) / fps * to + 1e-9)) + 1) / to * fps
    flat = values.reshape(len(values), -1)
    columns = [np.interp(index, np.arange(len(values)), column) for column in flat.T]
    return np.stack(columns, axis=1).reshape(len(index), *values.shape[1:])

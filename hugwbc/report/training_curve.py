"""The record of a policy's training, which a training run writes next to the policy."""

import csv
import pathlib

import numpy as np

from hugwbc.errors import ConfigError

TRAINING_FILE = "training.csv"
_STAGE = "stage"  # column of a recipe's record: the name of the stage, text


def read_training(path: pathlib.Path) -> dict[str, np.ndarray]:
    """Read the columns of numbers of a training record by name, with NaN for empty cells."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"cannot read the training record {path}: {error}; repair it or move it away") from error
    if not rows or "steps" not in rows[0]:
        raise ConfigError(f"{path} has no column 'steps'; give a training record as `hugwbc train` writes it")
    try:
        return {name: np.array([float(row[name] or "nan") for row in rows]) for name in rows[0] if name != _STAGE}
    except (ValueError, TypeError) as error:  # no number, or more cells than columns
        raise ConfigError(f"{path} is not a training record: {error}; repair it or move it away") from error


def smoothed(values: np.ndarray, window: int = 9) -> np.ndarray:
    """Return the running mean over `window` values, fewer at the ends; values that are not finite are left out."""
    known = np.isfinite(values)
    kernel = np.ones(min(window, len(values)))
    total = np.convolve(np.where(known, values, 0.0), kernel, mode="same")
    count = np.convolve(known.astype(float), kernel, mode="same")
    return np.where(count > 0, total / np.maximum(count, 1.0), np.nan)

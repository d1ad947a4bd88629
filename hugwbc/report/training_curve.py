"""The record of a policy's training, which a training run writes next to the policy."""

import pathlib

import numpy as np
import polars as pl

from hugwbc.errors import ConfigError

TRAINING_FILE = "training.csv"
_STAGE = "stage"  # column of a recipe's record: the name of the stage, text


def read_training(path: pathlib.Path) -> dict[str, np.ndarray]:
    """Read the columns of numbers of a training record by name, with NaN for empty cells."""
    try:
        frame = pl.read_csv(path, infer_schema=False).select(pl.exclude(_STAGE).cast(pl.Float64))
    except (OSError, pl.exceptions.PolarsError) as error:
        raise ConfigError(f"{path} is not a training record: {error}; repair it or move it away") from error
    if "steps" not in frame.columns:
        raise ConfigError(f"{path} has no column 'steps'; give a training record as `hugwbc train` writes it")
    return {name: frame[name].fill_null(float("nan")).to_numpy() for name in frame.columns}


def smoothed(values: np.ndarray, window: int = 9) -> np.ndarray:
    """Return the running mean over `window` values, fewer at the ends; values that are not finite are left out."""
    known = pl.Series(np.where(np.isfinite(values), values, np.nan)).fill_nan(None)
    return known.rolling_mean(window, min_samples=1, center=True).fill_null(float("nan")).to_numpy()

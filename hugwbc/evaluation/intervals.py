"""How sure a mean over episodes is."""

import dataclasses
import math
import statistics
from collections.abc import Iterable, Sequence

import numpy as np

RESAMPLES = 2000
CONFIDENCE = 0.95
_SEED = 0  # of the resampling, so that the same results give the same page


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A mean with its interval.

    Attributes:
        value: the mean; None if there was no sample.
        low, high: bounds of its interval of confidence `CONFIDENCE`; None for fewer than two samples.
        samples: how many it is the mean of.
    """

    value: float | None
    low: float | None
    high: float | None
    samples: int


def wilson_percentage(happened: Sequence[bool]) -> Estimate:
    """In what part of some episodes something happened [%], with its score interval (Wilson 1927).

    Unlike a bootstrap it has a width where it never happened: none of four episodes is little to go by.
    """
    count = len(happened)
    if count == 0:
        return Estimate(None, None, None, 0)
    z, part = statistics.NormalDist().inv_cdf((1.0 + CONFIDENCE) / 2), sum(happened) / count
    centre = (part + z * z / (2 * count)) / (1.0 + z * z / count)
    half = z / (1.0 + z * z / count) * math.sqrt(part * (1.0 - part) / count + (z / (2 * count)) ** 2)
    low, high = max(0.0, centre - half), min(1.0, centre + half)
    return Estimate(100.0 * part, 100.0 * low, 100.0 * high, count)


def bootstrap_mean(samples: Iterable[float | None]) -> Estimate:
    """Mean and percentile bootstrap interval (Efron & Tibshirani 1993, chapter 13); samples that are None are left out.

    Of few samples it is too narrow, as all intervals that assume nothing about the distribution.
    """
    known = np.array([sample for sample in samples if sample is not None], dtype=float)
    if known.size == 0:
        return Estimate(None, None, None, 0)
    if known.size == 1:
        return Estimate(float(known[0]), None, None, 1)
    rng = np.random.default_rng(_SEED)
    means = known[rng.integers(known.size, size=(RESAMPLES, known.size))].mean(axis=1)
    low, high = np.quantile(means, ((1.0 - CONFIDENCE) / 2, (1.0 + CONFIDENCE) / 2)).tolist()
    return Estimate(float(known.mean()), low, high, int(known.size))

"""Confidence intervals of means over episodes."""

import dataclasses
import math
import statistics
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from scipy.special import bdtr, stdtrit

RESAMPLES = 2000
CONFIDENCE = 0.95
FEW = 8  # samples, below which a bootstrap interval is too narrow
_SEED = 0  # of the resampling, fixed so that the same results give the same page


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A statistic of samples, such as a mean, with the bounds of its confidence interval; None for bounds it lacks."""

    value: float | None  # the statistic; None without a sample
    low: float | None
    high: float | None
    samples: int  # number of samples


def single(value: float | None) -> Estimate:
    """Return a number without an interval."""
    return Estimate(value, None, None, 0 if value is None else 1)


def scaled(estimate: Estimate, factor: float) -> Estimate:
    """Return an estimate in another unit."""
    value, low, high = (None if v is None else factor * v for v in (estimate.value, estimate.low, estimate.high))
    return Estimate(value, low, high, estimate.samples)


def known(value: float) -> float | None:
    """Return the value, or None if it is not finite."""
    return value if math.isfinite(value) else None


def wilson_percentage(happened: Iterable[bool]) -> Estimate:
    """Return the percentage of episodes in which something happened, with its score interval (Wilson 1927).

    Unlike a bootstrap interval it has a width even if nothing happened: no fall in four episodes says little.
    """
    outcomes = list(happened)
    return wilson_of(sum(outcomes), len(outcomes))


def wilson_of(times: int, count: int) -> Estimate:
    """Return the same as `wilson_percentage` for something that happened in `times` of `count` episodes."""
    if count == 0:
        return Estimate(None, None, None, 0)
    z, part = statistics.NormalDist().inv_cdf((1.0 + CONFIDENCE) / 2), times / count
    centre = (part + z * z / (2 * count)) / (1.0 + z * z / count)
    half = z / (1.0 + z * z / count) * math.sqrt(part * (1.0 - part) / count + (z / (2 * count)) ** 2)
    low, high = centre - half if times else 0.0, centre + half if times < count else 1.0  # exact at the ends
    return Estimate(100.0 * part, 100.0 * low, 100.0 * high, count)


def bootstrap_mean(samples: Iterable[float | None]) -> Estimate:
    """Return the mean with its expanded percentile bootstrap interval; None is left out.

    Hesterberg 2015, "What Teachers Should Know About the Bootstrap", The American Statistician 69, 371-386. Below `FEW`
    samples the interval is still too narrow, as it cannot reach beyond them.
    """
    return _bootstrap(samples, np.mean)


def bootstrap_median(samples: Iterable[float | None]) -> Estimate:
    """Return the median with the interval of `bootstrap_mean`; None is left out."""
    return _bootstrap(samples, np.median)


def _bootstrap(samples: Iterable[float | None], statistic: Callable[..., Any]) -> Estimate:
    found = np.array([sample for sample in samples if sample is not None], dtype=float)
    if found.size < 2:
        return single(float(found[0]) if found.size else None)
    picked = np.random.default_rng(_SEED).integers(found.size, size=(RESAMPLES, found.size))
    return Estimate(float(statistic(found)), *_bounds(statistic(found[picked], axis=1), found.size), found.size)


def bootstrap_rms(samples: Iterable[float | None]) -> Estimate:
    """Return the root mean square with the interval of `bootstrap_mean` of the squares; None is left out."""
    return root(bootstrap_mean(None if sample is None else sample**2 for sample in samples))


def root(squares: Estimate) -> Estimate:
    """Return the square root of an estimate."""
    value, low, high = (None if v is None else math.sqrt(v) for v in (squares.value, squares.low, squares.high))
    return Estimate(value, low, high, squares.samples)


def paired_difference(mine: Sequence[float], theirs: Sequence[float], power: int = 1) -> Estimate:
    """Return the difference of two means over the same episodes, with the interval of `bootstrap_mean`.

    Episodes are resampled for both at once: what makes one harder than another does not count. A power of 2 takes root
    mean squares instead of means.
    """

    def difference(means: np.ndarray) -> np.ndarray:
        roots = means ** (1.0 / power)
        return roots[0] - roots[1]

    return _paired(np.array([mine, theirs], dtype=float) ** power, difference)


def paired_ratio(mine: Sequence[float], theirs: Sequence[float]) -> Estimate:
    """Return the ratio of two means over the same episodes, resampled as by `paired_difference`.

    The ratio is None without episodes or if the divisor is 0, and has no bounds if the divisor is 0 in resamples.
    """
    both = np.array([mine, theirs], dtype=float)
    if not both.size or both[1].mean() == 0.0:
        return Estimate(None, None, None, len(mine))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = _paired(both, lambda means: means[0] / means[1])
    bounded = all(bound is None or math.isfinite(bound) for bound in (ratio.low, ratio.high))
    return ratio if bounded else dataclasses.replace(ratio, low=None, high=None)


def _paired(both: np.ndarray, statistic: Callable[[np.ndarray], Any]) -> Estimate:
    """Return a statistic of two means over the same episodes, shape (2, episodes), which are resampled for both."""
    value, count = float(statistic(both.mean(axis=1))), both.shape[1]
    if count < 2:
        return Estimate(value, None, None, count)
    picked = np.random.default_rng(_SEED).integers(count, size=(RESAMPLES, count))
    return Estimate(value, *_bounds(statistic(both[:, picked].mean(axis=2)), count), count)


def _bounds(resampled: np.ndarray, count: int) -> tuple[float, float]:
    """Return the expanded percentile interval of values that were resampled from `count` samples.

    Its tails are smaller than those of the confidence, by as much as Student's interval is wider than one with the
    standard deviation of a resample: Phi(-sqrt(n / (n - 1)) t) in place of Phi(-1.96).
    """
    wide = math.sqrt(count / (count - 1)) * stdtrit(count - 1, (1.0 + CONFIDENCE) / 2)
    tail = statistics.NormalDist().cdf(-wide)
    low, high = np.quantile(resampled, (tail, 1.0 - tail)).tolist()
    return low, high


def exact_test(one: int, other: int) -> float:
    """Return the two-sided p of McNemar's exact test (1947) of `one` episodes that differ one way, `other` the other.

    If nothing distinguishes the controllers, an episode that differs goes either way with equal probability.
    """
    return min(1.0, 2.0 * float(bdtr(min(one, other), one + other, 0.5)))

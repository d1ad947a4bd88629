import numpy as np
import pytest

from hugwbc.evaluation.intervals import (
    bootstrap_mean,
    bootstrap_median,
    exact_test,
    paired_difference,
    paired_ratio,
    wilson_percentage,
)


def test_the_interval_is_that_of_the_normal_distribution_for_many_samples():
    samples = np.random.default_rng(1).normal(2.0, 0.5, 400)
    estimate = bootstrap_mean(samples.tolist())
    error = samples.std() / np.sqrt(samples.size)
    assert estimate.value == pytest.approx(samples.mean()) and estimate.samples == 400
    assert estimate.low == pytest.approx(samples.mean() - 1.96 * error, abs=0.15 * error)
    assert estimate.high == pytest.approx(samples.mean() + 1.96 * error, abs=0.15 * error)


def test_it_covers_the_truth_as_often_as_it_says():
    rng = np.random.default_rng(2)
    estimates = [bootstrap_mean(rng.exponential(1.0, 40).tolist()) for _ in range(200)]
    covered = np.mean([e.low <= 1.0 <= e.high for e in estimates if e.low is not None and e.high is not None])
    assert 0.88 <= covered <= 0.98


@pytest.mark.parametrize("count", [8, 20])
def test_it_covers_the_mean_of_few_samples(count):
    """The plain percentile interval covers 88 % at 8 samples, Student's 95 %."""
    samples = np.random.default_rng(6).normal(1.0, 1.0, (600, count))
    estimates = map(bootstrap_mean, samples.tolist())
    covered = np.mean([e.low <= 1.0 <= e.high for e in estimates if e.low is not None and e.high is not None])
    assert 0.925 <= covered <= 0.97


def test_an_interval_of_few_samples_ends_with_them():
    few = bootstrap_mean([1.0, 2.0, 6.0])
    assert (few.value, few.low, few.high) == (3.0, 1.0, 6.0)


def test_score_interval_of_a_part():
    """Against the figures of Wilson's formula for 5 of 20 and 0 of 4, worked out by hand."""
    some, none = wilson_percentage([True] * 5 + [False] * 15), wilson_percentage([False] * 4)
    assert (some.value, some.low, some.high) == pytest.approx((25.0, 11.19, 46.87), abs=0.01)
    assert (none.value, none.low, none.high) == pytest.approx((0.0, 0.0, 48.99), abs=0.01)
    assert wilson_percentage([]).value is None and wilson_percentage([True]).high == 100.0
    assert wilson_percentage([False] * 10).low == 0.0, "and nothing that is nearly 0"


def test_few_and_missing_samples():
    assert bootstrap_mean([]).value is None
    one = bootstrap_mean([None, 3.0])
    assert (one.value, one.low, one.high, one.samples) == (3.0, None, None, 1)
    same = bootstrap_mean([2.0, 2.0, None])
    assert (same.value, same.low, same.high, same.samples) == (2.0, 2.0, 2.0, 2)
    assert bootstrap_mean([1.0, 2.0, 3.0]) == bootstrap_mean([1.0, 2.0, 3.0])


def test_the_interval_of_a_median_is_that_of_order_statistics():
    """Of 100 samples, the 40th and the 61st enclose the median with 95 % (binomial distribution)."""
    samples = np.sort(np.random.default_rng(5).normal(0.0, 1.0, 100))
    found = bootstrap_median(samples.tolist())
    assert found.value == pytest.approx(np.median(samples)) and found.samples == 100
    assert samples[37] <= found.low <= samples[41] and samples[58] <= found.high <= samples[62]
    assert bootstrap_median([]).value is None and bootstrap_median([2.0]).low is None


def test_a_ratio_of_the_same_episodes_leaves_out_what_makes_one_harder_than_another():
    rng = np.random.default_rng(3)
    hard = rng.exponential(5.0, 200)
    own = hard * rng.normal(1.5, 0.15, 200)
    ratio = paired_ratio(own.tolist(), hard.tolist())
    error = (own - ratio.value * hard).std() / np.sqrt(200) / hard.mean()  # of a ratio estimator (Cochran 1977)
    assert ratio.value == pytest.approx(own.mean() / hard.mean()) and ratio.samples == 200
    assert ratio.low == pytest.approx(ratio.value - 1.96 * error, abs=0.3 * error)
    assert ratio.high == pytest.approx(ratio.value + 1.96 * error, abs=0.3 * error)


def test_a_ratio_needs_a_divisor():
    assert paired_ratio([], []).value is None and paired_ratio([1.0, 1.0], [0.0, 0.0]).value is None
    one = paired_ratio([2.0], [4.0])
    assert (one.value, one.low, one.high, one.samples) == (0.5, None, None, 1)
    sometimes_zero = paired_ratio([1.0, 2.0], [0.0, 1.0])
    assert (sometimes_zero.value, sometimes_zero.high) == (3.0, None)


def test_a_paired_difference_leaves_out_what_makes_one_episode_harder_than_another():
    rng = np.random.default_rng(4)
    hard, own = rng.exponential(5.0, 40), rng.normal(0.2, 0.1, 40)
    found = paired_difference((hard + own).tolist(), hard.tolist())
    error = own.std() / np.sqrt(40)
    assert found.value == pytest.approx(own.mean()) and found.samples == 40
    assert found.low == pytest.approx(own.mean() - 1.96 * error, abs=0.3 * error)
    assert found.high == pytest.approx(own.mean() + 1.96 * error, abs=0.3 * error)
    unpaired = bootstrap_mean(hard + own)
    assert unpaired.high - unpaired.low > 20.0 * (found.high - found.low)
    assert paired_difference([3.0, 4.0], [0.0, 0.0], 2).value == pytest.approx(np.sqrt(12.5)), "of root mean squares"
    assert paired_difference([3.0], [1.0]).low is None


@pytest.mark.parametrize(
    ("one", "other", "p"), [(8, 1, 0.0390625), (1, 8, 0.0390625), (6, 0, 0.03125), (5, 0, 0.0625), (3, 3, 1), (0, 0, 1)]
)
def test_the_exact_test_of_shares(one, other, p):
    """Twice the tail of a fair coin: of nine tosses at most one, 2 (1 + 9) / 512."""
    assert exact_test(one, other) == pytest.approx(p, abs=1e-12)


def test_the_exact_test_takes_any_number_of_episodes():
    assert exact_test(1100, 0) == pytest.approx(0.0, abs=1e-300) and exact_test(5000, 5000) == 1.0

"""Latency and jitter."""

import numpy as np
import pytest

from hugwbc.deploy.timing import Spread, Timing


def test_spreads_are_percentiles_in_milliseconds() -> None:
    spread = Spread.of(np.arange(1, 1002) * 1e-3)
    assert (spread.count, spread.median, spread.largest) == (1001, pytest.approx(501.0), pytest.approx(1001.0))
    assert spread.p999 == pytest.approx(1000.0)
    assert "median 501.00 ms" in str(spread)
    assert str(Spread.of(np.zeros(0))) == "not measured"


def test_jitter_is_the_deviation_from_the_period_and_late_answers_are_counted() -> None:
    timing = Timing(0.002)
    for seconds in (0.001, 0.003, 0.019):
        timing.answered(seconds, 0.002)
    assert timing.missed == 2 and timing.latency.count == 3 and timing.latency.largest == pytest.approx(19.0)
    for now in (1.0, 1.002, 1.0045, 1.006):
        timing.published(now)
    assert timing.jitter.count == 3 and timing.jitter.largest == pytest.approx(0.5)
    assert timing.jitter.median == pytest.approx(0.5)


def test_an_answer_in_time_ends_a_row_of_periods_that_were_missed() -> None:
    timing = Timing(0.002)
    for _ in range(5):
        timing.answered(0.001, 0.002, skipped=1)
    assert timing.missed == 5 and timing.longest_miss == 1
    for seconds, skipped in ((0.003, 2), (0.003, 0), (0.001, 1), (0.001, 0)):
        timing.answered(seconds, 0.002, skipped)
    assert timing.missed == 10 and timing.longest_miss == 5

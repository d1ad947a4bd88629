"""Latency and jitter."""

import gc
import os
import sys

import numpy as np
import pytest

from hugwbc.deploy.timing import Spread, Timing, keep_apart, real_time


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


@pytest.mark.parametrize(("priority", "lower"), [(50, 49), (1, 1)])
def test_a_real_time_process_leaves_the_networks_threads_the_higher_priority(monkeypatch, priority, lower) -> None:
    asked = []
    monkeypatch.setattr(os, "sched_getscheduler", lambda pid: os.SCHED_FIFO)
    monkeypatch.setattr(os, "sched_getparam", lambda pid: os.sched_param(priority))
    monkeypatch.setattr(os, "sched_setscheduler", lambda pid, policy, param: asked.append((policy, param)))
    before = sys.getswitchinterval()
    with pytest.raises(ZeroDivisionError), real_time():
        assert not gc.isenabled() and sys.getswitchinterval() < before
        raise ZeroDivisionError
    assert gc.isenabled() and sys.getswitchinterval() == before
    assert asked == [(os.SCHED_FIFO, os.sched_param(lower))]


@pytest.mark.parametrize(
    ("cores", "last", "kept"), [({0, 1, 3}, True, [3]), ({0, 1, 3}, False, [0, 1]), ({2}, False, [2])]
)
def test_real_time_threads_that_compute_have_the_last_core_for_themselves(monkeypatch, cores, last, kept) -> None:
    asked = []
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: cores)
    monkeypatch.setattr(os, "sched_setaffinity", lambda pid, wanted: asked.append(wanted))
    keep_apart(last=last)
    assert asked == [], "without real-time scheduling the system knows better"
    monkeypatch.setattr(os, "sched_getscheduler", lambda pid: os.SCHED_RR)
    keep_apart(last=last)
    assert asked == [kept]

import dataclasses
import math

import numpy as np
import pytest

from hugwbc.targets import HandTargets
from hugwbc.upper_ik import TargetCounts, TargetWatch

DT = 0.02
GOOD = HandTargets.of((0.3, 0.2, 0.1), (0.3, -0.2, 0.1))
BAD = HandTargets(np.array([math.nan, 0.2, 0.1]), GOOD.right)


def message(number, time):
    return dataclasses.replace(GOOD, stamp=time, sequence=number)


def test_targets_without_a_stamp_are_always_new():
    watch = TargetWatch(0.5)
    assert all(watch.admit(GOOD, 0.0, DT) is GOOD for _ in range(100))
    assert watch.counts == TargetCounts()


def test_what_goes_wrong_on_the_way_is_counted_by_kind():
    watch = TargetWatch(0.5)
    first, second, fourth, fifth = (message(n, 0.02 * n) for n in (1, 2, 4, 5))
    for now, arrived, followed in (
        (0.03, first, first),
        (0.05, first, first),  # repeated
        (0.09, fourth, fourth),  # number 3, and so far 2, dropped
        (0.10, second, fourth),  # late
        (0.11, BAD, fourth),
        (0.13, fifth, fifth),
    ):
        assert watch.admit(arrived, now, DT) is followed
    assert watch.counts == TargetCounts(bad=1, late=1, repeated=1, dropped=2)


def test_the_age_counts_from_when_a_target_was_made():
    watch = TargetWatch(0.5)
    assert watch.admit(message(1, 0.0), 0.3, DT) is not None
    assert watch.age == pytest.approx(0.3)
    assert watch.admit(message(1, 0.0), 0.5, 0.19) is not None
    assert watch.admit(message(1, 0.0), 0.52, DT) is None
    assert watch.counts.stale == 1
    future = message(2, 9.0)
    assert watch.admit(future, 0.6, DT) is future, "a clock that runs ahead does not make a target stale"
    assert watch.age == 0.0


@pytest.mark.parametrize("stamp", [math.nan, math.inf])
def test_a_stamp_that_is_not_finite_is_bad_and_shuts_out_nothing(stamp):
    watch = TargetWatch(0.5)
    assert watch.admit(message(1, stamp), 0.0, DT) is None
    good = message(2, 0.1)
    assert watch.admit(good, 0.1, DT) is good
    assert watch.counts == TargetCounts(bad=1)


def test_a_loop_that_stood_still_finds_its_target_stale():
    watch = TargetWatch(0.5)
    assert watch.admit(message(1, 0.0), 0.0, DT) is not None
    assert watch.admit(message(1, 0.0), math.nan, math.nan) is not None, "a time step that is no number counts as none"
    assert watch.admit(message(1, 0.0), 0.6, 0.6) is None


def test_a_stream_goes_on_after_one_message_from_a_wrong_clock():
    watch = TargetWatch(0.5)
    watch.admit(message(1, 100.0), 0.0, DT)
    numbers = []
    for tick in range(1, 41):
        followed = watch.admit(message(1 + tick, tick * DT), tick * DT, DT)
        numbers.append(followed.sequence if followed else None)
    # Late until the wrong one is stale, half a second later.
    assert numbers[:24] == [1] * 24
    assert numbers[26:] == list(range(28, 42))
    assert watch.counts.stale == 1


@pytest.mark.parametrize("shape", [(2,), (3, 1), ()])
def test_numbers_that_stay_bad_are_no_update(shape):
    watch = TargetWatch(0.5)
    watch.admit(GOOD, 0.0, DT)
    bad = HandTargets(np.zeros(shape), GOOD.right)
    followed = [watch.admit(bad, 0.0, 0.03) for _ in range(30)]
    assert followed == [GOOD] * 16 + [None] * 14
    assert watch.counts == TargetCounts(bad=30, stale=1)


def test_a_stream_that_is_ended_on_purpose_may_start_anew_with_any_stamp():
    watch = TargetWatch(0.5)
    watch.admit(message(7, 5.0), 5.0, DT)
    watch.forget()
    again = message(1, 0.0)
    assert watch.admit(again, 0.1, DT) is again
    assert watch.counts == TargetCounts()

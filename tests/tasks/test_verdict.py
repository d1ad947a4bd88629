import numpy as np
import pytest

from hugwbc.tasks import Ending, Milestone
from hugwbc.tasks.verdict import FELL, at_end, judged, longest, within

HALF = Milestone("half of it is missing", lambda record: 0.5)
DONE = Milestone("never missing", lambda record: 1.0)
BROKEN = Milestone("nobody can tell", lambda record: float("nan"))


def test_a_success_needs_every_milestone(made_up):
    verdict = judged(made_up("push_cart"), (DONE, DONE))
    assert verdict.success and verdict.reason == "" and verdict.detail == "" and verdict.score == 1.0


def test_the_first_missed_milestone_is_the_reason_and_what_follows_does_not_count(made_up):
    record = made_up("push_cart", ending=Ending(False, "push: timeout of 5 s: 3 of 10 N", 5.0))
    verdict = judged(record, (DONE, HALF, DONE, DONE))
    assert not verdict.success and verdict.reason == "half of it is missing"
    assert verdict.detail == "push: timeout of 5 s: 3 of 10 N"
    assert verdict.score == pytest.approx(1.5 / 4)


def test_a_fall_is_a_failure_even_after_the_last_milestone(made_up):
    verdict = judged(made_up("push_cart", fell=True), (DONE, DONE))
    assert not verdict.success and verdict.reason == FELL and verdict.score == 0.99
    early = judged(made_up("push_cart", fell=True), (HALF, DONE))
    assert early.reason == FELL and "half of it is missing" in early.detail and early.score == 0.25


def test_problems_of_objects_are_reasons_without_their_times(made_up):
    record = made_up("push_cart", problems=("object 'cart' left the world at 3.14 s",))
    verdict = judged(record, (DONE,))
    assert not verdict.success and verdict.reason == "object 'cart' left the world"
    assert "3.14 s" in verdict.detail


def test_progress_that_is_not_a_number_is_none(made_up):
    verdict = judged(made_up("push_cart"), (BROKEN,))
    assert not verdict.success and verdict.score == 0.0


def test_an_error_is_within_what_is_allowed_or_the_less_the_larger():
    assert within(0.1, 0.1) == 1.0 and within(0.0, 0.1) == 1.0
    assert 0.0 < within(0.4, 0.1) < within(0.2, 0.1) < 1.0
    assert within(float("nan"), 0.1) == 0.0


def test_the_longest_time_is_that_without_a_break():
    kept = np.array([True] * 50 + [False] + [True] * 100)
    assert longest(kept) == pytest.approx(2.0)
    assert longest(np.zeros(10, dtype=bool)) == 0.0


def test_the_end_is_the_mean_of_the_last_samples():
    values = np.concatenate((np.zeros(90), np.ones(10)))
    assert at_end(values) == 1.0

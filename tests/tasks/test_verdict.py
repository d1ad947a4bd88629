import dataclasses

import numpy as np
import pytest

from hugwbc.behaviours.source import SETTLED
from hugwbc.gait import Gait
from hugwbc.tasks import Ending, Milestone
from hugwbc.tasks.verdict import FARTHEST, FASTEST, FELL, RAN_AWAY, judged, stillness, within

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


def test_a_verdict_names_what_has_touched_the_scene_beside_the_hands(made_up):
    thigh, trunk = ("left_hip_pitch_link", "from"), ("trunk", "to")
    touched = {thigh: 7.15, ("right_hand", "box"): 3.0, trunk: 9.0, ("pelvis", "to"): 9.5}
    bumped = made_up("push_cart", touched=touched, lasted={thigh: 45.04, trunk: 0.01})
    words = "the left thigh touched 'from' at 7.2 s, for 45.0 s; the trunk touched 'to' at 9.0 s; "
    words += "the pelvis touched 'to' at 9.5 s"
    stuck = dataclasses.replace(bumped, ending=Ending(False, "walk to: stuck", 12.0))
    assert judged(stuck, (HALF,)).detail == f"walk to: stuck; {words}"
    done = judged(bumped, (DONE,))
    assert done.success and done.detail == words and done.words == f"done ({words})"
    assert judged(dataclasses.replace(bumped, fell=True), (DONE,)).detail == f"at the end; {words}"


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


def _walk(record, begin, speed, told):
    """Let the pelvis move from a time on [s] at a speed [m/s]; the robot is told to stand where `told` says so."""
    pelvis = record.pelvis.copy()
    pelvis[:, 0] = np.maximum(record.time - begin, 0.0) * speed
    return dataclasses.replace(record, pelvis=pelvis, gait=np.where(told(record.time), Gait.STANDING, Gait.WALKING))


def test_a_robot_that_runs_away_while_told_to_stand_has_not_done_its_task(made_up):
    """1.04 m back in 1.3 s, as the QP once did when its hands let go of a box."""
    ran = _walk(made_up("push_cart"), 18.7, -0.8, lambda time: time > 10.0)
    verdict = judged(ran, (DONE,))
    assert not verdict.success and verdict.reason == RAN_AWAY and verdict.score == 0.99
    assert verdict.detail == "1.02 m told to stand, 0.80 m/s at the end"
    assert judged(ran, (HALF,)).reason == "half of it is missing"


def test_a_robot_that_still_walks_at_the_end_has_not_done_its_task(made_up):
    walks = _walk(made_up("push_cart"), 0.0, 1.2 * FASTEST, lambda time: time < 0.0)
    assert judged(walks, (DONE,)).reason == "the robot did not come to rest"


def test_a_robot_may_step_out_and_sway_when_it_is_told_to_stand(made_up):
    told = lambda time: time > 10.0  # noqa: E731
    stops = made_up("push_cart")
    pelvis = stops.pelvis.copy()
    pelvis[:, 0] = np.minimum(stops.time, 10.0 + 0.9 * SETTLED) * 0.5 + 0.3 * FARTHEST * np.sin(0.5 * stops.time)
    stops = dataclasses.replace(stops, pelvis=pelvis, gait=np.where(told(stops.time), Gait.STANDING, Gait.WALKING))
    assert judged(stops, (DONE,)).success
    drift, speed = stillness(stops)
    assert 0.0 < drift < FARTHEST and 0.0 < speed < FASTEST


def test_the_ways_between_stands_do_not_count(made_up):
    record = made_up("push_cart")
    stands, pelvis = record.time % 4.0 < 2.0, record.pelvis.copy()
    pelvis[:, 0] = np.cumsum(~stands) * 0.5 / 50
    gait = np.where(stands, Gait.STANDING, Gait.WALKING)
    assert stillness(dataclasses.replace(record, pelvis=pelvis, gait=gait))[0] == 0.0

import numpy as np
import pytest

from hugwbc import Gait
from hugwbc.mbc.gait_plan import GaitPlan, Mode

DT = 0.002


def _run(plan, gait, seconds, *, frequency=2.0, may_start=True, may_stop=True):
    """Advance; return the times and feet of the lift-offs."""
    events = []
    for tick in range(round(seconds / DT)):
        if plan.advance(gait, frequency, DT, may_start=may_start, may_stop=may_stop):
            events.append((tick * DT, plan.swing))
    return events


@pytest.fixture
def plan():
    return GaitPlan(gather_time=0.3)


@pytest.mark.parametrize("frequency", [1.5, 2.0, 3.5])
def test_each_foot_lifts_off_at_the_stride_frequency(frequency):
    events = _run(GaitPlan(), Gait.WALKING, 6.0, frequency=frequency)
    feet = [foot for _, foot in events]
    assert feet[:4] == [0, 1, 0, 1]
    left = [time for time, foot in events if foot == 0]
    assert (left[-1] - left[0]) / (len(left) - 1) == pytest.approx(1.0 / frequency, abs=DT / 2)


def test_a_walk_may_start_with_either_foot():
    plan = GaitPlan()
    plan.advance(Gait.WALKING, 2.0, DT, may_start=True, may_stop=True)
    assert plan.advance(Gait.WALKING, 2.0, DT, may_start=True, may_stop=True, first_swing=1)
    assert (plan.swing, plan.stance) == (1, 0)


def test_it_waits_for_the_weight_shift():
    plan = GaitPlan()
    assert _run(plan, Gait.WALKING, 1.0, may_start=False) == []
    assert plan.mode is Mode.SHIFTING and plan.swing is None
    assert _run(plan, Gait.STANDING, 0.1) == []
    assert plan.mode is Mode.STANDING


def test_it_stops_at_the_end_of_a_step_only_and_only_when_it_may():
    plan = GaitPlan()
    _run(plan, Gait.WALKING, 1.1)
    assert plan.mode is Mode.WALKING
    assert _run(plan, Gait.STANDING, 1.0, may_stop=False)  # it goes on stepping
    remaining = plan.remaining
    assert _run(plan, Gait.STANDING, remaining - 2 * DT) == []
    assert plan.mode is Mode.WALKING
    _run(plan, Gait.STANDING, 4 * DT)
    assert plan.mode is Mode.STANDING and plan.swing is None


def test_remaining_time_counts_down_to_the_change_of_feet():
    plan = GaitPlan()
    _run(plan, Gait.WALKING, 0.1)
    before, swing = plan.remaining, plan.swing
    _run(plan, Gait.WALKING, 0.02)
    assert before - plan.remaining == pytest.approx(0.02)
    _run(plan, Gait.WALKING, plan.remaining - DT)
    assert 0.0 < plan.remaining <= 1.5 * DT and plan.swing == swing
    _run(plan, Gait.WALKING, 2 * DT)
    assert plan.swing == 1 - swing and plan.remaining == pytest.approx(plan.step_time, abs=2 * DT)


@pytest.mark.parametrize("change", [-0.04, 0.06])
def test_a_step_that_is_retimed_ends_then_and_the_next_one_takes_its_time(change):
    plan = GaitPlan()
    _run(plan, Gait.WALKING, 1.1)
    wanted = plan.remaining + change
    phase, swing = plan.phase, plan.swing
    plan.retime(wanted)
    assert (plan.phase, plan.swing) == (phase, swing), "the clock does not jump"
    assert plan.remaining == pytest.approx(wanted)
    assert plan.duration == pytest.approx(0.25 + change)
    events = _run(plan, Gait.WALKING, 0.6)
    assert events[0][0] == pytest.approx(wanted, abs=1.5 * DT)
    assert np.diff([time for time, _ in events]) == pytest.approx(0.25, abs=1.5 * DT)
    assert plan.duration == 0.25


@pytest.mark.parametrize("frequency", [1.5, 3.5])
def test_a_jump_is_half_stance_half_flight_after_a_longer_first_stance(plan, frequency):
    airborne = []
    for _ in range(round(4.0 / DT)):
        plan.advance(Gait.JUMPING, frequency, DT, may_start=True, may_stop=False)
        airborne.append(plan.airborne)
    assert plan.mode is Mode.LEAPING and plan.legs == (0, 1) and plan.swing is None
    change = np.flatnonzero(np.diff(airborne)) * DT
    assert change[0] == pytest.approx(0.3 + 0.5 / frequency, abs=3 * DT)
    assert np.diff(change) == pytest.approx(np.full(len(change) - 1, 0.5 / frequency), abs=1.5 * DT)


def test_a_jump_waits_for_the_robot_to_come_to_rest(plan):
    _run(plan, Gait.JUMPING, 0.5, may_start=False)
    assert plan.mode is Mode.STANDING
    _run(plan, Gait.JUMPING, 2 * DT)
    assert plan.mode is Mode.LEAPING


def test_a_jump_ends_with_a_landing_and_then_stands(plan):
    _run(plan, Gait.JUMPING, 0.7)
    assert plan.airborne
    _run(plan, Gait.STANDING, 0.4)
    while plan.airborne:
        plan.advance(Gait.STANDING, 2.0, DT, may_start=False, may_stop=True)
    assert plan.mode is Mode.LANDING and plan.legs == (0, 1)
    assert plan.remaining == pytest.approx(0.55, abs=2 * DT)
    _run(plan, Gait.STANDING, 0.5)
    assert plan.mode is Mode.LANDING
    _run(plan, Gait.STANDING, 0.1)
    assert plan.mode is Mode.STANDING and plan.legs == ()


def test_a_walk_turns_into_a_jump_by_way_of_a_stand_at_the_end_of_a_step(plan):
    _run(plan, Gait.WALKING, 1.1)
    remaining = plan.remaining
    _run(plan, Gait.JUMPING, remaining - 2 * DT)
    assert plan.mode is Mode.WALKING
    _run(plan, Gait.JUMPING, 6 * DT)
    assert plan.mode is Mode.LEAPING and not plan.airborne


def test_a_hop_waits_for_the_weight_and_ends_on_both_feet(plan):
    _run(plan, Gait.HOPPING_RIGHT, 1.0, may_start=False)
    assert plan.mode is Mode.SHIFTING and plan.legs == ()
    _run(plan, Gait.HOPPING_RIGHT, 0.7)
    assert plan.airborne and plan.legs == (1,)
    # Asked to stand in flight, it hops once more: only at the take-off is it decided where the flight ends.
    while plan.airborne:
        plan.advance(Gait.STANDING, 2.0, DT, may_start=False, may_stop=True)
    assert plan.mode is Mode.LEAPING and plan.legs == (1,)
    while not plan.airborne:
        plan.advance(Gait.STANDING, 2.0, DT, may_start=False, may_stop=True)
    assert plan.legs == (0, 1)
    while plan.airborne:
        plan.advance(Gait.STANDING, 2.0, DT, may_start=False, may_stop=True)
    assert plan.mode is Mode.LANDING and plan.legs == (0, 1)


def test_a_foot_that_has_not_landed_is_waited_for_and_the_clock_runs_on():
    plan = GaitPlan()
    _run(plan, Gait.WALKING, 0.5)
    swing = plan.swing
    while plan.remaining > DT:
        plan.advance(Gait.WALKING, 2.0, DT, may_start=True, may_stop=True, landed=False)
    for tick in range(1, 20):
        assert not plan.advance(Gait.WALKING, 2.0, DT, may_start=True, may_stop=True, landed=False)
        assert plan.swing == swing and plan.remaining == 0.0 and plan.overdue == pytest.approx(tick * DT)
    assert plan.advance(Gait.WALKING, 2.0, DT, may_start=True, may_stop=True, landed=True)
    assert plan.swing == 1 - swing and plan.overdue == 0.0
    assert plan.remaining == pytest.approx(plan.step_time - 20 * DT, abs=2 * DT)


def test_it_does_not_wait_for_ever():
    plan = GaitPlan()
    _run(plan, Gait.WALKING, 0.5)
    lift_offs = sum(
        plan.advance(Gait.WALKING, 2.0, DT, may_start=True, may_stop=True, landed=False) for _ in range(500)
    )
    assert lift_offs == 4  # a second of 2 Hz, every step 0.1 s late

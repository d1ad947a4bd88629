import dataclasses
import math

import numpy as np
import pytest

from hugwbc import Command, Gait, load_robot
from hugwbc.evaluation import metrics

MASS = 50.0


def test_a_perfect_run_has_no_error(synthetic_trace):
    trace = synthetic_trace(Command(v_x=0.4, h=-0.1, gait=Gait.WALKING))
    assert all(error == pytest.approx(0.0, abs=1e-12) for error in metrics.tracking_errors(trace).values())
    assert metrics.frequency_error(trace) == pytest.approx(0.0, abs=1e-9)
    assert metrics.swing_height_error(trace) < 0.15 * 0.02  # the apex falls between samples


def test_a_bias_is_the_error_whatever_its_sign(synthetic_trace):
    trace = synthetic_trace(bias={"v_x": -0.1, "v_y": 0.02, "omega": 0.3, "h": -0.04, "p": 0.05, "w": -0.06})
    expected = {"v_x": 0.1, "v_y": 0.02, "omega": 0.3, "h": 0.04, "p": 0.05, "w": 0.06}
    assert metrics.tracking_errors(trace) == pytest.approx(expected)


def test_held_foot_contact_counts_the_held_foot_only(synthetic_trace):
    trace = synthetic_trace(Command(gait=Gait.HOPPING_LEFT))
    contact = np.zeros((trace.time.size, 2), dtype=bool)
    contact[:, 0] = True  # the hopping foot
    contact[-45:, 1] = True  # 45 of the 450 samples after the start
    assert metrics.held_foot_contact(dataclasses.replace(trace, foot_contact=contact)) == pytest.approx(0.1)
    assert math.isnan(metrics.held_foot_contact(synthetic_trace(Command(gait=Gait.WALKING))))


def test_foot_travel_is_the_length_of_both_paths(synthetic_trace):
    trace = synthetic_trace(Command(gait=Gait.STANDING))
    qpos = np.zeros((trace.time.size, 26))
    qpos[:, 3] = 1.0
    still = dataclasses.replace(trace, qpos=qpos)
    assert metrics.foot_travel(still)[0] == 0.0
    # 1 cm back and forth between samples: 449 intervals after the start, two feet
    shaken = qpos.copy()
    shaken[::2, 0] = 0.01
    assert metrics.foot_travel(dataclasses.replace(trace, qpos=shaken))[0] == pytest.approx(2 * 449 * 0.01)
    lifted = qpos.copy()
    lifted[::2, 2] = 0.01
    assert metrics.foot_travel(dataclasses.replace(trace, qpos=lifted))[0] == 0.0


def test_the_start_is_left_out(synthetic_trace):
    trace = synthetic_trace()
    measured = trace.measured.copy()
    measured[trace.time < 1.0] = 100.0
    late_start = dataclasses.replace(trace, measured=measured)
    assert metrics.tracking_errors(late_start)["v_x"] == pytest.approx(0.0)
    # 50 of 500 samples are off by 100
    assert metrics.tracking_errors(late_start, settle=0.0)["v_x"] == pytest.approx(10.0)


@pytest.mark.parametrize(("commanded", "stepped", "error"), [(2.0, 2.2, 0.2), (3.5, 3.0, 0.5), (1.5, 1.5, 0.0)])
def test_frequency_offset(commanded, stepped, error, synthetic_trace):
    trace = synthetic_trace(Command(f=commanded, gait=Gait.WALKING), frequency=stepped)
    assert metrics.frequency_error(trace) == pytest.approx(error, abs=1e-9)


def test_alternating_long_and_short_cycles_do_not_cancel(synthetic_trace):
    down = np.cumsum([0.4, 0.6] * 10)  # 2.5 Hz and 1.667 Hz around 2 Hz
    trace = synthetic_trace(Command(f=2.0, gait=Gait.WALKING), touch_downs=(down, down))
    assert metrics.frequency_error(trace) == pytest.approx((0.5 + 2.0 - 1.0 / 0.6) / 2.0, rel=0.03)


def test_apex_overshoot_and_undershoot(synthetic_trace):
    for apex in (0.2, 0.1):
        trace = synthetic_trace(Command(l=0.15, f=1.5, gait=Gait.WALKING), apex=apex)
        assert metrics.swing_height_error(trace) == pytest.approx(0.05, abs=0.002)


def test_a_foot_that_never_steps_counts_as_frequency_and_height_zero(synthetic_trace):
    trace = synthetic_trace(Command(gait=Gait.WALKING))
    still = dataclasses.replace(trace, touch_downs=(np.array([]), np.array([])), clearance=0 * trace.clearance)
    assert metrics.frequency_error(still) == pytest.approx(2.0)
    assert metrics.swing_height_error(still) == pytest.approx(0.15)


@pytest.mark.parametrize(("end", "error"), [(1.4, None), (1.9, None), (2.1, 2.0)])
def test_a_foot_without_the_time_for_a_cycle_before_a_fall_has_no_errors(synthetic_trace, end, error):
    trace = synthetic_trace(Command(gait=Gait.WALKING), duration=end)
    trace = dataclasses.replace(trace, touch_downs=(np.array([]), np.array([])), fell=True)
    found = metrics.frequency_error(trace), metrics.swing_height_error(trace)
    assert math.isnan(sum(found)) if error is None else found[0] == pytest.approx(error)


@pytest.mark.parametrize(
    ("first", "last", "missed"),
    [
        (0.0, 3.0, 2 * 13 / (2 * 13 + 4 + 3)),  # the feet step until 3 and 2.75 s, and stand still for 7 s and longer
        (6.0, 10.0, 2 * 9 / (2 * 9 + 7 + 7)),
        (0.0, 9.6, 0.0),  # less than two periods without a step
    ],
)
def test_cycles_that_are_missed_before_the_first_and_after_the_last_step_count(synthetic_trace, first, last, missed):
    trace = synthetic_trace(Command(gait=Gait.WALKING))
    downs = tuple(times[(times >= first) & (times <= last)] for times in trace.touch_downs)
    swung = (trace.time >= first - 0.3) & (trace.time <= last)
    still = dataclasses.replace(trace, touch_downs=downs, clearance=trace.clearance * swung[:, None])
    assert metrics.frequency_error(still) == pytest.approx(2.0 * missed)
    assert metrics.swing_height_error(still) == pytest.approx(0.15 * missed, abs=0.003)


def test_a_run_that_ended_in_the_settling_time_has_no_errors(synthetic_trace):
    trace = synthetic_trace(duration=0.5)
    assert all(math.isnan(error) for error in metrics.tracking_errors(trace).values())
    assert math.isnan(metrics.frequency_error(trace)) and math.isnan(metrics.swing_height_error(trace))


def test_hand_errors_are_those_of_reachable_targets():
    error = np.full((100, 2), np.nan)
    error[50:], error[50:75, 1] = [0.02, 0.04], 0.30
    reachable = np.zeros((100, 2), dtype=bool)
    reachable[50:, 0], reachable[75:, 1] = True, True
    hands = metrics.hand_errors(error, reachable)
    assert hands["mean"] == pytest.approx((50 * 0.02 + 25 * 0.04) / 75)
    assert hands["p95"] == pytest.approx(0.04)
    assert hands["reachable_fraction"] == pytest.approx(0.75)


def test_without_hand_targets_there_are_no_hand_errors():
    hands = metrics.hand_errors(np.full((10, 2), np.nan), np.zeros((10, 2), dtype=bool))
    assert set(hands.values()) == {None}


def test_creep_is_what_feet_that_stand_firm_travel(synthetic_trace):
    """1 mm/s on the ground is creep, 3 mm/s is a slip, and in the air there is no creep."""
    trace = synthetic_trace(Command(gait=Gait.STANDING), foot_contact=np.ones((500, 2), dtype=bool))
    qpos = np.zeros((500, 26))
    qpos[:, 2], qpos[:, 3], qpos[:, 7:] = 0.98, 1.0, load_robot().nominal
    speed = np.where(trace.time < 6.0, 0.001, 0.003)
    qpos[1:, 0] = np.cumsum(speed[:-1]) * 0.02
    trace = dataclasses.replace(trace, qpos=qpos)
    assert metrics.foot_travel(trace, 2.0)[0] == pytest.approx(2 * (4.0 * 0.001 + 3.98 * 0.003))
    assert metrics.foot_travel(trace, 2.0)[1] == pytest.approx(2 * 4.0 * 0.001)
    assert metrics.foot_travel(dataclasses.replace(trace, foot_contact=~trace.foot_contact), 2.0)[1] == 0.0
    assert math.isnan(metrics.foot_travel(trace, 11.0)[1])


def test_percentiles_of_call_times():
    assert metrics.percentiles(np.arange(101.0)) == {"p50": 50.0, "p99": 99.0}
    assert metrics.percentiles(np.array([])) == {"p50": None, "p99": None}


@pytest.fixture
def walk(synthetic_trace):
    """0.5 m/s for 10 s; one joint drives at 20 N*m and 2 rad/s, another brakes at -10 N*m and 3 rad/s."""
    trace = synthetic_trace(Command(gait=Gait.WALKING, v_x=0.5))
    qpos = np.zeros((500, 26))
    qpos[:, 0] = 0.5 * trace.time
    return dataclasses.replace(trace, qpos=qpos, power=np.full(500, 20.0 * 2.0 + 10.0 * 3.0))


def test_cost_of_transport_by_hand(walk):
    assert metrics.mechanical_power(walk) == pytest.approx(20.0 * 2.0 + 10.0 * 3.0)
    assert metrics.speed(walk) == pytest.approx(0.5)
    assert metrics.cost_of_transport(walk, MASS) == pytest.approx(70.0 / (MASS * 9.81 * 0.5))


def test_on_the_spot_there_is_power_and_no_cost_of_transport(walk):
    still = dataclasses.replace(walk, qpos=0.01 * walk.qpos)
    assert metrics.mechanical_power(still) == 70.0
    assert math.isnan(metrics.cost_of_transport(still, MASS))
    assert math.isnan(metrics.mechanical_power(walk, settle=11.0)) and math.isnan(metrics.speed(walk, settle=11.0))


def test_impacts_by_hand(synthetic_trace):
    left = np.array([[0.3, 0.0, -0.4], [0.0, 0.0, -1.0], [0.0, 0.0, -9.0]])  # the first is in the settling time
    downs = (np.array([1.5, 2.5, 0.5]), np.array([2.0]))
    trace = synthetic_trace(touch_downs=downs)
    weight = trace.mass * 9.81
    trace = dataclasses.replace(
        trace,
        touch_down_velocity=(left, np.array([[0.0, 0.6, 0.8]])),
        stance_peak=(np.array([1.0, 3.0, 9.0]) * weight, np.array([2.0]) * weight),
    )
    found = metrics.impact(trace)
    assert found == pytest.approx({"speed_median": 0.8, "peak_mean": 2.0})
    assert metrics.impact(trace, 5.0) == {}, "no touch-down, no impact"
    assert metrics.impact(dataclasses.replace(trace, survived_s=2.2))["peak_mean"] == pytest.approx(1.5)

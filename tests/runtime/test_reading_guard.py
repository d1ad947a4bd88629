"""What the guard before the estimator refuses, what it puts in the place, and what it calls lost."""

import dataclasses
import math

import numpy as np
import pytest

from hugwbc import RobotState, load_robot
from hugwbc.runtime.reading_guard import ALL, IMU, ReadingGuard, plausible

H1 = load_robot()
KNEE = H1.index("left_knee_joint")
NAME = "left_knee_joint"
PERIOD = 0.002


def reading(tick, rng, *, swing=0.2, knee=0.2):
    """All joints swing once in 0.6 s by so much [rad], with noise on every number."""
    time, rate = tick * PERIOD, 2.0 * math.pi / 0.6
    phase, swings = rate * time + np.arange(19), np.where(np.arange(19) == KNEE, knee, swing)
    return RobotState(
        q=H1.nominal + swings * np.sin(phase) + rng.normal(0.0, 0.001, 19),
        dq=swings * rate * np.cos(phase) + rng.normal(0.0, 0.05, 19),
        orientation=np.array([1.0, 0.0, 0.0, 0.0]),
        angular_velocity=np.zeros(3),
        imu_gyro=swing * np.cos(rate * time + np.arange(3)) + rng.normal(0.0, 0.01, 3),
        imu_accelerometer=np.array([0.0, 0.0, 9.81]) + 5.0 * swing * np.sin(rate * time) + rng.normal(0.0, 0.1, 3),
        torque=100.0 * swing * np.sin(phase) + rng.normal(0.0, 1.0, 19),
        time=time,
    )


@pytest.fixture
def walked():
    guard, rng = ReadingGuard(H1), np.random.default_rng(0)
    guard.reset(reading(0, rng))
    for tick in range(1, 1000):
        state = guard.admit(reading(tick, rng))
        assert not state.coasted and not state.lost
    return guard, rng


def changed(state, *, joint=None, **values):
    vectors = {name: getattr(state, name).copy() for name in values}
    for name, value in values.items():
        vectors[name][slice(None) if joint is None else joint] = value
    return dataclasses.replace(state, **vectors)


def test_sound_readings_pass_unchanged(walked):
    guard, rng = walked
    state = reading(1000, rng)
    assert guard.admit(state) is state and guard.rejected == {}


@pytest.mark.parametrize("value", [5000.0, np.nan])
def test_a_torque_that_no_motor_has_is_replaced(walked, value):
    """A motor's torque is no device that could fail: nothing coasts."""
    guard, rng = walked
    truth = reading(1000, rng)
    state = guard.admit(changed(truth, joint=KNEE, torque=value))
    np.testing.assert_allclose(state.torque, truth.torque, atol=6.0)
    assert np.abs(truth.torque).max() > 15.0
    assert not state.coasted and guard.rejected == {}


@pytest.mark.parametrize(
    ("name", "value", "device", "tolerance"),
    [
        ("dq", 500.0, NAME, 0.3),
        ("dq", -57.0, NAME, 0.3),  # 4 times the joint's 14 rad/s are 56
        ("q", np.nan, NAME, 0.01),
        ("q", 0.85, NAME, 0.01),  # 0.24 rad away
        ("imu_gyro", 36.0, IMU, 0.05),
        ("imu_gyro", -21.0, IMU, 0.05),  # a step of 21 rad/s
        ("imu_gyro", np.inf, IMU, 0.05),
        ("imu_accelerometer", -240.0, IMU, 0.5),
    ],
)
def test_a_wrong_reading_is_replaced_by_a_likely_one(walked, name, value, device, tolerance):
    guard, rng = walked
    truth = reading(1000, rng)
    state = guard.admit(changed(truth, joint=KNEE if device == NAME else 0, **{name: value}))
    assert state.coasted == (device,) and guard.rejected == {device: 1}
    np.testing.assert_allclose(getattr(state, name), getattr(truth, name), atol=tolerance)
    assert not guard.admit(reading(1001, rng)).coasted


@pytest.mark.parametrize(
    ("name", "value"), [("dq", -55.0), ("q", 0.78), ("imu_gyro", -19.0), ("imu_accelerometer", -230.0)]
)
def test_what_can_be_true_passes(walked, name, value):
    guard, rng = walked
    state = changed(reading(1000, rng), joint=KNEE if name in ("q", "dq") else 0, **{name: value})
    assert guard.admit(state) is state


def test_an_imu_that_hangs_is_refused_from_the_third_repetition_on(walked):
    guard, rng = walked
    held = {name: getattr(reading(1000, rng), name) for name in ("imu_gyro", "imu_accelerometer")}
    coasted = [guard.admit(dataclasses.replace(reading(tick, rng), **held)).coasted for tick in range(1000, 1010)]
    assert coasted == [()] * 3 + [(IMU,)] * 7


def test_a_stuck_encoder_follows_the_stride_before(walked):
    guard, rng = walked
    first = reading(1000, rng)
    for tick in range(1000, 1100):
        truth = reading(tick, rng)
        state = guard.admit(
            dataclasses.replace(
                truth,
                q=np.where(np.arange(19) == KNEE, first.q, truth.q),
                dq=np.where(np.arange(19) == KNEE, first.dq, truth.dq),
            )
        )
        if tick > 1004:
            assert state.coasted == (NAME,) and state.q[KNEE] == pytest.approx(truth.q[KNEE], abs=0.05)
    assert not state.lost


def test_frozen_readings_and_wrong_times_are_filled_in(walked):
    guard, rng = walked
    held = reading(1000, rng)
    for tick in range(1000, 1050):
        state = guard.admit(dataclasses.replace(held, time=tick * PERIOD))
    assert state.coasted == (ALL,)
    np.testing.assert_allclose(state.q, reading(1049, rng).q, atol=0.05)
    state = guard.admit(reading(1050, rng))
    assert not state.coasted
    late = guard.admit(dataclasses.replace(reading(1051, rng), time=0.5))
    assert late.coasted == (ALL,) and late.time == pytest.approx(1051 * PERIOD)


@pytest.mark.parametrize("step", [1, 2, 5])
def test_a_clock_that_jumped_ahead_is_believed_before_all_readings_count_as_lost(step):
    guard, rng = ReadingGuard(H1), np.random.default_rng(0)
    guard.reset(reading(0, rng), step * PERIOD)
    for tick in range(step, 600, step):
        guard.admit(reading(tick, rng))
    guard.admit(dataclasses.replace(reading(600, rng), time=600 * PERIOD + 0.08))
    states = [guard.admit(reading(tick, rng)) for tick in range(600 + step, 800, step)]
    assert states[0].coasted == (ALL,) and not states[-1].coasted
    assert not any(state.lost for state in states)


def test_a_joint_that_reads_the_same_at_rest_is_not_stuck():
    guard, rng = ReadingGuard(H1), np.random.default_rng(0)
    still = reading(0, rng, swing=0.0, knee=0.0)
    guard.reset(still)
    for tick in range(1, 300):
        new = reading(tick, rng, swing=0.0, knee=0.0)
        assert not guard.admit(dataclasses.replace(new, q=still.q, dq=np.zeros(19))).coasted


@pytest.mark.parametrize(
    ("names", "why", "after"),
    [
        (("imu_gyro", "orientation", "angular_velocity"), "IMU", 0.3),
        (("q",), "encoder of left_knee_joint", 0.3),
        (("imu_gyro", "q"), "all readings", 0.2),
    ],
)
def test_what_does_not_come_back_is_lost(walked, names, why, after):
    guard, rng = walked
    joint, values = KNEE if names == ("q",) else None, dict.fromkeys(names, np.nan)
    states = [guard.admit(changed(reading(tick, rng), joint=joint, **values)) for tick in range(1000, 1200)]
    assert [bool(state.lost) for state in states].index(True) * PERIOD == pytest.approx(after, abs=2 * PERIOD)
    assert why in states[-1].lost
    assert all(state.is_finite for state in states)


@pytest.mark.parametrize("missing", [25, 40])
def test_after_a_gap_joints_are_where_their_speed_has_led_them(missing):
    """A knee of a fast walk turns by 0.6 rad in 80 ms."""
    guard, rng = ReadingGuard(H1), np.random.default_rng(0)
    guard.reset(reading(0, rng, knee=0.7))
    for tick in (*range(1, 700), *range(700 + missing, 760)):
        state = guard.admit(reading(tick, rng, knee=0.7))
        assert not state.coasted and not state.lost, tick
    jumped = guard.admit(changed(reading(760 + missing, rng, knee=0.7), joint=KNEE, q=2.0))
    assert jumped.coasted == (NAME,), "but not anywhere"


def test_an_orientation_that_is_no_number_is_replaced_by_the_last_one(walked):
    guard, rng = walked
    known = guard.admit(reading(1000, rng))
    state = guard.admit(changed(reading(1001, rng), joint=KNEE, q=np.nan, orientation=np.nan))
    np.testing.assert_array_equal(state.orientation, known.orientation)
    gone = guard.admit(changed(reading(1002, rng), imu_gyro=np.nan, orientation=np.nan))
    np.testing.assert_array_equal(gone.orientation, known.orientation)


def test_single_readings_that_cannot_be_true_are_left_out_of_a_mean():
    rng = np.random.default_rng(0)
    readings = [reading(tick, rng) for tick in range(5)]
    before = reading(-1, rng).imu_gyro
    assert plausible(readings, before, H1) == readings
    for name, value in (("imu_gyro", 34.0), ("imu_gyro", np.nan), ("imu_accelerometer", 500.0), ("torque", 1e4)):
        spoilt = [*readings[:2], changed(readings[2], joint=0, **{name: value}), *readings[3:]]
        assert plausible(spoilt, before, H1) == [*readings[:2], *readings[3:]], name
    wild = [changed(one, joint=0, imu_gyro=34.0) for one in readings]
    assert plausible(wild, before, H1) is wild, "the guard judges what all of them say"

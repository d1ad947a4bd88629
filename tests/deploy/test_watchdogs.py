"""What is refused, and when the joints are damped."""

import dataclasses

import numpy as np
import pytest

from hugwbc import load_robot, rotations
from hugwbc.deploy.messages import Messages
from hugwbc.deploy.watchdogs import BodyLimits, Intake, Limits, run_refusal, start_refusal, tilt
from tests.conftest import make_state

H1 = load_robot()


@pytest.fixture
def intake() -> Intake:
    return Intake(Messages(H1), Limits(), age=0.01)


def test_fresh_states_are_accepted_with_their_age(standing, intake) -> None:
    for step in range(5):
        state = intake.accept(standing.raw(), 0.002 * step)
        assert state is not None and state.state.age == 0.01
        assert state.state.time == pytest.approx(1e-3 * standing.tick)
    assert (intake.received, intake.wrong_sum, intake.old, intake.torn) == (5, 0, 0, 0)
    assert intake.gap == pytest.approx(0.002)


def test_a_wrong_check_sum_is_refused_and_named(standing, intake) -> None:
    intake.accept(standing.raw(), 0.0)
    for step in range(1, 12):
        broken = bytearray(standing.raw())
        broken[100] ^= 4
        assert intake.accept(bytes(broken), 0.002 * step) is None
    assert intake.wrong_sum == 11
    assert str(intake.fault(0.102)).startswith("no state for 102 ms, but states with a wrong check sum: its crc is 0x")


def test_messages_of_a_wrong_size_are_refused(intake) -> None:
    assert intake.accept(b"", 0.0) is None and intake.accept(bytes(1181), 0.0) is None
    assert intake.torn == 2


def test_time_goes_on_when_the_count_of_ticks_starts_again(standing, intake) -> None:
    standing.tick = 2**32 - 5
    times = []
    for step in range(5):
        state = intake.accept(standing.raw(), 0.002 * step)
        assert state is not None and intake.time == pytest.approx(state.state.time)
        times.append(intake.time)
    np.testing.assert_allclose(np.diff(times), 0.002, atol=1e-6)


def test_a_robot_that_was_restarted_is_accepted_after_a_while(standing, intake) -> None:
    assert intake.accept(standing.raw(), 0.0) is not None
    standing.tick = 0
    assert intake.accept(standing.raw(), 0.5) is None and intake.old == 1
    assert intake.accept(standing.raw(), 1.5) is not None


def leaning(pitch: float, roll: float = 0.0) -> dict[str, np.ndarray]:
    return {"orientation": rotations.from_yaw_pitch_roll(0.7, pitch, roll)}


def fault_after(watch: BodyLimits, standing, count: int, **changes) -> str | None:
    """What a watch says after as many states with a fault, every 2 ms."""
    found = [watch.fault(standing.next(**changes)) for _ in range(count)]
    assert not any(found[:-1])
    return found[-1]


def test_a_robot_that_leans_by_more_than_1_rad_is_damped(standing) -> None:
    watch = BodyLimits(H1, Limits())
    for pitch, roll in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
        assert fault_after(watch, standing, 50, **leaning(0.95 * pitch, 0.95 * roll)) is None
        assert "leans 1.05 rad" in str(fault_after(watch, standing, 4, **leaning(1.05 * pitch, 1.05 * roll)))


def test_an_orientation_a_hair_beyond_unit_length_has_a_tilt() -> None:
    assert tilt(make_state(orientation=(0.0, 1.0 + 1e-6, 0.0, 0.0))) == pytest.approx(np.pi)


@pytest.mark.parametrize("joint", H1.joint_names)
def test_a_joint_that_turns_too_fast_is_named(standing, joint) -> None:
    watch, dq, index = BodyLimits(H1, Limits()), np.zeros(19), H1.index(joint)
    dq[index] = 2.4 * H1.velocity_limit[index]
    assert fault_after(watch, standing, 10, dq=dq) is None
    assert joint in str(fault_after(watch, standing, 4, dq=-dq * 2.6 / 2.4))


def test_single_wrong_readings_are_left_to_the_estimator(standing) -> None:
    watch, fast = BodyLimits(H1, Limits()), np.full(19, 500.0)
    for _ in range(20):
        assert fault_after(watch, standing, 3, dq=fast) is None
        assert fault_after(watch, standing, 1) is None


def test_a_hot_motor_is_damped_at_once(standing) -> None:
    watch = BodyLimits(H1, Limits())
    assert watch.fault(standing.next(hot=85.0)) is None
    assert "86 degrees" in str(watch.fault(standing.next(hot=86.0)))


def test_what_is_not_a_number_exceeds_no_limit(standing) -> None:
    nan = np.full(19, np.nan)
    assert fault_after(BodyLimits(H1, Limits()), standing, 20, q=nan, dq=nan) is None


@pytest.mark.parametrize("broken", [np.full(4, np.nan), np.zeros(4)], ids=["NaN", "zeros"])
def test_an_imu_without_an_orientation_is_a_fault_after_a_while(standing, broken) -> None:
    """Nobody else watches how the robot leans in the start pose."""
    watch = BodyLimits(H1, Limits())
    assert np.isnan(tilt(standing.next(orientation=broken).state))
    assert fault_after(watch, standing, 50, orientation=broken) is None
    assert fault_after(watch, standing, 1) is None
    assert fault_after(watch, standing, 51, orientation=broken) == "the IMU has given no orientation for 100 ms"


def test_a_start_is_refused_tilted_broken_or_out_of_range(standing) -> None:
    good = standing.next().state
    assert start_refusal(good, H1, Limits()) is None
    assert "leans 0.35" in str(start_refusal(dataclasses.replace(good, **leaning(0.35)), H1, Limits()))
    q, knee = good.q.copy(), H1.index("left_knee_joint")
    q[knee] = 2.05 + 0.09
    assert start_refusal(dataclasses.replace(good, q=q), H1, Limits()) is None
    q[knee] = 2.05 + 0.11
    assert "left_knee_joint reads 2.16 rad" in str(start_refusal(dataclasses.replace(good, q=q), H1, Limits()))
    assert "not usable" in str(start_refusal(dataclasses.replace(good, q=q * np.nan), H1, Limits()))


def test_a_run_is_refused_hanging_or_moving(standing) -> None:
    good = standing.next().state
    assert run_refusal(good, 0.9, H1, Limits()) is None
    assert "hangs, with 29 %" in str(run_refusal(good, 0.29, H1, Limits()))
    dq = np.zeros(19)
    dq[0] = -1.9
    assert run_refusal(dataclasses.replace(good, dq=dq), 0.31, H1, Limits()) is None
    dq[0] = -2.1
    assert H1.joint_names[0] in str(run_refusal(dataclasses.replace(good, dq=dq), 0.9, H1, Limits()))

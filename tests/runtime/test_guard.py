"""What stands in for a controller that fails, or for a state that it cannot use."""

import dataclasses
import time

import numpy as np
import pytest

from hugwbc import Command, JointCommand, UpperBody, load_robot
from hugwbc.errors import ConfigError
from hugwbc.runtime.guard import Guard
from hugwbc.runtime.safety import SafetyFilter, StateCheck
from hugwbc.runtime.safety_report import SafetyLog
from tests.conftest import Recorder, bad_state, make_state

ROBOT = load_robot()


def make_guard(recorder):
    log = SafetyLog()
    return Guard(recorder, StateCheck(ROBOT), SafetyFilter(ROBOT, log), log), log


@pytest.fixture
def guarded():
    recorder = Recorder()
    guard, log = make_guard(recorder)
    guard.reset(make_state())
    return recorder, guard, log


def test_a_bad_state_holds_the_last_command_then_damps_then_recovers(guarded):
    recorder, guard, log = guarded
    recorder.answer = JointCommand.position(ROBOT, ROBOT.nominal + 0.05)
    first = guard.act(make_state(), Command(), UpperBody.none())
    held = [guard.act(bad_state(), Command(), UpperBody.none()) for _ in range(5)]
    damped = guard.act(bad_state(), Command(), UpperBody.none())
    for output in held:
        np.testing.assert_array_equal(output.q, first.q)
        np.testing.assert_array_equal(output.kp, ROBOT.kp)
    np.testing.assert_array_equal(damped.kp, 0.0)
    np.testing.assert_array_equal(damped.kd, ROBOT.kd)
    assert damped.is_finite
    assert len(recorder.seen) == 1, "the controller never sees a state that is not finite"
    resets = recorder.resets
    recovered = guard.act(make_state(), Command(), UpperBody.none())
    assert recorder.resets == resets + 1
    np.testing.assert_array_equal(recovered.kp, ROBOT.kp)
    again = guard.act(bad_state(), Command(), UpperBody.none())
    np.testing.assert_array_equal(again.kp, ROBOT.kp, err_msg="what was missing before the recovery no longer counts")
    guard.act(make_state(), Command(), UpperBody.none())
    assert recorder.resets == resets + 1, "it is reset after damping alone"
    report = log.report()
    assert (report.bad_states, report.held, report.damped) == (7, 6, 1)


@pytest.mark.parametrize(("apart", "calls"), [(0.02, 6), (0.06, 2), (0.09, 2)])
def test_the_last_command_is_held_for_a_time_however_seldom_the_controller_is_asked(guarded, apart, calls):
    recorder, guard, _ = guarded
    guard.act(make_state(time=1.0), Command(), UpperBody.none())
    recorder.answer = RuntimeError("no solution")
    held = [guard.act(make_state(time=1.0 + apart * i), Command(), UpperBody.none()) for i in range(1, calls + 1)]
    assert [bool(command.kp.any()) for command in held] == [True] * (calls - 1) + [False]


def test_a_controller_that_fails_from_the_start_leaves_the_robot_where_it_was(guarded):
    recorder, guard, _ = guarded
    recorder.answer = RuntimeError("no solution")
    guard.reset(make_state(ROBOT.nominal + 0.1))
    np.testing.assert_array_equal(guard.act(make_state(), Command(), UpperBody.none()).q, ROBOT.nominal + 0.1)
    guard.reset(bad_state())
    np.testing.assert_array_equal(guard.act(make_state(), Command(), UpperBody.none()).q, ROBOT.nominal)


def test_an_exception_or_a_nan_of_the_controller_is_contained(guarded):
    recorder, guard, log = guarded
    recorder.answer = RuntimeError("no solution")
    assert guard.act(make_state(), Command(), UpperBody.none()).is_finite
    recorder.answer = JointCommand.position(ROBOT, np.full(19, np.nan))
    assert guard.act(make_state(), Command(), UpperBody.none()).is_finite
    for too_few in (np.zeros(18), np.zeros((19, 1))):
        recorder.answer = dataclasses.replace(JointCommand.position(ROBOT, ROBOT.nominal), kd=too_few)
        assert guard.act(make_state(), Command(), UpperBody.none()).kd.shape == (19,)
    recorder.answer = "none"
    assert guard.act(make_state(), Command(), UpperBody.none()).is_finite
    report = log.report()
    assert report.failures == 2 and report.bad_outputs == 3
    assert "RuntimeError: no solution" in report.messages[0]


def test_a_controller_that_has_no_command_now_makes_no_mistake(guarded):
    recorder, guard, log = guarded
    first = guard.act(make_state(), Command(), UpperBody.none())
    recorder.answer = None
    commands = [guard.act(make_state(), Command(), UpperBody.none()) for _ in range(6)]
    np.testing.assert_array_equal(commands[4].q, first.q)
    np.testing.assert_array_equal(commands[5].kp, 0.0)
    report = log.report()
    assert (report.held, report.damped, report.mistakes) == (5, 1, 0)
    assert report.messages == ("no joint command from recorder: holding the last one, then damping",)


def test_a_command_that_is_given_again_is_looked_at_again(guarded):
    recorder, guard, log = guarded
    recorder.answer = JointCommand.position(ROBOT, ROBOT.nominal.copy())
    first = guard.act(make_state(), Command(), UpperBody.none()).q
    recorder.answer.q[3] = np.nan
    np.testing.assert_array_equal(guard.act(make_state(), Command(), UpperBody.none()).q, first)
    assert log.report().bad_outputs == 1


def test_overruns_are_counted(monkeypatch):
    times = iter([0.0, 0.03, 1.0, 1.01])
    guard, log = make_guard(Recorder())
    monkeypatch.setattr(time, "perf_counter", lambda: next(times))
    guard.act(make_state(), Command(), UpperBody.none())
    guard.act(make_state(), Command(), UpperBody.none())
    assert log.report().overruns == 1
    assert guard.last_tick_s == pytest.approx(0.01)
    guard.act(bad_state(), Command(), UpperBody.none())
    assert guard.last_tick_s == 0.0, "it was not called"


def test_a_controller_that_raises_in_its_reset_is_held_and_reset_again(guarded):
    recorder, guard, log = guarded
    recorder.reset = lambda state: 1 / 0
    guard.reset(make_state())
    assert guard.act(make_state(), Command(), UpperBody.none()).is_finite
    assert log.report().failures == 2 and "ZeroDivisionError" in log.report().messages[0]
    del recorder.reset
    recorder.answer = JointCommand.position(ROBOT, ROBOT.nominal + 0.01)
    np.testing.assert_array_equal(guard.act(make_state(), Command(), UpperBody.none()).q, ROBOT.nominal + 0.01)


@pytest.mark.parametrize("period", [0.0, float("nan"), "0.02", None])
def test_a_controller_without_a_period_is_refused(period):
    recorder = Recorder()
    recorder.period = period
    with pytest.raises(ConfigError, match="give the time between two calls of act"):
        make_guard(recorder)


def test_a_controller_may_show_its_gait_or_not():
    plain, _ = make_guard(Recorder())
    assert np.isnan(plain.phase) and plain.footholds.shape == (2, 2) and np.isnan(plain.footholds).all()
    assert plain.planned_acceleration is None and not plain.stop.any()
    footholds = np.array([[0.1, 0.2], [np.nan, np.nan]])
    planning = Recorder()
    planning.phase, planning.footholds, planning.planned_acceleration = 0.3, footholds, np.arange(19.0)
    plan, _ = make_guard(planning)
    planning.stop = [0.05, 0.0, 0.1]
    assert plan.stop.tolist() == planning.stop
    planning.stop = [0.05, 0.0, np.nan]
    assert not plan.stop.any()
    assert plan.phase == 0.3 and plan.planned_acceleration is planning.planned_acceleration
    np.testing.assert_array_equal(plan.footholds, footholds)

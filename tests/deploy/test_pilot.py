"""From states and requests to joint commands."""

import mujoco
import numpy as np
import pytest
from deploy_bench import Counting, Standing, bring_to, make_pilot

from hugwbc import Command, Gait, load_robot, rotations
from hugwbc.deploy.pilot import Pilot
from hugwbc.deploy.remote import Remote, Request, Sticks
from hugwbc.deploy.state_machine import START_TIME, Mode
from hugwbc.runtime.estimation import StateEstimator
from hugwbc.sim import Simulation

H1 = load_robot()


def running(standing: Standing, *, period: float) -> tuple[Pilot, Counting]:
    """Return a pilot in a run, and its controller, which counts its calls."""
    controller = Counting()
    controller.period = period
    pilot = make_pilot(controller)
    bring_to(Mode.RUN, pilot, standing)
    return pilot, controller


def test_the_first_state_ends_idleness(pilot, standing) -> None:
    assert pilot.mode is Mode.IDLE
    decision = pilot.observe(standing.next())
    assert pilot.mode is Mode.ZERO_TORQUE and decision.command is not None and not np.any(decision.command.kp)


def test_buttons_lead_through_the_modes(standing) -> None:
    pilot = make_pilot()
    pilot.observe(standing.next())
    pilot.observe(standing.next(Remote(frozenset({"Start"}))))
    assert pilot.mode is Mode.START_POSE
    pilot.observe(standing.next(Remote(frozenset({"A"}))))
    assert pilot.mode is Mode.START_POSE and "still on its way" in pilot.machine.events[-1].reason
    pilot.machine._since -= START_TIME
    for _ in range(30):
        pilot.observe(standing.next())
    pilot.observe(standing.next(Remote(frozenset({"A"}))))
    assert pilot.mode is Mode.RUN
    pilot.observe(standing.next(Remote(frozenset({"Select"}))))
    assert pilot.mode is Mode.DAMPING and not pilot.machine.faulty
    modes = [event.after for event in pilot.machine.events if not event.refused]
    assert modes == [Mode.ZERO_TORQUE, Mode.START_POSE, Mode.RUN, Mode.DAMPING]


@pytest.mark.parametrize("mode", [Mode.ZERO_TORQUE, Mode.START_POSE, Mode.RUN])
def test_stop_damps_from_every_mode(pilot, standing, mode) -> None:
    bring_to(mode, pilot, standing)
    decision = pilot.observe(standing.next(), [Request.STOP])
    assert pilot.mode is Mode.DAMPING and decision.command is not None and not np.any(decision.command.kp)


def test_a_robot_that_kneels_down_has_a_fault(pilot, standing) -> None:
    bring_to(Mode.RUN, pilot, standing)
    pilot.observe(standing.next())
    assert not pilot.control.kneels and not pilot.machine.faulty
    pilot.control.motors.dead = "left_knee_joint"
    for _ in range(10):
        pilot.observe(standing.next())
    assert pilot.mode is Mode.RUN and pilot.control.kneels and pilot.machine.faulty


def test_a_robot_that_was_restarted_is_estimated_anew(pilot, standing) -> None:
    standing.tick = 10_000
    bring_to(Mode.ZERO_TORQUE, pilot, standing)
    standing.tick = 0
    for _ in range(30):
        pilot.observe(standing.next())
    assert pilot.estimate is not None and pilot.estimate.time == pytest.approx(1e-3 * standing.tick, abs=0.011)


def test_requests_that_a_mode_does_not_know_are_refused(pilot, standing) -> None:
    bring_to(Mode.DAMPING, pilot, standing)
    for request in (Request.START, Request.RUN):
        pilot.observe(standing.next(), [request])
        assert pilot.mode is Mode.DAMPING and pilot.machine.events[-1].refused


def test_a_tilted_robot_is_refused_at_the_start(pilot, standing) -> None:
    bring_to(Mode.ZERO_TORQUE, pilot, standing)
    tilted = rotations.from_yaw_pitch_roll(0.0, 0.5, 0.0)
    pilot.observe(standing.next(orientation=tilted), [Request.START])
    assert pilot.mode is Mode.ZERO_TORQUE and "leans 0.50 rad" in pilot.machine.events[-1].reason


def test_the_weight_on_the_feet_is_inferred_from_the_legs(pilot, standing) -> None:
    bring_to(Mode.START_POSE, pilot, standing)
    for _ in range(50):
        pilot.observe(standing.next())
    assert pilot.carried == pytest.approx(1.0, abs=0.15)


def test_a_hanging_robot_may_go_to_its_start_pose_but_not_run(pilot, standing) -> None:
    """In the air the legs carry only themselves."""
    simulation = Simulation()
    joints = slice(6, 25)
    simulation.data.qvel[:] = 0.0
    mujoco.mj_inverse(simulation.model, simulation.data)
    gravity = simulation.data.qfrc_bias[joints].copy()
    hanging = {"torque": gravity, "q": H1.nominal, "orientation": np.array([1.0, 0.0, 0.0, 0.0])}
    hanging |= {"imu_gyro": np.zeros(3), "imu_accelerometer": np.array([0.0, 0.0, 9.81])}
    for _ in range(60):
        pilot.observe(standing.next(**hanging))
    pilot.observe(standing.next(**hanging), [Request.START])
    assert "hanging or held" in pilot.machine.events[-1].reason
    pilot.machine._since -= START_TIME
    assert abs(pilot.carried) < 0.1
    pilot.observe(standing.next(**hanging), [Request.RUN])
    assert pilot.mode is Mode.START_POSE and "hangs" in pilot.machine.events[-1].reason


def test_the_controller_is_called_once_a_period_of_the_robots_clock(standing) -> None:
    pilot, controller = running(standing, period=0.02)
    new = [pilot.observe(standing.next()).new for _ in range(100)]
    assert controller.calls == 1 + 10 and sum(new) == 10
    assert np.all(np.diff(np.flatnonzero(new)) == 10)


def test_a_controller_that_gives_no_command_is_told_at_once_and_ends_the_run_for_good(standing) -> None:
    """A robot that hangs limply may have people beside it: a controller that works again must not move it."""
    pilot, controller = running(standing, period=0.02)
    good, controller.think = controller.think, lambda: 1 / 0  # type: ignore[assignment]
    moments = []
    while pilot.mode is Mode.RUN:
        pilot.observe(standing.next())
        moments.append(len(pilot.machine.events))
    assert 0.1 <= len(moments) * 0.002 <= 0.13 and pilot.machine.faulty
    *_, told, end = map(str, pilot.machine.events)
    assert "run: hold raised ZeroDivisionError" in told and moments[15] == moments[-1] - 1
    assert "run -> damping: no joint command from hold for 100 ms" in end
    controller.think, calls = good, controller.calls
    for _ in range(100):
        command = pilot.observe(standing.next()).command
        assert command is not None and not command.kp.any()
    assert pilot.mode is Mode.DAMPING and controller.calls == calls


def test_sticks_that_raise_are_counted(standing) -> None:
    source = Sticks(H1)
    source.steer = lambda remote, time: 1 / 0  # type: ignore[method-assign,assignment]
    pilot = make_pilot(source=source)
    bring_to(Mode.RUN, pilot, standing)
    for _ in range(50):
        pilot.observe(standing.next())
    assert pilot.mode is Mode.RUN and pilot.control.log.report().source_failures > 0


def test_after_a_short_gap_the_controller_does_not_catch_up(standing) -> None:
    pilot, controller = running(standing, period=0.006)
    calls = controller.calls
    pilot.observe(standing.next(after=18))
    assert pilot.mode is Mode.RUN and controller.calls == calls + 1
    pilot.observe(standing.next())
    assert controller.calls == calls + 1


def test_after_a_gap_the_controller_is_again_called_with_the_estimate_of_the_same_state(standing) -> None:
    pilot, _ = running(standing, period=0.006)
    while not pilot.observe(standing.next()).new:
        pass
    assert pilot.observe(standing.next(after=14)).new
    called = [pilot.observe(standing.next()).new for _ in range(8)]
    assert called == [False, True, False, False, True, False, False, True]


def test_a_gap_of_more_than_100_ms_between_ticks_damps(pilot, standing) -> None:
    bring_to(Mode.RUN, pilot, standing)
    pilot.observe(standing.next(after=100))
    assert pilot.mode is Mode.RUN
    pilot.observe(standing.next(after=102))
    assert pilot.mode is Mode.DAMPING and "no state for 102 ms" in pilot.machine.events[-1].reason


def test_the_estimator_is_the_only_source_of_state(standing) -> None:
    """The controller sees a position and a velocity, which no message holds."""
    seen = []
    controller = Counting()
    inner = controller.act

    def act(state, command, upper_body):
        seen.append(state)
        return inner(state, command, upper_body)

    controller.act = act  # type: ignore[method-assign]
    pilot = make_pilot(controller)
    bring_to(Mode.RUN, pilot, standing)
    assert isinstance(pilot.estimator, StateEstimator)
    assert seen[-1].position is not None and seen[-1].velocity is not None
    assert seen[-1].position[2] == pytest.approx(0.93, abs=0.03)


def test_a_single_unusable_reading_neither_raises_nor_forgets(pilot, standing) -> None:
    bring_to(Mode.RUN, pilot, standing)
    before = pilot.estimate.position.copy()
    broken = pilot.observe(standing.next(imu_gyro=np.full(3, np.nan), orientation=np.full(4, np.nan)))
    assert broken.command is not None and broken.command.is_finite
    after = pilot.observe(standing.next())
    assert pilot.mode is Mode.RUN and after.command is not None
    np.testing.assert_allclose(pilot.estimate.position, before, atol=0.01)


def test_time_of_the_commands_starts_with_the_run(standing) -> None:
    class Times:
        def __init__(self) -> None:
            self.asked: list[float] = []

        def command_at(self, t: float) -> Command:
            self.asked.append(t)
            return Command(gait=Gait.STANDING)

        def hands_at(self, t: float) -> None:
            return None

    source = Times()
    pilot = make_pilot(source=source)
    bring_to(Mode.RUN, pilot, standing)
    pilot.observe(standing.next())
    np.testing.assert_allclose(source.asked, [0.0, 0.002], atol=1e-9)


def test_sticks_reach_the_controller(standing) -> None:
    controller = Counting()
    pilot = make_pilot(controller, Sticks(load_robot()))
    bring_to(Mode.RUN, pilot, standing)
    for _ in range(1000):
        pilot.observe(standing.next(Remote(ly=0.5)))
    assert controller.commands[-1].gait is Gait.WALKING
    assert controller.commands[-1].v_x == pytest.approx(0.5)


def test_a_pilot_that_is_behind_calls_the_controller_for_the_newest_state_only(standing) -> None:
    pilot, controller = running(standing, period=0.004)
    calls = controller.calls
    late = [pilot.observe(standing.next(), behind=True) for _ in range(7)]
    assert controller.calls == calls and not any(each.new for each in late)
    newest = pilot.observe(standing.next())
    assert controller.calls == calls + 1 and newest.new and newest.skipped == 3
    assert not pilot.observe(standing.next()).new
    assert pilot.observe(standing.next()).skipped == 0

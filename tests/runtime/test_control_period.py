"""The stages of a control period together: what passes, what odd input does, and when the robot kneels."""

import dataclasses
import decimal
import fractions

import numpy as np
import pytest
import torch

from hugwbc import Command, Gait, JointCommand, RobotState, UpperBody, load_robot
from hugwbc.errors import ConfigError, HugwbcError
from hugwbc.runtime.control_period import Due
from hugwbc.runtime.controllers import HoldController
from hugwbc.runtime.estimation import StateEstimator
from hugwbc.runtime.loop import ControlLoop
from hugwbc.runtime.lowering import LEANING
from hugwbc.sim import Simulation
from hugwbc.upper_ik import UpperBodySource
from tests.conftest import ByHand, Recorder, make_state

ROBOT = load_robot()


@pytest.mark.parametrize(("period", "step"), [(0.004, 0.002), (0.01, 0.002), (0.02, 0.002), (0.004, 0.001)])
def test_periods_keep_in_step_with_the_clock_for_an_hour(period, step):
    due, now, began = Due(period), 0.0, []
    for tick in range(round(3600.0 / step)):
        if due(now):
            began.append(tick)
        now += step
    assert set(np.diff(began)) == {round(period / step)}


def test_readings_without_their_parts_do_not_raise():
    simulation = Simulation()
    loop = ControlLoop("hold", Command(), simulation, UpperBodySource(load_robot()))
    loop.reset()
    sense, count = simulation.sense, iter(range(10**6))
    odd = [{"imu_gyro": None}, {"torque": None}, {"q": np.zeros(5), "dq": np.zeros(5)}]

    def sometimes():
        number = next(count)
        return dataclasses.replace(sense(), **(odd[number // 10 % 3] if number % 10 == 3 else {}))

    simulation.sense = sometimes
    for _ in range(10):
        loop.step(loop.decide(simulation.time), loop.period)
    assert loop.control.estimate.is_usable


def test_the_robot_kneels_when_a_motor_is_dead():
    period = ByHand(HoldController(ROBOT))
    state = make_state()
    period.start(state)
    period.act(state, Command(), UpperBody.none())
    period.control.motors.dead = "left_knee_joint"
    period.act(state, Command(), UpperBody.none())
    report = period.report()
    assert report.lowered == 1 and "the motor of left_knee_joint is dead: kneeling" in " ".join(report.messages)
    period.start(state)
    period.act(state, Command(), UpperBody.none())
    assert period.report().lowered == 0


def test_a_lost_state_makes_the_robot_kneel_and_then_damps_it():
    controller = HoldController(ROBOT)
    controller.period = 0.002
    period, state, knee = ByHand(controller), make_state(), ROBOT.index("left_knee_joint")
    period.start(state)
    lost = dataclasses.replace(state, coasted=("imu",), lost="the IMU failed for 300 ms")
    commands = [period.act(lost, Command(), UpperBody.none())]
    np.testing.assert_allclose(commands[0].q, state.q, atol=0.01)
    commands += [period.act(state, Command(), UpperBody.none()) for _ in range(1500)]
    assert commands[600].q[knee] == pytest.approx(LEANING[1], abs=1e-3) and commands[600].kp[knee] > 0.0
    assert (commands[-1].kp == 0.0).all() and (commands[-1].kd > 0.0).all(), "it stays down, and is damped in the end"
    report = period.report()
    assert report.lowered == 1501 and report.readings_refused == {"imu": 1} and "kneeling" in " ".join(report.messages)
    period.start(state)
    np.testing.assert_array_equal(period.act(state, Command(), UpperBody.none()).q, ROBOT.nominal)


def test_the_source_of_arm_targets_is_told_the_command_that_is_followed():
    """It steps faster than asked for, and walks on for a while before it stands."""
    period, told = ByHand(HoldController(ROBOT)), []
    update = period.update
    period.update = lambda *given: told.append(given[-1]) or update(*given)  # type: ignore[method-assign]
    period.start(make_state())
    fast = Command(v_x=1.5, f=1.5, gait=Gait.WALKING)
    for command in (fast, fast, Command(), Command()):
        period.act(make_state(), command, UpperBody.none())
    assert [command.gait for command in told] == [Gait.STANDING, Gait.WALKING, Gait.WALKING, Gait.WALKING]
    assert [command.f for command in told[1:]] == [2.0, 2.0, 2.0]


def test_a_source_of_arm_targets_that_gives_no_pair_is_counted_and_leaves_the_arms_to_the_controller():
    period = ByHand(HoldController(ROBOT))
    period.start(make_state())
    period.update = lambda *_: UpperBody.targets(np.zeros(8))  # type: ignore[method-assign]
    period.control.observe(make_state(), 0.0)
    np.testing.assert_array_equal(period.control.decide(0.0).q, ROBOT.nominal)
    report = period.report()
    assert report.source_failures == 1 and "the source of arm targets raised TypeError" in report.messages[0]


def test_arm_targets_and_estimates_for_another_robot_are_refused():
    message = r"moves the arms of h1, which has other joints than g1; give UpperBodySource\(load_robot\(\"g1\"\)\)"
    with pytest.raises(ConfigError, match=message):
        ControlLoop("hold", Command(), Simulation(robot="g1"), UpperBodySource(ROBOT))
    with pytest.raises(ConfigError, match="the estimator knows h1, which has other joints than g1"):
        ControlLoop("hold", Command(), Simulation(robot="g1"), estimator=StateEstimator(ROBOT))


GRADIENT = torch.full((19,), 0.5, requires_grad=True)
ODD = {
    "none": None,
    "text": "ahead",
    "bytes": b"0.3",
    "flag": True,
    "huge": 10**400,
    "complex": 1j,
    "object": object(),
    "too many": np.zeros(20),
    "too few": [0.0] * 7,
    "turned": np.zeros((19, 1)),
    "texts": ["0.1"] * 19,
    "ragged": [[1.0], [2.0, 3.0]],
    "gradient": GRADIENT,
    "tensor": torch.tensor(0.25),
    "half": np.float16(0.25),
    "zero-dimensional": np.array(0.25),
    "fraction": fractions.Fraction(1, 4),
    "decimal": decimal.Decimal("0.25"),
}


@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize("kind", [RobotState, Command, UpperBody, JointCommand])
def test_one_odd_field_anywhere_never_raises_in_a_period_and_never_gets_out(kind, odd):
    recorder = Recorder()
    period = ByHand(recorder)
    period.start(make_state())
    sound = {
        RobotState: make_state(position=np.zeros(3)),
        Command: Command(gait=Gait.WALKING),
        UpperBody: UpperBody.targets(np.zeros(8)),
        JointCommand: recorder.answer,
    }
    for field in dataclasses.fields(kind):
        try:
            given = sound | {kind: dataclasses.replace(sound[kind], **{field.name: ODD[odd]})}
        except HugwbcError as error:
            assert kind is Command and ("give a number" in str(error) or "gait" in str(error))
            continue
        recorder.answer = given[JointCommand]
        output = period.act(given[RobotState], given[Command], given[UpperBody])
        assert output.is_finite and {getattr(output, f.name).shape for f in dataclasses.fields(output)} == {(19,)}
    period.start(make_state())
    for wrong in ((ODD[odd], Command(), UpperBody.none()), (make_state(), ODD[odd], UpperBody.none()),
                  (make_state(), Command(), ODD[odd])):  # fmt: skip
        assert period.act(*wrong).is_finite
    recorder.answer = ODD[odd]
    assert period.act(make_state(), Command(), UpperBody.none()).is_finite
    report = period.report()
    assert report.failures >= (odd != "none") and report.held >= 1 and report.source_failures == 1


@pytest.mark.parametrize("jump", [34.0, 95.0])
def test_a_single_wild_gyro_reading_between_two_updates_turns_nothing(jump):
    """The mean of five readings alone, a fifth of it, could be true."""
    leans = []
    for wild in (0.0, jump):
        loop = ControlLoop(HoldController(ROBOT), Command(), Simulation(sensing="robot", seed=0))
        loop.reset()
        control, simulation = loop.control, loop.simulation
        for tick in range(60):
            simulation.step(JointCommand.position(ROBOT, ROBOT.nominal), 0.002)
            reading = simulation.sense()
            if tick == 52:
                reading = dataclasses.replace(reading, imu_gyro=reading.imu_gyro + np.array([wild, 0.0, 0.0]))
            control.observe(reading, simulation.time)
        leans.append(control.estimate.orientation)
    np.testing.assert_allclose(*leans, atol=1e-3)
    assert control.log.report().readings_refused == {"imu": 1}

import dataclasses

import numpy as np
import pytest

from hugwbc import Command, Gait, UpperBody, rotations
from hugwbc.kinematics import Kinematics
from hugwbc.mbc import WholeBodyController
from hugwbc.mbc.prediction import Predictor
from hugwbc.sim import Simulation

PERIOD = 0.002


def _aged(predictor, state, age):
    return predictor.predict(dataclasses.replace(state, age=age))


def test_a_present_state_and_one_without_history_come_back_as_they_are(random_state):
    state = random_state(np.random.default_rng(0))
    predictor = Predictor(Kinematics(), PERIOD)
    old = dataclasses.replace(state, age=0.01)
    assert predictor.predict(old) is old
    predictor.record(np.zeros(25))
    assert predictor.predict(state) is state
    predictor.reset()
    assert predictor.predict(old) is old


def test_constant_joint_accelerations_give_parabolas(standing_state):
    rng = np.random.default_rng(1)
    kinematics = Kinematics()
    predictor = Predictor(kinematics, PERIOD)
    dq, acceleration = rng.normal(size=19), rng.normal(size=19)
    full = np.zeros(25)
    full[kinematics.columns] = acceleration
    for _ in range(20):
        predictor.record(full)
    for age in (0.001, 0.007, 0.01):
        found = _aged(predictor, dataclasses.replace(standing_state, dq=dq), age)
        assert found.dq == pytest.approx(dq + acceleration * age)
        assert found.q == pytest.approx(standing_state.q + dq * age + 0.5 * acceleration * age**2)
        assert found.age == pytest.approx(0.0, abs=1e-12)


def test_the_base_flies_on_and_turns_on(standing_state):
    predictor = Predictor(Kinematics(), PERIOD)
    for _ in range(10):
        predictor.record(np.zeros(25))
    yawed = dataclasses.replace(standing_state, orientation=rotations.from_yaw_pitch_roll(1.0, 0.0, 0.0))
    flying = dataclasses.replace(yawed, velocity=np.array([1.0, -2.0, 0.5]))
    found = _aged(predictor, flying, 0.01)
    assert found.position == pytest.approx(flying.position + 0.01 * flying.velocity)
    assert found.velocity == pytest.approx(flying.velocity)
    turning = dataclasses.replace(yawed, angular_velocity=np.array([0.0, 0.0, 3.0]))
    assert _aged(predictor, turning, 0.01).yaw == pytest.approx(1.03)


def test_only_the_latest_accelerations_count_and_old_readings_are_not_trusted_for_ever(standing_state):
    kinematics = Kinematics()
    predictor = Predictor(kinematics, PERIOD)
    for value in (100.0, 1.0, 2.0):
        full = np.zeros(25)
        full[kinematics.columns] = value
        predictor.record(full)
    assert _aged(predictor, standing_state, 0.003).dq == pytest.approx(np.full(19, 0.001 * 1.0 + 0.002 * 2.0))
    for _ in range(100):
        predictor.record(np.zeros(25))
    moving = dataclasses.replace(standing_state, velocity=np.array([1.0, 0.0, 0.0]))
    assert _aged(predictor, moving, 1.0).position[0] < 0.04


def test_late_readings_cost_nothing_where_the_plan_foresees_the_motion():
    """Walking on exact sensors that are 10 ms late: the yaw is as steady as without latency."""
    wobble = {}
    for latency in (0.0, 0.01):
        simulation, controller = Simulation(latency=latency), WholeBodyController()
        simulation.reset()
        controller.reset(simulation.sense())
        rates = []
        for tick in range(1250):
            command = controller.act(simulation.sense(), Command(v_x=0.5, gait=Gait.WALKING), UpperBody.none())
            state = simulation.step(command, PERIOD)
            if tick > 500:
                rates.append(abs(rotations.rotate(state.orientation, state.angular_velocity)[2]))
        assert not simulation.fallen
        wobble[latency] = np.mean(rates)
    assert wobble[0.01] < 1.3 * wobble[0.0]

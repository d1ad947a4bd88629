import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from hugwbc import Command, Gait, UpperBody, load_robot, rotations
from hugwbc.kinematics import Kinematics
from hugwbc.mbc import WholeBodyController
from hugwbc.mbc.state_completion import LegOdometry, Predictor
from hugwbc.sim import Simulation

BOTH = np.ones(2, dtype=bool)
PERIOD = 0.002


def test_a_complete_state_is_left_alone(standing_state):
    assert LegOdometry(load_robot()).complete(standing_state, BOTH, 0.002) is standing_state


def test_height_comes_from_the_standing_soles(standing_state):
    blind = dataclasses.replace(standing_state, position=None, velocity=None)
    found = LegOdometry(load_robot()).complete(blind, BOTH, 0.002)
    kinematics = Kinematics(load_robot())
    kinematics.update(standing_state)
    assert found.position[2] == pytest.approx(0.98 - kinematics.position("left_sole")[2], abs=2e-3)
    assert found.velocity == pytest.approx(np.zeros(3), abs=1e-12)


def test_velocity_is_that_which_keeps_the_standing_foot_still(standing_state):
    rng = np.random.default_rng(0)
    moving = dataclasses.replace(standing_state, dq=rng.uniform(-1, 1, 19), angular_velocity=rng.uniform(-1, 1, 3))
    blind = dataclasses.replace(moving, position=None, velocity=None)
    for contact, side in (([True, False], "left"), ([False, True], "right")):
        found = LegOdometry(load_robot()).complete(blind, np.array(contact), 0.002)
        kinematics = Kinematics(load_robot())
        kinematics.update(found)
        assert kinematics.velocity(f"{side}_sole")[:3] == pytest.approx(np.zeros(3), abs=1e-12)


def test_in_flight_the_centre_of_mass_falls_freely_however_the_joints_move(standing_state):
    rng, odometry, kinematics, dt = np.random.default_rng(1), LegOdometry(load_robot()), Kinematics(load_robot()), 0.002
    moving = dataclasses.replace(standing_state, dq=rng.uniform(-1, 1, 19), position=None, velocity=None)
    found = odometry.complete(moving, np.array([True, False]), dt)
    track = []
    for _ in range(50):
        kinematics.update(found)
        com = pin.centerOfMass(kinematics.model, kinematics.data, kinematics.q, kinematics.v).copy()
        track.append((com, kinematics.data.vcom[0].copy()))
        moving = dataclasses.replace(moving, q=moving.q + dt * moving.dq, dq=rng.uniform(-1, 1, 19))
        found = odometry.complete(moving, np.zeros(2, dtype=bool), dt)
    (start, speed), (end, last) = track[0], track[-1]
    time, gravity = 49 * dt, np.array([0.0, 0.0, -9.81])
    assert last == pytest.approx(speed + gravity * time, abs=1e-9)
    assert end == pytest.approx(start + speed * time + 0.5 * gravity * time**2, abs=1e-9)


def test_of_two_feet_the_one_that_slides_tells_nothing(standing_state):
    odometry, kinematics = LegOdometry(load_robot()), Kinematics(load_robot())
    moving = dataclasses.replace(
        standing_state, angular_velocity=np.array([0.0, 0.3, 0.0]), position=None, velocity=None
    )
    steady = odometry.complete(moving, BOTH, 0.002)
    sliding = moving.dq.copy()
    sliding[load_robot().index("right_knee_joint")] = 3.0
    found = odometry.complete(dataclasses.replace(moving, dq=sliding), BOTH, 0.002)
    assert found.velocity == pytest.approx(steady.velocity, abs=1e-12)
    kinematics.update(found)
    assert kinematics.velocity("left_sole")[:3] == pytest.approx(np.zeros(3), abs=1e-12)
    assert np.linalg.norm(kinematics.velocity("right_sole")[:3]) > 0.5


def _run_blind(gait, seconds):
    """Forward speeds after two seconds of a command of 0.4 m/s."""
    simulation, controller = Simulation(sensing="exact"), WholeBodyController(load_robot())
    state = simulation.reset(xy=(3.0, 1.0), yaw=1.0)

    def blind(true):
        return dataclasses.replace(true, position=None, velocity=None)

    controller.reset(blind(state))
    speeds = []
    for tick in range(round(seconds / controller.period)):
        command = controller.act(blind(state), Command(v_x=0.4, gait=gait), UpperBody.none())
        state = simulation.step(command, controller.period)
        if tick * controller.period > 2.0:
            speeds.append(float(rotations.rotation_z(-state.yaw)[0] @ state.velocity))
    assert not simulation.fallen
    assert controller.diagnostics.fallbacks == 0
    return speeds


@pytest.mark.parametrize(("gait", "seconds", "tolerance"), [(Gait.WALKING, 3.5, 0.08), (Gait.JUMPING, 2.6, 0.2)])
def test_it_walks_and_jumps_without_an_estimator(gait, seconds, tolerance):
    assert np.mean(_run_blind(gait, seconds)) == pytest.approx(0.4, abs=tolerance)


def _aged(predictor, state, age):
    return predictor.predict(dataclasses.replace(state, age=age))


def test_a_present_state_and_one_without_history_come_back_as_they_are(random_state):
    state = random_state(np.random.default_rng(0))
    predictor = Predictor(Kinematics(load_robot()), PERIOD)
    old = dataclasses.replace(state, age=0.01)
    assert predictor.predict(old) is old
    predictor.record(np.zeros(25))
    assert predictor.predict(state) is state
    predictor.reset()
    assert predictor.predict(old) is old


def test_constant_joint_accelerations_give_parabolas(standing_state):
    rng = np.random.default_rng(1)
    kinematics = Kinematics(load_robot())
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
    predictor = Predictor(Kinematics(load_robot()), PERIOD)
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
    kinematics = Kinematics(load_robot())
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
        simulation, controller = (
            Simulation(sensing="exact", latency=latency),
            WholeBodyController(load_robot(), period=PERIOD),
        )
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

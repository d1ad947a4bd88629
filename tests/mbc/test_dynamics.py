"""Dynamics against MuJoCo and finite differences, and states carried over a latency."""

import dataclasses

import mujoco
import numpy as np
import pytest

from hugwbc import Command, Gait, UpperBody, load_robot, rotations
from hugwbc.kinematics import Kinematics
from hugwbc.mbc import WholeBodyController
from hugwbc.mbc.dynamics import Dynamics, Predictor
from hugwbc.sim import Simulation

PERIOD = 0.002


def _set_mujoco(data, state):
    data.qpos[:3], data.qpos[3:7], data.qpos[7:] = state.position, state.orientation, state.q
    data.qvel[:3], data.qvel[3:6], data.qvel[6:] = state.velocity, state.angular_velocity, state.dq


def test_equation_of_motion_agrees_with_mujoco_inverse_dynamics(random_state):
    model = mujoco.MjModel.from_xml_path(str(load_robot().xml_path))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(model)
    dynamics = Dynamics(load_robot())
    rng = np.random.default_rng(0)
    for _ in range(20):
        state = random_state(rng)
        _set_mujoco(data, state)
        data.qacc[:] = rng.uniform(-5, 5, 25)
        mujoco.mj_inverse(model, data)

        dynamics.update(state)
        acceleration = np.zeros(25)
        # MuJoCo's base acceleration is in the world; Pinocchio's is the rate of the velocity in the base frame.
        in_base = rotations.rotate_inverse(state.orientation, data.qacc[:3])
        acceleration[:3] = in_base - np.cross(state.angular_velocity, dynamics.v[:3])
        acceleration[3:6] = data.qacc[3:6]
        acceleration[dynamics.columns] = data.qacc[6:]
        force = dynamics.M @ acceleration + dynamics.bias

        # Passive damping acts as a force in MuJoCo and is part of the bias here; mj_inverse already includes it.
        assert force[dynamics.columns] == pytest.approx(data.qfrc_inverse[6:], abs=1e-8)
        world_force = rotations.rotate(state.orientation, force[:3])
        assert world_force == pytest.approx(data.qfrc_inverse[:3], abs=1e-8)
        assert force[3:6] == pytest.approx(data.qfrc_inverse[3:6], abs=1e-8)


def test_two_line_contacts_have_full_rank_where_two_full_contacts_do_not(standing_state):
    dynamics = Dynamics(load_robot())
    straight = standing_state.q.copy()
    straight[load_robot().hip_yaw_roll] = 0.0
    dynamics.update(dataclasses.replace(standing_state, q=straight))
    feet = [dynamics.frame(f"{side}_sole") for side in ("left", "right")]
    full = np.vstack([foot.jacobian for foot in feet])
    line = np.vstack([np.vstack((foot.jacobian[:3], (foot.rotation.T @ foot.jacobian[3:])[1:])) for foot in feet])
    assert np.linalg.matrix_rank(full, tol=1e-6) == 11
    assert np.linalg.matrix_rank(line, tol=1e-6) == 10
    # Directions that the base can move in while the feet stand: full contacts tie its sway to its roll.
    assert _base_freedom(full) == 5
    assert _base_freedom(line) == 6


def _base_freedom(jacobian):
    _, values, rows = np.linalg.svd(jacobian)
    null_space = rows[np.count_nonzero(values > 1e-6) :]
    return np.linalg.matrix_rank(null_space[:, :6], tol=1e-6)


def test_point_is_the_frame_without_its_velocity(random_state):
    dynamics = Dynamics(load_robot())
    dynamics.update(random_state(np.random.default_rng(1)))
    position, jacobian = dynamics.point("left_toe"), dynamics.point_jacobian("left_toe")
    frame = dynamics.frame("left_toe")
    assert np.array_equal(position, frame.position)
    assert np.array_equal(jacobian, frame.jacobian[:3])
    assert jacobian @ dynamics.v == pytest.approx(frame.velocity[:3], abs=1e-12)


@pytest.mark.parametrize("roll", [-0.2, 0.2])
def test_a_foot_that_rolls_stands_on_its_lower_edge(standing_state, roll):
    dynamics = Dynamics(load_robot())
    dynamics.edge = 0.015
    state = dataclasses.replace(
        standing_state,
        orientation=rotations.from_yaw_pitch_roll(0.0, 0.0, roll),
        angular_velocity=np.array([1.0, 0.5, -0.3]),
    )
    dynamics.update(state)
    position, jacobian = dynamics.point("left_heel"), dynamics.point_jacobian("left_heel")
    frame = dynamics.frame("left_heel")
    edge = frame.position + frame.rotation @ [0.0, -np.sign(roll) * 0.015, 0.0]
    assert position == pytest.approx(edge, abs=1e-12)
    assert position[2] < frame.position[2]
    velocity = frame.velocity[:3] + np.cross(frame.velocity[3:], edge - frame.position)
    assert jacobian @ dynamics.v == pytest.approx(velocity, abs=1e-12)


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
        simulation = Simulation(sensing="exact", latency=latency)
        controller = WholeBodyController(load_robot(), period=PERIOD)
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

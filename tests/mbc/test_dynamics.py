import dataclasses

import mujoco
import numpy as np
import pytest

from hugwbc import load_robot, rotations
from hugwbc.mbc.dynamics import Dynamics


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


def test_mass_and_weight_are_the_table_s(standing_state):
    dynamics = Dynamics(load_robot())
    dynamics.update(standing_state)
    assert dynamics.mass == pytest.approx(load_robot().mass, abs=0.01)
    # At rest the bias of the base's vertical is the weight.
    assert dynamics.bias[2] == pytest.approx(load_robot().mass * 9.81, abs=0.2)


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

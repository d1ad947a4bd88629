"""Many robots: in lockstep with one, isolated from one another's failures, with the same sensors."""

import mujoco
import numpy as np
import torch

from hugwbc import JointCommand, load_robot
from hugwbc.robot import SIDES
from hugwbc.sim import Simulation, rough_terrain
from hugwbc.sim.batch import BatchSimulation
from hugwbc.sim.robot_model import TRAINING_TIMESTEP, load_model

ROBOT = load_robot()


def _disturbed(count: int, **options: object) -> BatchSimulation:
    """Robots in different poses and velocities, slightly above the ground."""
    batch = BatchSimulation(count, **options, robot=load_robot())
    rng = np.random.default_rng(0)
    batch.qpos[:, 7:] += batch.tensor(rng.uniform(-0.1, 0.1, (count, 19)))
    batch.qpos[:, 2] += 0.02
    batch.qvel[:] = batch.tensor(rng.uniform(-0.3, 0.3, (count, 25)))
    batch.ctrl[:] = batch.tensor(ROBOT.nominal + rng.uniform(-0.2, 0.2, (count, 19)))
    batch.forward(torch.arange(count))
    return batch


def test_every_robot_moves_as_one_alone_does() -> None:
    """Same model, same numbers: bit for bit the roll-out of plain MuJoCo."""
    batch = _disturbed(3)
    model = load_model(TRAINING_TIMESTEP, robot=load_robot())
    alone = []
    for robot in range(3):
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        data.qpos[:], data.qvel[:], data.ctrl[:] = batch.qpos[robot], batch.qvel[robot], batch.ctrl[robot]
        for _ in range(80):
            mujoco.mj_step(model, data)
        alone.append(np.concatenate((data.qpos, data.qvel)))
    for _ in range(20):
        assert not batch.step(4).any()
    np.testing.assert_array_equal(np.hstack((batch.qpos, batch.qvel)), alone)


def test_number_of_threads_does_not_show() -> None:
    one, two = _disturbed(4, threads=1), _disturbed(4, threads=2)
    for batch in (one, two):
        for _ in range(20):
            batch.step(4)
    np.testing.assert_array_equal(one.qpos, two.qpos)


def test_a_robot_that_diverges_is_flagged_and_the_others_go_on() -> None:
    faulty, sound = _disturbed(3), _disturbed(3)
    faulty.qvel[1, 3] = np.nan
    np.testing.assert_array_equal(faulty.step(4), [False, True, False])
    np.testing.assert_array_equal(sound.step(4), [False, False, False])
    np.testing.assert_array_equal(faulty.qpos[[0, 2]], sound.qpos[[0, 2]])
    assert faulty.qpos.isfinite().all()
    # The flag is of the last step only.
    assert not faulty.step(4).any()


def test_a_control_that_is_not_finite_is_flagged() -> None:
    batch = _disturbed(2)
    batch.ctrl[0, 5] = np.nan
    np.testing.assert_array_equal(batch.step(1), [True, False])


def test_sensors_agree_with_those_of_one_simulation() -> None:
    terrain = rough_terrain(0.02, np.random.default_rng(1))
    batch, simulation = (
        BatchSimulation(2, terrain=terrain, robot=load_robot()),
        Simulation(timestep=TRAINING_TIMESTEP, terrain=terrain),
    )
    simulation.reset(xy=(1.0, 0.5))
    for _ in range(20):
        simulation.step(JointCommand.position(ROBOT, ROBOT.nominal), TRAINING_TIMESTEP)
    batch.qpos[1], batch.qvel[1] = map(batch.tensor, (simulation.data.qpos, simulation.data.qvel))
    batch.ctrl[1] = batch.tensor(ROBOT.nominal)
    batch.forward(torch.tensor([1]))
    for index, side in enumerate(SIDES):
        sole = simulation.data.sensor(f"{side}_sole_position").data
        np.testing.assert_allclose(batch.sole_position()[1, index], sole, atol=1e-9)
        velocity = simulation.data.sensor(f"{side}_sole_velocity").data
        np.testing.assert_allclose(batch.sole_velocity()[1, index], velocity, atol=1e-9)
    # The contact solver starts elsewhere, so forces agree to its tolerance only.
    np.testing.assert_allclose(batch.foot_force()[1], simulation.state().foot_force, rtol=0.02, atol=2.0)
    assert batch.foot_force()[1, :, 2].sum() > 200.0
    assert batch.link_force().shape == (2, 11)


def test_forward_refreshes_the_given_robots() -> None:
    batch = BatchSimulation(2, robot=load_robot())
    batch.qpos[:, 2] += 0.3
    before = batch.sole_position()[:, :, 2].clone()
    batch.forward(torch.tensor([1]))
    after = batch.sole_position()[:, :, 2]
    np.testing.assert_allclose(after[1] - before[1], 0.3, atol=1e-12)
    np.testing.assert_allclose(after[0], before[0], atol=1e-12)


def test_a_link_on_the_ground_shows_its_force() -> None:
    batch = BatchSimulation(2, robot=load_robot())
    batch.qpos[1, 2] = 0.3
    batch.qpos[1, 3:7] = torch.tensor([np.cos(np.pi / 4), 0, np.sin(np.pi / 4), 0])  # face down
    for _ in range(60):
        batch.step(4)
    torso = ROBOT.contact_links.index("torso_link")
    assert batch.link_force()[1, torso] > 20.0
    assert batch.link_force()[0, torso] == 0.0

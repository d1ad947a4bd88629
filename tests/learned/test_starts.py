import dataclasses

import numpy as np
import pytest
import torch

from hugwbc.gait import Gait
from hugwbc.learned.config import CommandConfig, EnvConfig
from hugwbc.learned.env import HumanoidEnv
from hugwbc.learned.starts import START_JOINT_NOISE, START_VELOCITY, draw_starts, stand_on_one_leg
from hugwbc.mirror import VECTOR_SIGNS, load_mirror
from hugwbc.sim.batch import BatchSimulation

HOPPING = CommandConfig(standing_fraction=0.2, walking_fraction=0.0, hopping_fraction=0.8)


@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_the_centre_of_mass_is_over_the_hopping_leg_and_the_other_in_the_air(yaw: float) -> None:
    simulation = BatchSimulation(2)
    qpos = simulation.qpos.copy()
    qpos[:, 3], qpos[:, 6] = np.cos(yaw / 2.0), np.sin(yaw / 2.0)
    for row, gait in enumerate((Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT)):
        simulation.qpos[row] = stand_on_one_leg(qpos[row : row + 1], gait)
    simulation.forward(np.arange(2))
    soles, mass = simulation.sole_position(), simulation.batch.bind("subtree_com")[:, 0]
    for row, stance in enumerate((0, 1)):
        distance = np.linalg.norm((mass[row] - soles[row, stance])[:2])
        assert distance < 0.07, "from the sole's centre; a stand on both legs has 0.2 m"
        assert abs(soles[row, stance, 2]) < 0.04 and soles[row, 1 - stance, 2] > 0.1


def test_the_legs_are_mirror_images() -> None:
    qpos = BatchSimulation(1).qpos.copy()
    left, right = (stand_on_one_leg(qpos, gait)[0] for gait in (Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT))
    np.testing.assert_allclose(load_mirror().joints(left[7:]), right[7:], atol=1e-12)
    np.testing.assert_allclose(left[4:7] * -VECTOR_SIGNS, right[4:7], atol=1e-12)


def test_only_hopping_episodes_start_on_one_leg_and_only_if_asked() -> None:
    torch.set_num_threads(1)
    for fraction in (0.0, 1.0):
        config = dataclasses.replace(EnvConfig(count=60), command=HOPPING, one_leg_start=fraction)
        env = HumanoidEnv(config, seed=0, threads=1)
        left, right = env.gait == Gait.HOPPING_LEFT, env.gait == Gait.HOPPING_RIGHT
        lifted = env.readings.clearance > 0.08
        assert lifted[left].float().mean(0).tolist() == pytest.approx([0.0, fraction], abs=0.1)
        assert lifted[right].float().mean(0).tolist() == pytest.approx([fraction, 0.0], abs=0.1)
        assert not lifted[~(left | right)].any()
        arms = env.simulation.qpos[:, 7:] == env.simulation.ctrl
        assert arms.all()


def test_starts_are_about_the_nominal_pose_in_any_heading() -> None:
    nominal = BatchSimulation(1).qpos[0].copy()
    qpos, qvel = draw_starts(nominal, torch.arange(500), None, torch.Generator().manual_seed(0))
    assert qpos.shape == (500, 26) and qvel.shape == (500, 25)
    np.testing.assert_array_equal(qpos[:, [0, 1, 2, 4, 5]], np.tile(nominal[[0, 1, 2, 4, 5]], (500, 1)))
    np.testing.assert_allclose(np.linalg.norm(qpos[:, 3:7], axis=1), 1.0, atol=1e-6)
    headings = 2.0 * np.arctan2(qpos[:, 6], qpos[:, 3])
    assert headings.min() < -3.0 and headings.max() > 3.0 and abs(headings.mean()) < 0.3
    for values, half_width in ((qpos[:, 7:] - nominal[7:], START_JOINT_NOISE), (qvel[:, :6], START_VELOCITY)):
        assert np.abs(values).max() <= half_width + 1e-6
        assert values.std() == pytest.approx(half_width / np.sqrt(3.0), rel=0.05)
    assert not qvel[:, 6:].any()

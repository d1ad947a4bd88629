"""The device's physics against the processor's, on warp's CPU device; the first run compiles for minutes."""

import numpy as np
import pytest

from hugwbc.errors import ConfigError
from hugwbc.robot import load_robot
from hugwbc.sim.batch import BatchSimulation

pytest.importorskip("mujoco_warp")
from hugwbc.sim.warp_batch import WarpSimulation

pytestmark = pytest.mark.slow
ROBOT = load_robot()
COUNT = 3


def disturbed(simulation: BatchSimulation) -> BatchSimulation:
    """Robots of different friction and stiffness, in different poses, slightly above the ground."""
    rng = np.random.default_rng(0)
    simulation.batch.expand("geom_friction")[:, :, 0] *= np.linspace(0.5, 1.5, COUNT)[:, None]
    simulation.batch.expand("body_mass")[:, 5] += np.arange(COUNT)
    gain, bias = simulation.batch.expand("actuator_gainprm"), simulation.batch.expand("actuator_biasprm")
    stiffness = np.linspace(0.8, 1.2, COUNT)
    gain[:, :, 0] *= stiffness[:, None]
    bias[:, :, 1] *= stiffness[:, None]
    simulation.batch.set_const()
    simulation.qpos[:, 7:] += rng.uniform(-0.1, 0.1, (COUNT, 19))
    simulation.qpos[:, 2] += 0.01
    simulation.qvel[:] = rng.uniform(-0.3, 0.3, (COUNT, 25))
    simulation.ctrl[:] = ROBOT.nominal + rng.uniform(-0.2, 0.2, (COUNT, 19))
    simulation.forward(np.arange(COUNT))
    return simulation


@pytest.fixture
def pair() -> tuple[BatchSimulation, WarpSimulation]:
    warp = WarpSimulation(COUNT, device="cpu")
    disturbed(warp)
    return disturbed(BatchSimulation(COUNT)), warp


def test_both_backends_move_alike(pair: tuple[BatchSimulation, WarpSimulation]) -> None:
    cpu, warp = pair
    for _ in range(5):
        assert not cpu.step(4).any() and not warp.step(4).any()
        np.testing.assert_allclose(warp.qpos, cpu.qpos, atol=1e-5)
        np.testing.assert_allclose(warp.qvel, cpu.qvel, atol=1e-3)
        np.testing.assert_allclose(warp.torque, cpu.torque, atol=0.05)
        np.testing.assert_allclose(warp.sole_position(), cpu.sole_position(), atol=1e-5)
        np.testing.assert_allclose(warp.sole_velocity(), cpu.sole_velocity(), atol=1e-3)
        np.testing.assert_allclose(warp.foot_force(), cpu.foot_force(), atol=1.0)
        np.testing.assert_allclose(warp.link_force(), cpu.link_force(), atol=1.0)
    assert cpu.foot_force()[:, :, 2].max() > 100.0, "the feet must have touched the ground"
    assert np.ptp(cpu.qpos[:, 7:], axis=0).max() > 0.01


def test_forward_of_some_leaves_the_others(pair: tuple[BatchSimulation, WarpSimulation]) -> None:
    for simulation in pair:
        simulation.step(4)
        before = simulation.foot_force().copy(), simulation.warm_start.copy()
        simulation.qpos[1, 2] += 0.5
        simulation.qvel[1] = 0.0
        simulation.forward(np.array([1]))
        np.testing.assert_array_equal(simulation.foot_force()[[0, 2]], before[0][[0, 2]])
        np.testing.assert_array_equal(simulation.warm_start[[0, 2]], before[1][[0, 2]])
        np.testing.assert_array_equal(simulation.foot_force()[1], 0.0)
        assert simulation.sole_position()[1, :, 2].min() > 0.3


def test_a_robot_that_diverges_is_flagged_and_the_others_go_on(pair: tuple[BatchSimulation, WarpSimulation]) -> None:
    cpu, warp = pair
    warp.qvel[1, 3] = np.nan
    np.testing.assert_array_equal(warp.step(4), [False, True, False])
    cpu.step(4)
    np.testing.assert_allclose(warp.qpos[[0, 2]], cpu.qpos[[0, 2]], atol=1e-5)
    assert np.all(np.isfinite(warp.qpos)) and not warp.step(4).any()
    warp.ctrl[0, 5] = np.nan
    np.testing.assert_array_equal(warp.step(1), [True, False, False])


def test_a_missing_gpu_is_told() -> None:
    import warp

    if warp.is_cuda_available():
        pytest.skip("there is a GPU")
    with pytest.raises(ConfigError, match="--device cpu"):
        WarpSimulation(1, device="cuda")

"""What the sensors of a simulated robot say, exactly and with noise."""

import dataclasses

import numpy as np
import pytest

from hugwbc import JointCommand, load_robot, rotations
from hugwbc.errors import ConfigError
from hugwbc.sim import SensorNoise, Simulation, noisy_simulation

ROBOT = load_robot()
HOLD = JointCommand.position(ROBOT, ROBOT.nominal)


@pytest.mark.parametrize("width", [-0.1, float("nan"), float("inf")])
def test_noise_that_is_no_width_is_refused(width: float) -> None:
    with pytest.raises(ConfigError, match="noise of dq is"):
        SensorNoise(dq=width)


def test_sense_without_noise_is_the_truth() -> None:
    rng, simulation = np.random.default_rng(1), Simulation()
    simulation.reset(yaw=1.0)
    simulation.push(np.array([0.3, 0.2, 0.0, 0.2, 0.4, -0.3]))
    simulation.step(dataclasses.replace(HOLD, q=ROBOT.nominal + rng.uniform(-0.2, 0.2, 19)), 0.1)
    truth, sensed = simulation.state(), simulation.sense()
    assert abs(sensed.orientation @ truth.orientation) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(sensed.angular_velocity, truth.angular_velocity, atol=1e-9)
    for name in ("q", "dq", "position", "velocity", "foot_force"):
        np.testing.assert_array_equal(getattr(sensed, name), getattr(truth, name))


def test_noise_stays_within_its_bounds_and_uses_them() -> None:
    noise = SensorNoise(angular_velocity=0.2, orientation=0.05, q=0.01, dq=1.5, position=0.02, velocity=0.1)
    simulation = Simulation(noise=noise, seed=3)
    truth = simulation.reset(yaw=0.4)
    readings = [simulation.sense() for _ in range(400)]
    for name in ("angular_velocity", "q", "dq", "position", "velocity"):
        error = np.array([getattr(r, name) for r in readings]) - getattr(truth, name)
        bound = getattr(noise, name)
        assert 0.95 * bound < np.abs(error).max() <= bound + 1e-9, name
        assert abs(error.mean()) < 0.1 * bound, name
    difference = [rotations.multiply(rotations.conjugate(truth.orientation), r.orientation) for r in readings]
    angles = 2 * np.arcsin(np.clip(np.linalg.norm(np.array(difference)[:, 1:], axis=1), 0, 1))
    assert 0.05 < angles.max() <= 0.05 * np.sqrt(3) + 1e-6
    np.testing.assert_allclose([np.linalg.norm(r.orientation) for r in readings], 1.0, atol=1e-12)


def test_noise_repeats_with_its_seed() -> None:
    first, again, other = (Simulation(noise=SensorNoise(), seed=seed).sense().q for seed in (5, 5, 6))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 1e-4


def test_robot_noise_has_the_stated_standard_deviations() -> None:
    simulation = noisy_simulation(seed=1)
    truth = simulation.reset()
    exact = simulation.data.sensor("imu_accelerometer").data.copy()
    readings = [simulation.sense() for _ in range(1000)]
    for name, expected, reference in (
        ("q", 0.005, truth.q),
        ("dq", 0.3, truth.dq),
        ("imu_gyro", 0.02, np.zeros(3)),
        ("imu_accelerometer", 0.1, exact),
    ):
        error = np.array([getattr(reading, name) for reading in readings]) - reference
        assert error.std() == pytest.approx(expected, rel=0.05), name
        assert abs(error.mean()) < 0.1 * expected, name

"""What the sensors of a simulated robot say, exactly and with noise."""

import dataclasses
import math

import numpy as np
import pytest

from hugwbc import JointCommand, load_robot, rotations
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.kinematics import Kinematics
from hugwbc.sim import Simulation
from hugwbc.sim.sensors import EXACT, ROBOT

H1 = load_robot()
HOLD = JointCommand.position(H1, H1.nominal)


def test_unknown_profiles_long_latencies_and_bad_seeds_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="robot"):
        Simulation(sensing="robbot")
    with pytest.raises(ConfigError, match="latency is 2"):
        Simulation(sensing="exact", latency=2.0)
    with pytest.raises(ConfigError, match="seed is -1; give 0 or more"):
        Simulation(sensing="exact", seed=-1)
    for seed in (None, 1.5, "7"):
        with pytest.raises(ConfigError, match=f"seed is {seed}; give 0 or more, a whole number"):
            Simulation(sensing="exact", seed=seed)
    Simulation(sensing="exact", seed=np.int64(3))


@pytest.mark.parametrize("name", ["h1", "g1"])  # the IMU is on the trunk, and on the pelvis
def test_exact_sensors_tell_the_truth(name: str) -> None:
    rng, robot, simulation = np.random.default_rng(1), load_robot(name), Simulation(robot=name, sensing="exact")
    simulation.reset(yaw=1.0)
    simulation.push(np.array([0.3, 0.2, 0.0, 0.2, 0.4, -0.3]))
    posture = robot.nominal + rng.uniform(-0.2, 0.2, len(robot.joint_names))
    simulation.step(JointCommand.position(robot, posture), 0.1)
    assert abs(simulation.state().q[robot.waist]) > 0.02
    truth, sensed = simulation.state(), simulation.sense()
    assert abs(sensed.orientation @ truth.orientation) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(sensed.angular_velocity, truth.angular_velocity, atol=1e-9)
    for name in ("q", "dq", "position", "velocity", "foot_force", "torque"):
        np.testing.assert_array_equal(getattr(sensed, name), getattr(truth, name))


def test_the_accelerometer_integrates_to_the_velocity_of_the_imu() -> None:
    """Through falls, impacts and a push, which moves the pelvis at once."""
    rng, simulation = np.random.default_rng(2), Simulation(sensing="exact")
    kinematics, gravity = Kinematics(load_robot()), np.array([0.0, 0.0, -9.81])
    kinematics.update(simulation.reset(yaw=0.5))
    integral, turn = kinematics.velocity("imu")[:3], kinematics.rotation("imu")
    for tick in range(300):
        if tick == 100:
            simulation.push(np.array([0.5, -0.3, 0.2]))
        posture = H1.nominal + 0.3 * math.sin(0.05 * tick) * rng.uniform(-1.0, 1.0, 19)
        simulation.step(dataclasses.replace(HOLD, q=posture), simulation.timestep)
        sensed = simulation.sense()
        kinematics.update(simulation.state())
        turn, before = kinematics.rotation("imu"), turn
        assert sensed.imu_accelerometer is not None
        integral += simulation.timestep * (0.5 * (turn + before) @ sensed.imu_accelerometer + gravity)
        # Reading and integral disagree about the turn within a step only.
        np.testing.assert_allclose(integral, kinematics.velocity("imu")[:3], atol=2e-3)


def test_a_robot_has_neither_foot_sensors_nor_a_position() -> None:
    simulation = Simulation(sensing="robot")
    simulation.step(HOLD, 0.05)
    sensed = simulation.sense()
    assert sensed.position is None and sensed.velocity is None and sensed.foot_force is None
    assert sensed.age == pytest.approx(ROBOT.latency)
    assert sensed.is_usable


def test_noise_biases_and_offsets_have_the_stated_deviations() -> None:
    simulation = Simulation(sensing=dataclasses.replace(ROBOT, latency=0.0, gyro_walk=0.0, accelerometer_walk=0.0))
    means: dict[str, list[np.ndarray]] = {}
    noises = {"q": ROBOT.encoder, "dq": ROBOT.joint_velocity, "torque": ROBOT.torque}
    noises |= {"imu_gyro": ROBOT.gyro, "imu_accelerometer": ROBOT.accelerometer}
    for _ in range(40):
        truth = simulation.reset()
        reference = {
            "q": truth.q,
            "dq": truth.dq,
            "torque": truth.torque,
            "imu_gyro": simulation.data.sensor("imu_gyro").data.copy(),
            "imu_accelerometer": rotations.rotate_inverse(
                simulation.data.sensor("imu_orientation").data, np.array([0.0, 0.0, 9.81])
            ),
        }
        readings = [simulation.sense() for _ in range(100)]
        for name, value in reference.items():
            errors = np.array([getattr(reading, name) for reading in readings]) - value
            means.setdefault(name, []).append(errors.mean(axis=0))
            assert errors.std(axis=0).mean() == pytest.approx(noises[name], rel=0.2), name
    for name, bias in (
        ("q", ROBOT.encoder_offset),
        ("imu_gyro", ROBOT.gyro_bias),
        ("imu_accelerometer", ROBOT.accelerometer_bias),
    ):
        assert np.std(means[name]) == pytest.approx(bias, rel=0.25), name
    for name in ("dq", "torque"):
        assert np.abs(means[name]).max() < 0.5 * noises[name], f"{name} has no bias"


def test_a_motors_torque_is_off_by_its_own_share() -> None:
    simulation, shares = Simulation(sensing=dataclasses.replace(EXACT, torque_scale=0.03)), []
    pull = dataclasses.replace(HOLD, tau=np.full(19, 10.0))
    for _ in range(40):
        simulation.reset()
        truths = [simulation.step(pull, 0.002).torque for _ in range(2)]
        shares.append(simulation.sense().torque / truths[-1])
        np.testing.assert_array_equal(simulation.sense().torque / truths[-1], shares[-1])
    assert np.mean(shares) == pytest.approx(1.0, abs=0.005) and np.std(shares) == pytest.approx(0.03, rel=0.1)


@pytest.mark.parametrize("sensor", ["gyro", "accelerometer"])
def test_a_bias_walks_with_the_square_root_of_time(sensor) -> None:
    ends = []
    for profile in (EXACT, dataclasses.replace(EXACT, **{f"{sensor}_walk": 0.1})):
        simulation = Simulation(sensing=profile)
        for _ in range(1 if profile is EXACT else 30):
            simulation.reset()
            simulation.sense()
            simulation.step(HOLD, 0.04)
            ends.append(getattr(simulation.sense(), f"imu_{sensor}"))
    assert np.std(np.array(ends[1:]) - ends[0]) == pytest.approx(0.1 * np.sqrt(0.04), rel=0.25)


def test_the_attitude_errs_about_level_axes() -> None:
    simulation = Simulation(sensing=dataclasses.replace(EXACT, attitude_bias=0.02), seed=4)
    truth = simulation.reset(yaw=1.2)
    error = rotations.multiply(simulation.sense().orientation, rotations.conjugate(truth.orientation))
    assert 0.005 < np.linalg.norm(error[1:3]) < 0.04
    assert error[3] == pytest.approx(0.0, abs=1e-9), "no error of yaw"
    simulation = Simulation(sensing=dataclasses.replace(EXACT, attitude=0.02))
    back = rotations.conjugate(simulation.state().orientation)
    errors = [2.0 * rotations.multiply(simulation.sense().orientation, back)[1:] for _ in range(300)]
    np.testing.assert_allclose(np.std(errors, axis=0), 0.02, rtol=0.2)


def test_noise_repeats_with_its_seed() -> None:
    first, again, other = (Simulation(sensing="robot", seed=seed).sense().q for seed in (5, 5, 6))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 1e-4

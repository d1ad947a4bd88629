"""Readings of the robot's sensors: encoders, torso IMU and foot contacts, with noise."""

import dataclasses
import math

import mujoco
import numpy as np

from hugwbc import rotations
from hugwbc.errors import ConfigError
from hugwbc.robot import SIDES, load_robot
from hugwbc.state import RobotState, pelvis_from_torso_imu

_UNIFORM = float(np.sqrt(3.0))  # half-width of a uniform distribution of unit standard deviation


@dataclasses.dataclass(frozen=True)
class SensorNoise:
    """Half-widths of the uniform noise on each reading (defaults: the paper's training noise).

    Attributes:
        angular_velocity: [rad/s].
        orientation: small rotation about each axis [rad].
        q: joint position [rad].
        dq: joint velocity [rad/s].
        position: pelvis position [m].
        velocity: pelvis velocity [m/s].
        acceleration: accelerometer [m/s^2].

    Raises:
        ConfigError: if one is negative or not finite.
    """

    angular_velocity: float = 0.2
    orientation: float = 0.05
    q: float = 0.01
    dq: float = 1.5
    position: float = 0.0
    velocity: float = 0.0
    acceleration: float = 0.0

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            if not 0.0 <= getattr(self, field.name) < math.inf:
                raise ConfigError(f"noise of {field.name} is {getattr(self, field.name)}; give a finite number from 0")

    @classmethod
    def robot(cls) -> "SensorNoise":
        """Return the noise of a real robot.

        Standard deviations: gyro 0.02 rad/s, orientation 0.02 rad, joint positions 0.005 rad, joint velocities 0.3
        rad/s, accelerometer 0.1 m/s^2.
        """
        return cls(
            angular_velocity=0.02 * _UNIFORM,
            orientation=0.02 * _UNIFORM,
            q=0.005 * _UNIFORM,
            dq=0.3 * _UNIFORM,
            acceleration=0.1 * _UNIFORM,
        )


@dataclasses.dataclass(frozen=True, eq=False)
class Reading:
    """State and sensor data of MuJoCo at one time, and the accelerometer during the physics step before it.

    Attributes:
        time: simulated time [s].
        qpos, qvel: positions and velocities, shapes (26,) and (25,).
        sensors: MuJoCo's sensor data.
        accelerometer: specific force at the torso's IMU [m/s^2], shape (3,).
    """

    time: float
    qpos: np.ndarray
    qvel: np.ndarray
    sensors: np.ndarray
    accelerometer: np.ndarray


class Sensors:
    """The sensors of one robot."""

    def __init__(self, model: mujoco.MjModel, noise: SensorNoise | None, seed: int) -> None:
        """Find the sensors.

        Args:
            model: model of the robot.
            noise: noise on the results of `read`; None for exact readings.
            seed: random seed of the noise.
        """
        self._noise = noise or SensorNoise(0.0, 0.0, 0.0, 0.0)
        self._rng = np.random.default_rng(seed)
        self._waist = load_robot().waist
        self._columns = {
            model.sensor(i).name: slice(int(adr), int(adr + dim))
            for i, (adr, dim) in enumerate(zip(model.sensor_adr, model.sensor_dim, strict=True))
        }

    def truth(self, reading: Reading) -> RobotState:
        """Return the true state, with position, velocity and foot forces."""
        qpos, qvel = reading.qpos, reading.qvel
        # The sensor measures the force of the link on its surroundings; the ground reaction is the opposite.
        forces = [-reading.sensors[self._columns[f"{side}_foot_force"]] for side in SIDES]
        return RobotState(
            q=qpos[7:],
            dq=qvel[6:],
            orientation=qpos[3:7] / np.linalg.norm(qpos[3:7]),
            angular_velocity=qvel[3:6],
            position=qpos[:3],
            velocity=qvel[:3],
            foot_force=np.array(forces),
            time=reading.time,
        )

    def read(self, reading: Reading) -> RobotState:
        """Return the noisy readings; those of the torso's IMU are converted to the pelvis."""
        truth, noise = self.truth(reading), self._noise
        gyro, waist = reading.sensors[self._columns["imu_gyro"]], float(truth.q[self._waist])
        orientation, rate = pelvis_from_torso_imu(
            reading.sensors[self._columns["imu_orientation"]], gyro, waist, float(truth.dq[self._waist])
        )
        turn = self._uniform(noise.angular_velocity, 3)
        tilt = self._uniform(noise.orientation, 3)
        error = np.concatenate(([1.0], tilt / 2.0))
        assert truth.position is not None and truth.velocity is not None
        return dataclasses.replace(
            truth,
            q=truth.q + self._uniform(noise.q, 19),
            dq=truth.dq + self._uniform(noise.dq, 19),
            orientation=rotations.multiply(orientation, error / np.linalg.norm(error)),
            angular_velocity=rate + turn,
            position=truth.position + self._uniform(noise.position, 3),
            velocity=truth.velocity + self._uniform(noise.velocity, 3),
            imu_gyro=gyro + rotations.rotation_z(-waist) @ turn,
            imu_accelerometer=reading.accelerometer + self._uniform(noise.acceleration, 3),
        )

    def _uniform(self, half_width: float, size: int) -> np.ndarray:
        return self._rng.uniform(-half_width, half_width, size) if half_width else np.zeros(size)

"""Sensor models: encoders, motor torques and the IMU, with noise, biases and latency."""

import dataclasses
import math
from typing import Annotated

import numpy as np
from pydantic import Field

from hugwbc import rotations
from hugwbc.errors import UnknownNameError
from hugwbc.robot import Robot
from hugwbc.settings import NotNegative, settings
from hugwbc.state import RobotState, pelvis_from_imu

LONGEST_LATENCY = 1.0  # [s]
_Latency = Annotated[float, Field(ge=0.0, le=LONGEST_LATENCY)]


@settings
class SensorProfile:
    """Which sensors a robot has, and how good they are.

    White noise is drawn for every reading, a bias and an offset once for an episode; a walk lets a bias drift. All
    these are standard deviations; 0 means a perfect reading.

    Attributes:
        name: of the profile, in tables and in the identity of results.
        position: whether pelvis position and velocity are known. No sensor of an H1 tells them.
        foot_force: whether ground reactions are measured. An H1 has no foot sensors.
        hand_force: whether forces on the hands are measured. An H1 has no sensors for them either.
        latency: age of a reading when a controller gets it [s].
        encoder: noise of a joint position [rad].
        encoder_offset: error of a joint's zero position [rad].
        joint_velocity: noise of a joint velocity [rad/s].
        torque: noise of a joint torque [N*m].
        torque_scale: error of a motor's torque constant, as a part of the torque.
        gyro: noise of the angular velocity [rad/s].
        gyro_bias: its bias at the start [rad/s].
        gyro_walk: growth of that bias [rad/s per square root of a second].
        accelerometer: noise of the specific force [m/s^2].
        accelerometer_bias: its bias at the start [m/s^2].
        accelerometer_walk: growth of that bias [m/s^2 per square root of a second].
        attitude: noise of the orientation that the IMU computes, about each axis [rad].
        attitude_bias: constant error of its roll and pitch [rad].
        object_position: noise of an object's position in the pictures of a motion-capture system [m].
        object_attitude: noise of its orientation, about each axis [rad].
        object_latency: age of a picture when a behaviour gets it [s].
    """

    name: str
    position: bool = False
    foot_force: bool = False
    hand_force: bool = False
    latency: _Latency = 0.0
    encoder: NotNegative = 0.0
    encoder_offset: NotNegative = 0.0
    joint_velocity: NotNegative = 0.0
    torque: NotNegative = 0.0
    torque_scale: NotNegative = 0.0
    gyro: NotNegative = 0.0
    gyro_bias: NotNegative = 0.0
    gyro_walk: NotNegative = 0.0
    accelerometer: NotNegative = 0.0
    accelerometer_bias: NotNegative = 0.0
    accelerometer_walk: NotNegative = 0.0
    attitude: NotNegative = 0.0
    attitude_bias: NotNegative = 0.0
    object_position: NotNegative = 0.0
    object_attitude: NotNegative = 0.0
    object_latency: _Latency = 0.0


# Perfect sensors, and some that no H1 has, for tests and where a caller asks for them.
EXACT = SensorProfile("exact", position=True, foot_force=True, hand_force=True)

# IMU: Bosch Sensortec BMI088 data sheet (document BST-BMI088-DS001): gyro 0.014 deg/s/sqrt(Hz) and up to 1 deg/s of
# offset, accelerometer 0.175 mg/sqrt(Hz) and up to 20 mg of offset. At a bandwidth of 250 Hz the noise is 0.004 rad/s
# and 0.03 m/s^2; the values here are two to four times that, since the torso vibrates. Biases: what is left of the
# offsets after a calibration at rest (assumed): vectors of 0.01 rad/s and 0.1 m/s^2, r.m.s. Joints: the maker publishes
# no figures, so all of theirs are assumed. Objects: as a motion-capture system of modest quality sees them (assumed).
ROBOT = SensorProfile(
    "robot",
    latency=0.01,
    encoder=0.002,
    encoder_offset=0.003,
    joint_velocity=0.1,
    torque=1.0,
    torque_scale=0.03,
    gyro=0.01,
    gyro_bias=0.01 / math.sqrt(3.0),
    gyro_walk=1e-4,
    accelerometer=0.1,
    accelerometer_bias=0.1 / math.sqrt(3.0),
    accelerometer_walk=1e-3,
    attitude=0.005,
    attitude_bias=0.009,
    object_position=0.005,
    object_attitude=0.0087,  # half a degree
    object_latency=0.03,
)

PROFILES = {profile.name: profile for profile in (ROBOT, EXACT)}


def sensor_profile(name: str) -> SensorProfile:
    """Return the profile of a name."""
    if name not in PROFILES:
        raise UnknownNameError("sensing", name, PROFILES)
    return PROFILES[name]


@dataclasses.dataclass(frozen=True, eq=False)
class Reading:
    """What perfect sensors say at one time, from whichever engine."""

    time: float  # [s]
    qpos: np.ndarray  # see `Engine.qpos`, shape (7 + n,)
    qvel: np.ndarray  # see `Engine.qvel`, shape (6 + n,)
    imu_orientation: np.ndarray  # IMU to world, unit quaternion (w, x, y, z), shape (4,)
    imu_gyro: np.ndarray  # angular velocity of the IMU in its own frame [rad/s], shape (3,)
    foot_force: np.ndarray  # ground reaction on the left and the right foot in the world [N], shape (2, 3)
    accelerometer: np.ndarray  # specific force at the IMU over the last step, in its own frame [m/s^2], shape (3,)
    torque: np.ndarray  # joint torques over the last physics step [N*m], shape (n,)
    # Force on the links of both hands, by contacts and grippers, in the world [N], shape (2, 3); None without a sensor.
    hand_force: np.ndarray | None = None


class Sensors:
    """The sensors of one robot."""

    def __init__(self, profile: SensorProfile, seed: int, robot: Robot) -> None:
        """Draw the errors of the first episode."""
        self.profile = profile
        self._rng = np.random.default_rng(seed)
        self._robot, self._joints = robot, len(robot.joint_names)
        # Deviations of what is drawn for a reading: of joint positions, velocities, torques, then of the IMU's vectors.
        p, joints = profile, np.ones(self._joints)
        vectors = np.repeat((p.gyro, p.attitude, p.accelerometer, p.gyro_walk, p.accelerometer_walk), 3)
        self._deviations = np.concatenate((p.encoder * joints, p.joint_velocity * joints, p.torque * joints, vectors))
        self._noisy = bool(self._deviations.any())
        # Drawn anew for each reading, all at once: parts of it are views.
        self._errors = np.zeros(self._deviations.size)
        of_joints, of_imu = np.split(self._errors, [3 * self._joints])
        self._of_encoders, self._of_velocities, self._of_torques = of_joints.reshape(3, -1)
        self._of_gyro, self._of_attitude, self._of_accelerometer, self._gyro_walk, self._accelerometer_walk = (
            of_imu.reshape(5, 3)
        )
        self.reset()

    def reset(self) -> None:
        """Draw the biases and offsets of a new episode."""
        p = self.profile
        self._encoder_offset = self._normal(p.encoder_offset, self._joints)
        self._torque_scale = 1.0 + self._normal(p.torque_scale, self._joints)
        self._gyro_bias = self._normal(p.gyro_bias, 3)
        self._accelerometer_bias = self._normal(p.accelerometer_bias, 3)
        self._attitude_bias = np.append(self._normal(p.attitude_bias, 2), 0.0)
        self._time: float | None = None

    def truth(self, reading: Reading) -> RobotState:
        """Return the true state, with position, velocity, foot forces and joint torques."""
        qpos, qvel = reading.qpos, reading.qvel
        return RobotState(
            q=qpos[7:],
            dq=qvel[6:],
            orientation=_unit(qpos[3:7]),
            angular_velocity=qvel[3:6],
            position=qpos[:3],
            velocity=qvel[:3],
            foot_force=reading.foot_force,
            hand_force=reading.hand_force,
            torque=reading.torque,
            time=reading.time,
        )

    def read(self, reading: Reading, now: float | None = None) -> RobotState:
        """Return what the sensors say; what the robot has no sensor for is None.

        Orientation and angular velocity are those of the IMU, carried over to the pelvis. The reading is used at a time
        `now` [s]; None for its own.
        """
        p, qpos, qvel = self.profile, reading.qpos, reading.qvel
        if self._noisy:
            self._rng.standard_normal(out=self._errors)
            self._errors *= self._deviations
        step = 0.0 if self._time is None else math.sqrt(max(reading.time - self._time, 0.0))
        self._time = reading.time
        self._gyro_bias += step * self._gyro_walk
        self._accelerometer_bias += step * self._accelerometer_walk
        q = qpos[7:] + self._encoder_offset + self._of_encoders
        dq = qvel[6:] + self._of_velocities
        gyro = reading.imu_gyro + self._gyro_bias + self._of_gyro
        turn = np.array([1.0, *(0.5 * (self._attitude_bias + self._of_attitude)).tolist()])
        # A constant error of roll and pitch is one about the world's axes.
        attitude = rotations.multiply(_unit(turn), reading.imu_orientation)
        orientation, rate = pelvis_from_imu(attitude, gyro, *self._robot.imu_turn(q, dq))
        return RobotState(
            q=q,
            dq=dq,
            orientation=orientation,
            angular_velocity=rate,
            position=qpos[:3] if p.position else None,
            velocity=qvel[:3] if p.position else None,
            foot_force=reading.foot_force if p.foot_force else None,
            hand_force=reading.hand_force if p.hand_force else None,
            imu_gyro=gyro,
            imu_accelerometer=reading.accelerometer + self._accelerometer_bias + self._of_accelerometer,
            torque=self._torque_scale * reading.torque + self._of_torques,
            time=reading.time,
            age=0.0 if now is None else now - reading.time,
        )

    def _normal(self, deviation: float, size: int) -> np.ndarray:
        return self._rng.normal(0.0, deviation, size) if deviation else np.zeros(size)


def _unit(vector: np.ndarray) -> np.ndarray:
    """Return a vector with the length 1."""
    return vector / math.sqrt(vector.dot(vector))

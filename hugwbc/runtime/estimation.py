"""Pose and velocity of the pelvis from IMU, encoders and foot contacts: a contact-aided invariant Kalman filter.

The filter multiplies by `dot`: on matrices this small it takes half the time of `@`.
"""

import collections
import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from eigenpy import LLT

from hugwbc import rotations
from hugwbc.kinematics import Kinematics
from hugwbc.numeric import changed
from hugwbc.robot import SIDES, Robot
from hugwbc.runtime.contact import BASE_WEIGHT, ContactObserver
from hugwbc.runtime.reading_guard import GYRO_JUMP, LARGEST_READING, ReadingGuard
from hugwbc.sim.engine import Engine
from hugwbc.state import GRAVITY, RobotState

_FEET = len(SIDES)
_MOTION = 9 + 3 * _FEET  # orientation, velocity, position, feet
_SIZE = _MOTION + 6  # and the biases
_ORIENTATION, _VELOCITY, _POSITION = slice(0, 3), slice(3, 6), slice(6, 9)
_GYRO_BIAS, _ACCELEROMETER_BIAS = slice(_MOTION, _MOTION + 3), slice(_MOTION + 3, _SIZE)
_LONGEST_STEP = 0.1  # [s]; a longer gap between two readings is integrated for this time only
_SAME_TIME = 1e-6  # [s]
_PLANS = 256  # that are kept: half a second of the shortest control periods
_READING = 0.002  # [s] between two readings, whose errors the standard deviations describe
_STEADY = 1e-9  # relative change of a covariance below which it has converged
_DOWN = np.array([0.0, 0.0, -GRAVITY])

# Standard deviations that the filters assume.
_GYRO_NOISE = 0.01  # [rad/s], of a gyro reading
_ACCELEROMETER_NOISE = 0.1  # [m/s^2], of an accelerometer reading
ENCODER_NOISE = 0.002  # [rad], of a measured joint position
JOINT_VELOCITY_NOISE = 0.1  # [rad/s], of a measured joint velocity
_FOOT_SLIP = 0.03  # [m/s], velocity of a foot that stands under load: it slips, and rolls about its centre line
# [m/s], further velocity of a foot that touches down: it comes down on an edge and turns until the sole is flat.
_LANDING_SLIP = 5.0
_LANDING_TIME = 0.015  # [s], time constant with which that velocity fades
_ROLLING = 0.2  # [m], further velocity of a sole that turns, per angular velocity: its centre is not where it touches
_LIFTING_SLIP = 1.0  # [m/s], further velocity of a foot that carries nothing; it falls to zero at `_FULL_LOAD`
_FULL_LOAD = 0.4  # share of the robot's weight under which a sole lies still
# [m], of a foot's position relative to the IMU, in addition to the encoders': links bend and soles give way.
_FOOT_MODEL = 0.002
_INITIAL_TILT = 0.02  # [rad], of the IMU's own orientation, which the filter starts from
_INITIAL_VELOCITY = 0.1  # [m/s], of the assumption that the robot starts at rest
_INITIAL_GYRO_BIAS = 0.006  # [rad/s], of the gyro's bias at the start
_INITIAL_ACCELEROMETER_BIAS = 0.06  # [m/s^2], of the accelerometer's bias at the start
_GYRO_BIAS_WALK = 3e-4  # [rad/s per square root of a second], growth of the gyro's bias
_ACCELEROMETER_BIAS_WALK = 3e-3  # [m/s^2 per square root of a second], growth of the accelerometer's bias
LEG_ACCELERATION = 100.0  # [rad/s^2], typical acceleration of a leg joint
WAIST_ACCELERATION = 20.0  # [rad/s^2], typical acceleration of the waist joint
_ARM_ACCELERATION = 50.0  # [rad/s^2], typical acceleration of an arm joint
UNPLANNED = 0.6  # share of these accelerations by which a joint departs from a controller's plan


class JointFilter:
    """A Kalman filter of the position and velocity of every joint, driven by an unknown or planned acceleration.

    Attributes:
        q, dq: estimates [rad], [rad/s], shape (n,).
    """

    def __init__(self, robot: Robot) -> None:
        self._noise = ENCODER_NOISE**2, JOINT_VELOCITY_NOISE**2
        self._acceleration = np.full(len(robot.joint_names), LEG_ACCELERATION**2)
        self._acceleration[robot.waist] = WAIST_ACCELERATION**2
        self._acceleration[robot.arms] = _ARM_ACCELERATION**2
        self._unplanned = UNPLANNED**2
        self.reset(robot.nominal, np.zeros_like(robot.nominal))

    def reset(self, q: np.ndarray, dq: np.ndarray) -> None:
        """Start from one reading."""
        self.q, self.dq = np.array(q, dtype=float), np.array(dq, dtype=float)
        self._steady: tuple[float, bool] | None = None  # time step, and whether without a plan, of the steady gains
        # Covariances of (q, q), (q, dq), (dq, dq).
        self._qq, self._qv, self._vv = (np.full_like(self.q, value) for value in (self._noise[0], 0.0, self._noise[1]))

    def update(self, q: np.ndarray, dq: np.ndarray, dt: float, planned: np.ndarray | None = None) -> None:
        """Predict over `dt` [s], by accelerations [rad/s^2] if they were planned for it, then correct by a reading."""
        kind = round(dt, 6), planned is None
        if kind != self._steady:
            self._set_gains(dt, kind)
        predicted_q, predicted_dq = self.q + dt * self.dq, self.dq
        if planned is not None:
            predicted_q, predicted_dq = predicted_q + 0.5 * dt**2 * planned, predicted_dq + dt * planned
        error_q, error_v = q - predicted_q, dq - predicted_dq
        gain_qq, gain_qv, gain_vq, gain_vv = self._gains
        self.q = predicted_q + gain_qq * error_q + gain_qv * error_v
        self.dq = predicted_dq + gain_vq * error_q + gain_vv * error_v

    def _set_gains(self, dt: float, kind: tuple[float, bool]) -> None:
        """Advance the covariances, which do not depend on the readings: after a while they and the gains are steady."""
        noise_q, noise_v = self._noise
        drive = self._acceleration * (dt**2 if kind[1] else self._unplanned * dt**2)
        sq = self._qq + dt * (2.0 * self._qv + dt * (self._vv + 0.25 * drive)) + noise_q
        qv = self._qv + dt * (self._vv + 0.5 * drive)
        sv = self._vv + drive + noise_v
        # Both components are measured: gain = P S^-1 = 1 - N S^-1 with the 2 x 2 covariances of each joint, S of the
        # innovation and N of the reading.
        inverse = 1.0 / (sq * sv - qv * qv)
        cross = qv * inverse
        gain_qq, gain_vv = 1.0 - noise_q * sv * inverse, 1.0 - noise_v * sq * inverse
        before = self._vv
        self._qq, self._qv, self._vv = noise_q * gain_qq, noise_q * noise_v * cross, noise_v * gain_vv
        self._gains = gain_qq, noise_q * cross, noise_v * cross, gain_vv
        self._steady = kind if np.abs(self._vv - before).max() < _STEADY * noise_v else None


def joined(readings: Sequence[RobotState], last: RobotState) -> RobotState:
    """Return the last reading, with gyro, accelerometer and torques averaged over some readings, if all have them."""
    count, parts = len(readings), []
    for reading in readings:
        gyro, accelerometer, torque = reading.imu_gyro, reading.imu_accelerometer, reading.torque
        if (count == 1 and reading is last) or gyro is None or accelerometer is None or torque is None:
            return last
        parts.append((gyro, accelerometer, torque))
    gyro, accelerometer, torque = [sum(values[1:], values[0]) / count for values in zip(*parts, strict=True)]
    return changed(last, imu_gyro=gyro, imu_accelerometer=accelerometer, torque=torque)


class StateEstimator:
    r"""Right-invariant extended Kalman filter of the IMU's pose and velocity, both feet and the IMU's biases.

    On the group :math:`SE_4(3)`, with the error :math:`\hat X X^{-1} = \exp(\xi)`, the linearised dynamics depend on
    the estimate through the biases alone, and leg kinematics is a linear observation (Hartley, Ghaffari, Eustice,
    Grizzle, *Contact-aided invariant extended Kalman filtering for robot state estimation*, IJRR 2020, arXiv
    1904.09251):

    .. math::
        \dot R = R\,[\omega - b_g]_\times, \quad \dot v = R (a - b_a) + g, \quad \dot p = v, \quad \dot d_k = w_k,
        \quad \dot b = w_b, \qquad R\, h_k(q) + p - d_k = 0 \text{ of every standing foot } k

    with gyro :math:`\omega`, accelerometer a, their biases b, and :math:`h_k` the centre of sole k seen from the IMU.
    Which feet stand is inferred from the joint torques (`ContactObserver`). A foot in the air is not observed; where it
    comes down it enters the filter again. Absolute position and yaw are not observable: they start at the origin, or
    where `reset` is told, and drift with the steps. Height is relative to the ground under the first stand.

    The estimate also has smoothed joint positions and velocities (`JointFilter`), from the readings and from what the
    controller plans.

    Attributes:
        robot: the robot that it knows.
        contact: which feet stand, shape (2,), bool.
        gyro_bias, accelerometer_bias: in the IMU's frame [rad/s], [m/s^2], shape (3,).
        guard: refuses readings that cannot be true, and fills the gaps.
    """

    def __init__(self, robot: Robot, base_weight: float = BASE_WEIGHT) -> None:
        """Set up for a robot; call `reset` before `update`. The weight is `ContactObserver`'s."""
        self.robot = robot
        self._kinematics = kinematics = Kinematics(self.robot)  # of the estimate
        self._waist_column = int(kinematics.columns[self.robot.waist]) - 6
        self._pelvis_frame = kinematics.frame_id(robot.base)
        self._imu, *self._sole_frames = (kinematics.frame_id(n) for n in ("imu", *(f"{s}_sole" for s in SIDES)))
        self._imu_in_link = kinematics.model.frames[self._imu].placement.translation.copy()
        # Where the joint is in the pelvis that turns the IMU's link, if one does [m].
        carrier = kinematics.model.frames[self._imu].parentJoint
        self._turned_at = kinematics.model.jointPlacements[carrier].translation.copy()
        # Filled in place by every prediction; the entries that never change stay.
        self._transition, self._lever_arms = np.eye(_SIZE), np.vstack([np.eye(3)] * (2 + _FEET + 1))
        self._model_noise = _FOOT_MODEL**2 * np.eye(3)
        # Variances per second of what drives velocity, feet and biases at random; orientation and position only follow.
        # Those of the biases never change; `_predict` sets those of velocity and feet.
        self._drive = np.zeros(_SIZE)
        self._drive[_GYRO_BIAS], self._drive[_ACCELEROMETER_BIAS] = _GYRO_BIAS_WALK**2, _ACCELEROMETER_BIAS_WALK**2
        self._observer = ContactObserver(kinematics, base_weight)
        self._joints = JointFilter(self.robot)
        self.guard = ReadingGuard(self.robot)
        self._weight = self.robot.weight
        self.contact = np.ones(_FEET, dtype=bool)
        self.gyro_bias, self.accelerometer_bias = np.zeros(3), np.zeros(3)

    @property
    def foot_force(self) -> np.ndarray:
        """Inferred ground reaction on each foot, world frame [N], shape (2, 3)."""
        return self._observer.force

    def reset(self, state: RobotState, period: float = _READING) -> RobotState:
        """Start from a robot that stands at rest, and return the first estimate.

        If its reading is not usable, `update` starts from the first one that is.

        Args:
            state: a reading. Its orientation is where the filter starts, and its position, if it has one; else the
                robot stands above the origin.
            period: usual time between two updates [s].
        """
        self._period = period
        self.guard.reset(state, period)
        self._joints.reset(state.q, np.zeros_like(state.dq))
        self._kinematics.update(dataclasses.replace(state, position=np.zeros(3), velocity=np.zeros(3)))
        soles = np.array([self._placement(frame) for frame in self._sole_frames])
        torso = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), self.robot.imu_turn(state.q, state.dq)[0])
        self._R = rotations.to_matrix(rotations.multiply(state.orientation, torso))
        # Velocity, position and feet are rows of one array, since all corrections turn them alike.
        self._rows = np.zeros((2 + _FEET, 3))
        self._v, self._p, self._d = self._rows[0], self._rows[1], self._rows[2:]
        pelvis = state.position
        if pelvis is None:
            pelvis = np.array([0.0, 0.0, -soles[:, 2].min()])
        self._p[:] = pelvis + self._placement(self._imu)
        self._d[:] = pelvis + soles
        self.gyro_bias, self.accelerometer_bias = np.zeros(3), np.zeros(3)
        spreads = [_INITIAL_TILT, _INITIAL_VELOCITY, *[1e-3] * (1 + _FEET)]
        spreads += [_INITIAL_GYRO_BIAS, _INITIAL_ACCELEROMETER_BIAS]
        self._P = np.diag(np.repeat(spreads, 3) ** 2)
        self.contact = np.ones(_FEET, dtype=bool)
        self._time, self._gyro = state.time, np.zeros(3) if state.imu_gyro is None else state.imu_gyro
        self._begun = state.is_usable
        self._touch_down, self._turning = [-math.inf] * _FEET, [0.0] * _FEET
        self._plans: collections.deque[tuple[float, np.ndarray | None]] = collections.deque(maxlen=_PLANS)
        self._see_waist()
        self._observer.reset(self._estimate(state))
        return self._estimate(state)

    def update(
        self, state: RobotState, planned: np.ndarray | None = None, newest_gyro: np.ndarray | None = None
    ) -> RobotState:
        """Return the estimate at a new reading.

        Everything but the time, the age, the torques and the IMU's raw readings is replaced. What the `guard` refuses
        is filled in first; the estimate says so (`RobotState.coasted`). A reading that lacks the IMU or the joint
        torques, is not finite, or is the first and beyond `LARGEST_READING`, is passed on as it is.

        Args:
            state: a reading, perhaps of some time ago (`state.age`).
            planned: joint accelerations that the controller plans at present [rad/s^2], shape (n,). They are kept
                until the readings of the present arrive, and ignored if not finite, beyond `LARGEST_READING` or of
                another shape.
            newest_gyro: the last reading of the gyro where that of `state` is a mean over some time [rad/s],
                shape (3,). The mean turns the estimate; the pelvis moves as the last reading says.
        """
        if not self._begun:
            return self.reset(state, self._period) if state.is_usable else state
        state = self.guard.admit(state)
        gyro, accelerometer, torque = state.imu_gyro, state.imu_accelerometer, state.torque
        if gyro is None or accelerometer is None or torque is None or not self.guard.started:
            return state
        # Only what the filter reads: it computes the pelvis's motion itself, in which a NaN of waist or IMU would last.
        if not math.isfinite(sum(float(part.dot(part)) for part in (gyro, accelerometer, torque, state.q, state.dq))):
            return state
        dt = min(max(state.time - self._time, 0.0), _LONGEST_STEP)
        if state.time < self._time:  # a clock that began anew
            self._touch_down = [time - self._time + state.time for time in self._touch_down]
            self._plans.clear()
        self._time = state.time
        planned = self._planned_at(state, planned)
        self._joints.update(state.q, state.dq, dt, planned)
        self._see_waist()
        self._predict(gyro - self.gyro_bias, accelerometer - self.accelerometer_bias, dt)
        self._gyro = gyro
        if newest_gyro is not None and not state.coasted:
            change = newest_gyro - gyro
            if change.dot(change) < GYRO_JUMP**2:
                self._gyro = newest_gyro
        self._kinematics.place_joints(self._joints.q, self._joints.dq)
        self._kinematics.place_pelvis(*self._pelvis())
        contact = self._observer.infer(torque, dt, planned)
        self._measure_legs()
        stands, stood = contact.tolist(), self.contact.tolist()
        for foot in range(_FEET):
            if stands[foot] and not stood[foot]:
                self._enter(foot)
        for foot in range(_FEET):
            if stands[foot] and stood[foot]:
                self._correct(foot)
        self.contact = contact.copy()
        return self._estimate(state)

    def covariance(self) -> np.ndarray:
        """Return the covariance of the filter's errors: pelvis orientation, then velocity, world axes, shape (6, 6).

        The errors are the rotation vector from the true to the estimated orientation [rad] and the estimated velocity
        less the true one [m/s].
        """
        rate = self._rate
        velocity = self._v + self._R.dot(self._lever.dot(rate) - self._arm_velocity)
        to_pelvis = np.zeros((6, _SIZE))
        to_pelvis[:3, _ORIENTATION] = np.eye(3)
        to_pelvis[3:, _ORIENTATION] = -pin.skew(velocity)
        to_pelvis[3:, _VELOCITY] = np.eye(3)
        arm = self._R.dot(self._lever)
        to_pelvis[3:, _GYRO_BIAS] = -arm
        covariance = to_pelvis.dot(self._P).dot(to_pelvis.T)
        covariance[3:, 3:] += _GYRO_NOISE**2 * arm.dot(arm.T)
        return covariance

    def _planned_at(self, state: RobotState, planned: np.ndarray | None) -> np.ndarray | None:
        """Return the plan for the time up to that of the reading; keep the plan for the present."""
        if planned is not None and (
            planned.shape != state.q.shape or np.count_nonzero(np.abs(planned) <= LARGEST_READING) < planned.size
        ):
            planned = None
        self._plans.append((state.time + state.age, planned))
        while len(self._plans) > 1 and self._plans[0][0] < state.time - _SAME_TIME:
            self._plans.popleft()
        return self._plans[0][1]

    def _placement(self, frame: int) -> np.ndarray:
        return self._kinematics.data.oMf[frame].translation.copy()

    def _measure_legs(self) -> None:
        """Read the sole centres seen from the IMU [m], (2, 3), their covariances in the world and turning speeds."""
        places = self._kinematics.data.oMf
        pelvis = places[self._pelvis_frame]
        turned_at, waist = pelvis.act(self._turned_at), pelvis.rotation[:, 2]
        soles = np.array([places[frame].translation for frame in self._sole_frames])
        jacobians = self._observer.sole_jacobians[:, :3, 6:].copy()
        # The waist turns an IMU on the trunk: seen from there, the foot turns the other way about the pelvis's z axis.
        for foot in range(_FEET if self.robot.imu_link == self.robot.trunk else 0):
            jacobians[foot, :, self._waist_column] = rotations.cross(soles[foot] - turned_at, waist)
        self._soles = (soles - places[self._imu].translation).dot(self._R)
        noise = ENCODER_NOISE**2
        self._soles_noise = noise * jacobians @ jacobians.transpose(0, 2, 1) + self._model_noise
        turning = self._observer.sole_velocity[:, 3:]
        self._turning = np.sqrt(np.add.reduce(turning * turning, 1)).tolist()

    def _predict(self, gyro: np.ndarray, accelerometer: np.ndarray, dt: float) -> None:
        """Integrate readings without their biases over `dt` [s]."""
        self._rate = gyro
        acceleration = self._R.dot(accelerometer) + _DOWN
        # The gyro's errors turn the whole estimate about the world's origin, hence the lever arms.
        lever, transition, turned = self._lever_arms, self._transition, -dt * self._R
        lever[3:] = self._rows.dot(_SKEW).reshape(-1, 3)
        transition[_VELOCITY, _ORIENTATION] = dt * _GRAVITY_CROSS
        transition[_POSITION, _ORIENTATION] = 0.5 * dt**2 * _GRAVITY_CROSS
        transition[_POSITION, _VELOCITY] = dt * _EYE
        transition[:_MOTION, _GYRO_BIAS] = lever.dot(turned)
        transition[_VELOCITY, _ACCELEROMETER_BIAS] = turned
        transition[_POSITION, _ACCELEROMETER_BIAS] = 0.5 * dt * turned
        self._p += dt * (self._v + 0.5 * dt * acceleration)
        self._v += dt * acceleration
        self._R = self._R.dot(pin.exp3(gyro * dt))
        self._P = transition.dot(self._P).dot(transition.T)
        # Errors are independent from reading to reading, of which an update averages several.
        self._P[:_MOTION, :_MOTION] += _GYRO_NOISE**2 * _READING * dt * lever.dot(lever.T)
        drive = self._drive * dt
        drive[_VELOCITY] = _ACCELEROMETER_NOISE**2 * _READING * dt
        for foot in range(_FEET):
            drive[9 + 3 * foot : 12 + 3 * foot] = self._foot_velocity(foot) ** 2 * _READING * dt
        self._P.ravel()[:: _SIZE + 1] += drive  # its diagonal

    def _foot_velocity(self, foot: int) -> float:
        """Return the standard deviation of a foot's velocity at present [m/s]."""
        load = min(max(float(self._observer.force[foot, 2]) / (_FULL_LOAD * self._weight), 0.0), 1.0)
        landing = _LANDING_SLIP * math.exp((self._touch_down[foot] - self._time) / _LANDING_TIME)
        return _FOOT_SLIP + landing + _LIFTING_SLIP * (1.0 - load) + _ROLLING * self._turning[foot]

    def _enter(self, foot: int) -> None:
        """Let a foot that comes down stand where the legs say."""
        self._touch_down[foot] = self._time
        self._d[foot] = self._p + self._R.dot(self._soles[foot])
        rows = slice(9 + 3 * foot, 12 + 3 * foot)
        self._P[rows] = self._P[_POSITION]
        self._P[:, rows] = self._P[:, _POSITION]
        self._P[rows, rows] += self._soles_noise[foot]

    def _correct(self, foot: int) -> None:
        """Correct by the innovation R h + p - d, which is linear in the error: the position's part less the foot's."""
        rows = slice(9 + 3 * foot, 12 + 3 * foot)
        innovation = self._R.dot(self._soles[foot]) + self._p - self._d[foot]
        spread = self._P[:, _POSITION] - self._P[:, rows]
        covariance = spread[_POSITION] - spread[rows] + self._soles_noise[foot]
        gain = LLT(covariance).solve(spread.T).T
        error = gain.dot(-innovation)
        turn = pin.exp3(error[_ORIENTATION])
        self._R = turn.dot(self._R)
        self._rows[:] = self._rows.dot(turn.T) + error[3:_MOTION].reshape(-1, 3)
        self.gyro_bias = self.gyro_bias + error[_GYRO_BIAS]
        self.accelerometer_bias = self.accelerometer_bias + error[_ACCELEROMETER_BIAS]
        corrected = self._P - gain.dot(spread.T)
        self._P = 0.5 * (corrected + corrected.T)

    def _see_waist(self) -> None:
        """Note how the joints turn the IMU against the pelvis, and where it is seen from there, in its own axes."""
        angle, self._waist_rate = self.robot.imu_turn(self._joints.q, self._joints.dq)
        self._to_pelvis = rotations.rotation_z(angle)
        joint = self._turned_at.dot(self._to_pelvis)
        self._arm = joint + self._imu_in_link
        self._lever = pin.skew(self._arm)
        self._arm_velocity = self._waist_rate * np.array([joint[1], -joint[0], 0.0])

    def _pelvis(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return orientation, angular velocity, position and velocity of the pelvis below the IMU (`RobotState`)."""
        x, y, z, w = pin.Quaternion(self._R.dot(self._to_pelvis.T)).coeffs().tolist()
        self._rate = gyro = self._gyro - self.gyro_bias
        angular = self._to_pelvis.dot(gyro)
        angular[2] -= self._waist_rate
        position = self._p - self._R.dot(self._arm)
        velocity = self._v + self._R.dot(self._lever.dot(gyro) - self._arm_velocity)
        return np.array([w, x, y, z]), angular, position, velocity

    def _estimate(self, state: RobotState) -> RobotState:
        """Return the estimate at the time of a reading."""
        orientation, angular_velocity, position, velocity = self._pelvis()
        return changed(
            state,
            q=self._joints.q,  # the filter makes new arrays at every update, as the observer does
            dq=self._joints.dq,
            orientation=orientation,
            angular_velocity=angular_velocity,
            position=position,
            velocity=velocity,
            foot_force=self._observer.force,
            hand_force=self._observer.hands.force,
            untold_inertia=self._observer.inertia.untold,
        )


_EYE = np.eye(3)
_SKEW = np.concatenate([pin.skew(axis) for axis in _EYE]).reshape(3, 9)  # x @ _SKEW: the rows of skew(x), in turn
_GRAVITY_CROSS = pin.skew(_DOWN)


def estimator_for(simulation: Engine) -> StateEstimator | None:
    """Return an estimator that knows the simulated robot and its drives; None where the sensors tell the state."""
    return None if simulation.sensing.position else StateEstimator(robot=simulation.known_robot)

"""Pose and velocity of the pelvis from IMU, encoders and foot contacts: a contact-aided invariant Kalman filter."""

import collections
import dataclasses

import numpy as np
import pinocchio as pin

from hugwbc import rotations
from hugwbc.kinematics import joint_columns, pinocchio_model
from hugwbc.robot import SIDES, Robot, load_robot
from hugwbc.state import GRAVITY, RobotState

_FEET = len(SIDES)
_SIZE = 9 + 3 * _FEET  # orientation, velocity, position, feet
_ORIENTATION, _VELOCITY, _POSITION = slice(0, 3), slice(3, 6), slice(6, 9)
# [rad], [rad/s], [rad/s^2], [m/s^2]; larger readings come from broken sensors.
LARGEST_READING = 1e4
_LONGEST_STEP = 0.1  # [s]; a longer gap between two readings is integrated for this time only
_SAME_TIME = 1e-6  # [s]
_PLANS = 256  # plans that are kept: half a second of control periods
_DOWN = np.array([0.0, 0.0, -GRAVITY])


@dataclasses.dataclass(frozen=True)
class EstimatorParams:
    """Standard deviations that the filters assume, and the contact threshold."""

    gyro: float = 0.02
    """Standard deviation of a gyro reading [rad/s]."""
    accelerometer: float = 0.1
    """Standard deviation of an accelerometer reading [m/s^2]."""
    encoder: float = 0.005
    """Standard deviation of a measured joint position [rad]."""
    joint_velocity: float = 0.3
    """Standard deviation of a measured joint velocity [rad/s]."""
    foot_slip: float = 0.25
    """Velocity of a standing foot [m/s]. After touch-down it sinks in by 6 mm within 12 ms and rises again by 5 mm
    until it lifts off; it also slips and rolls about its centre line. With a smaller value, the filter takes this
    motion for velocity of the pelvis."""
    foot_model: float = 0.002
    """Error of a foot's position relative to the IMU, in addition to that of the encoders [m]: links bend and soles
    give way."""
    contact_force: float = 30.0
    """Normal force above which a foot counts as standing [N]."""
    initial_tilt: float = 0.03
    """Error of the IMU's orientation, from which the filter starts [rad]."""
    initial_velocity: float = 0.1
    """Error of the assumption that the robot starts at rest [m/s]."""
    leg_acceleration: float = 100.0
    """Typical acceleration of a leg joint [rad/s^2]."""
    waist_acceleration: float = 20.0
    """Typical acceleration of the waist joint [rad/s^2]."""
    arm_acceleration: float = 50.0
    """Typical acceleration of an arm joint [rad/s^2]."""
    unplanned: float = 0.15
    """Share of these accelerations by which a joint departs from a controller's plan."""


class JointFilter:
    """A Kalman filter of the position and velocity of every joint, driven by an unknown or planned acceleration.

    Attributes:
        q, dq: estimates [rad], [rad/s], shape (19,).
    """

    def __init__(self, params: EstimatorParams, robot: Robot) -> None:
        self._noise = params.encoder**2, params.joint_velocity**2
        self._acceleration = np.full(len(robot.joint_names), params.leg_acceleration**2)
        self._acceleration[robot.waist] = params.waist_acceleration**2
        self._acceleration[robot.arms] = params.arm_acceleration**2
        self._unplanned = params.unplanned**2
        self.reset(robot.nominal, np.zeros_like(robot.nominal))

    def reset(self, q: np.ndarray, dq: np.ndarray) -> None:
        """Start from one reading."""
        self.q, self.dq = np.array(q, dtype=float), np.array(dq, dtype=float)
        # Covariances of (q, q), (q, dq), (dq, dq).
        self._qq, self._qv, self._vv = (np.full_like(self.q, value) for value in (self._noise[0], 0.0, self._noise[1]))

    def update(self, q: np.ndarray, dq: np.ndarray, dt: float, planned: np.ndarray | None = None) -> None:
        """Predict over `dt` [s], then correct by a reading of positions and velocities.

        Args:
            q: reading [rad], shape (19,).
            dq: reading [rad/s], shape (19,).
            dt: since the last reading [s].
            planned: accelerations that a controller planned for this time [rad/s^2], shape (19,).
        """
        drive = self._acceleration * dt**2
        predicted_q, predicted_dq = self.q + dt * self.dq, self.dq
        if planned is not None:
            predicted_q, predicted_dq = predicted_q + 0.5 * dt**2 * planned, predicted_dq + dt * planned
            drive = self._unplanned * drive
        qq = self._qq + dt * (2.0 * self._qv + dt * (self._vv + 0.25 * drive))
        qv = self._qv + dt * (self._vv + 0.5 * drive)
        vv = self._vv + drive
        error_q, error_v = q - predicted_q, dq - predicted_dq
        # Both components are measured: gain = P S^-1 with the 2 x 2 innovation covariance S of each joint.
        sq, sv = qq + self._noise[0], vv + self._noise[1]
        inverse = 1.0 / (sq * sv - qv**2)
        gain_qq, gain_qv = (qq * sv - qv**2) * inverse, qv * self._noise[0] * inverse
        gain_vq, gain_vv = qv * self._noise[1] * inverse, (vv * sq - qv**2) * inverse
        self.q = predicted_q + gain_qq * error_q + gain_qv * error_v
        self.dq = predicted_dq + gain_vq * error_q + gain_vv * error_v
        self._qq, self._qv, self._vv = gain_qq * self._noise[0], gain_qv * self._noise[1], gain_vv * self._noise[1]


class StateEstimator:
    r"""A right-invariant extended Kalman filter of the IMU's orientation, velocity and position and of both feet.

    On the group :math:`SE_4(3)`, with the error :math:`\hat X X^{-1} = \exp(\xi)`, the linearised dynamics do not
    depend on the estimate, and leg kinematics is a linear observation (Hartley, Ghaffari, Eustice, Grizzle,
    *Contact-aided invariant extended Kalman filtering for robot state estimation*, IJRR 2020, arXiv 1904.09251):

    .. math::
        \dot R = R\,[\omega]_\times, \quad \dot v = R a + g, \quad \dot p = v, \quad \dot d_k = 0 + w_k, \qquad
        R\, h_k(q) + p - d_k = 0 \text{ of every standing foot } k

    with gyro :math:`\omega`, accelerometer a, and :math:`h_k` the centre of sole k seen from the IMU. A foot in the air
    is not observed; at touch-down its position is initialised again. Absolute position and yaw are not observable: they
    start at the given ones and drift with the steps. Height is relative to the ground under the first stand. The
    sensors are assumed to be free of bias.

    The estimate also contains smoothed joint positions and velocities (`JointFilter`), which use the readings and the
    controller's plan.

    Attributes:
        contact: whether the left and the right foot stand, shape (2,), bool.
    """

    def __init__(self, params: EstimatorParams | None = None) -> None:
        """Set up; call `reset` before `update`."""
        self.params = params or EstimatorParams()
        self._robot = load_robot()
        self._model = pinocchio_model()
        self._data = self._model.createData()
        self._configuration = pin.neutral(self._model)  # its pelvis stays at the origin
        self._columns = joint_columns(self._model, self._robot)
        self._imu, *self._sole_frames = (self._model.getFrameId(n) for n in ("imu", *(f"{s}_sole" for s in SIDES)))
        self._imu_in_torso = self._model.frames[self._imu].placement.translation.copy()
        self._model_noise = self.params.foot_model**2 * np.eye(3)
        # Variances of the random drive of velocity and feet; orientation and position only follow.
        drive = [0.0, self.params.accelerometer, 0.0, *[self.params.foot_slip] * _FEET]
        self._drive = np.repeat(drive, 3) ** 2
        self._joints = JointFilter(self.params, self._robot)
        self.contact = np.zeros(_FEET, dtype=bool)

    def reset(self, state: RobotState) -> RobotState:
        """Start from a robot at rest, at its position or else above the origin, and return the estimate."""
        params = self.params
        self._joints.reset(state.q, np.zeros_like(state.dq))
        self._measure_legs(state.q)
        torso = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), float(state.q[self._robot.waist]))
        self._R = rotations.to_matrix(rotations.multiply(state.orientation, torso))
        self._v = np.zeros(3)
        pelvis = state.position
        if pelvis is None:
            soles = [rotations.rotate(state.orientation, self._placement(frame)) for frame in self._sole_frames]
            pelvis = np.array([0.0, 0.0, -min(sole[2] for sole in soles)])
        self._p = pelvis + rotations.rotate(state.orientation, self._placement(self._imu))
        self._d = self._p + self._soles @ self._R.T
        self._P = np.diag(np.repeat([params.initial_tilt, params.initial_velocity, *[1e-3] * (1 + _FEET)], 3) ** 2)
        self.contact = np.zeros(_FEET, dtype=bool)
        self._time = state.time
        self._plans: collections.deque[tuple[float, np.ndarray | None]] = collections.deque(maxlen=_PLANS)
        return self._estimate(state)

    def update(self, state: RobotState, planned: np.ndarray | None = None) -> RobotState:
        """Return the estimate at a new reading: all of `state` but its time, age and forces is replaced.

        Readings without IMU or foot forces, with numbers that are not finite, or beyond `LARGEST_READING` are returned
        unchanged.

        Args:
            state: the reading, which may be old (`state.age`).
            planned: joint accelerations that the controller plans for the present [rad/s^2], shape (19,). They are kept
                until the readings of the present arrive, and ignored if they are not finite, beyond `LARGEST_READING`
                or of another shape.
        """
        gyro, accelerometer, force = state.imu_gyro, state.imu_accelerometer, state.foot_force
        if gyro is None or accelerometer is None or force is None or not state.is_finite:
            return state
        # A single such number would stay in the filter for ever.
        if np.abs(np.concatenate((gyro, accelerometer, state.q, state.dq))).max() > LARGEST_READING:
            return state
        dt = min(max(state.time - self._time, 0.0), _LONGEST_STEP)
        self._time = state.time
        self._joints.update(state.q, state.dq, dt, self._planned_at(state, planned))
        self._measure_legs(state.q)
        self._predict(gyro, accelerometer, dt)
        contact = force[:, 2] > self.params.contact_force
        for foot in np.flatnonzero(contact & ~self.contact):
            self._enter(foot)
        for foot in np.flatnonzero(contact & self.contact):
            self._correct(foot)
        self.contact = contact
        return self._estimate(state)

    def _planned_at(self, state: RobotState, planned: np.ndarray | None) -> np.ndarray | None:
        """Store the plan for the present, and return the plan for the time of the reading."""
        if planned is not None and (planned.shape != state.q.shape or not np.abs(planned).max() <= LARGEST_READING):
            planned = None
        self._plans.append((state.time + state.age, planned))
        while len(self._plans) > 1 and self._plans[0][0] < state.time - _SAME_TIME:
            self._plans.popleft()
        return self._plans[0][1]

    def _placement(self, frame: int) -> np.ndarray:
        return self._data.oMf[frame].translation

    def _measure_legs(self, q: np.ndarray) -> None:
        """Compute the sole centres seen from the IMU [m], shape (2, 3), and their covariances."""
        model, data, configuration = self._model, self._data, self._configuration
        configuration[self._columns + 1] = q
        pin.computeJointJacobians(model, data, configuration)
        imu = pin.updateFramePlacement(model, data, self._imu)
        self._soles, self._soles_noise = np.zeros((_FEET, 3)), []
        for foot, index in enumerate(self._sole_frames):
            sole = pin.updateFramePlacement(model, data, index).translation
            jacobian = pin.getFrameJacobian(model, data, index, pin.LOCAL_WORLD_ALIGNED)[:3, 6:]
            # The waist turns the IMU: seen from the IMU, the foot turns the other way about the pelvis's z axis.
            jacobian[:, self._columns[self._robot.waist] - 6] = (sole[1], -sole[0], 0.0)
            jacobian = imu.rotation.T @ jacobian
            self._soles[foot] = imu.rotation.T @ (sole - imu.translation)
            self._soles_noise.append(self.params.encoder**2 * jacobian @ jacobian.T + self._model_noise)

    def _predict(self, gyro: np.ndarray, accelerometer: np.ndarray, dt: float) -> None:
        acceleration = self._R @ accelerometer + _DOWN
        self._p = self._p + dt * (self._v + 0.5 * dt * acceleration)
        self._v = self._v + dt * acceleration
        self._R = self._R @ pin.exp3(gyro * dt)
        transition = np.eye(_SIZE)
        transition[_VELOCITY, _ORIENTATION] = dt * _GRAVITY_CROSS
        transition[_POSITION, _ORIENTATION] = 0.5 * dt**2 * _GRAVITY_CROSS
        transition[_POSITION, _VELOCITY] = dt * np.eye(3)
        # The error is right-invariant: gyro noise turns the whole estimate about the world's origin, hence lever arms.
        lever = np.vstack((np.eye(3), *(pin.skew(x) for x in (self._v, self._p, *self._d))))
        noise = (self.params.gyro * dt) ** 2 * lever @ lever.T
        noise.flat[:: _SIZE + 1] += self._drive * dt**2
        self._P = transition @ self._P @ transition.T + noise

    def _enter(self, foot: int) -> None:
        """Initialise a foot that came down: its position is the one given by the leg kinematics."""
        self._d[foot] = self._p + self._R @ self._soles[foot]
        rows = slice(9 + 3 * foot, 12 + 3 * foot)
        self._P[rows] = self._P[_POSITION]
        self._P[:, rows] = self._P[:, _POSITION]
        self._P[rows, rows] += self._R @ self._soles_noise[foot] @ self._R.T

    def _correct(self, foot: int) -> None:
        """Correct by the innovation R h + p - d, which is linear in the error: position error minus foot error."""
        rows = slice(9 + 3 * foot, 12 + 3 * foot)
        innovation = self._R @ self._soles[foot] + self._p - self._d[foot]
        spread = self._P[:, _POSITION] - self._P[:, rows]
        covariance = spread[_POSITION] - spread[rows] + self._R @ self._soles_noise[foot] @ self._R.T
        gain = spread @ np.linalg.inv(covariance)
        error = -gain @ innovation
        turn = pin.exp3(error[_ORIENTATION])
        self._R = turn @ self._R
        self._v = turn @ self._v + error[_VELOCITY]
        self._p = turn @ self._p + error[_POSITION]
        self._d = self._d @ turn.T + error[9:].reshape(_FEET, 3)
        self._P = self._P - gain @ spread.T
        self._P = 0.5 * (self._P + self._P.T)

    def _estimate(self, state: RobotState) -> RobotState:
        """Return the state of the pelvis, found below the IMU by the smoothed waist joint."""
        joints, robot = self._joints, self._robot
        waist, rate = float(joints.q[robot.waist]), float(joints.dq[robot.waist])
        to_pelvis = rotations.rotation_z(waist)
        rotation = self._R @ to_pelvis.T
        gyro = np.zeros(3) if state.imu_gyro is None else state.imu_gyro
        return dataclasses.replace(
            state,
            q=joints.q.copy(),
            dq=joints.dq.copy(),
            orientation=pin.Quaternion(rotation).coeffs()[[3, 0, 1, 2]],
            angular_velocity=to_pelvis @ gyro - np.array([0.0, 0.0, rate]),
            # The origins of torso and pelvis coincide, on the waist's axis.
            position=self._p - self._R @ self._imu_in_torso,
            velocity=self._v - self._R @ (pin.skew(gyro) @ self._imu_in_torso),
        )


_GRAVITY_CROSS = pin.skew(_DOWN)

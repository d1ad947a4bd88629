"""A guard between the sensors and the estimator: it refuses implausible readings, and fills the gaps.

Each device is judged by itself: the IMU, and the encoder of every joint. What is not a number, beyond what the sensor
or the joint can do, far from where the last readings lead, or repeated to the last digit although the robot moves, is
refused. A walk repeats itself stride by stride: a refused reading is replaced by that of the same posture in the past
(an analogue forecast, Lorenz, *Atmospheric predictability as revealed by naturally occurring analogues*, 1969). What
lasts longer than this can be right is told as lost (`RobotState.lost`).
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from hugwbc.robot import Robot
from hugwbc.state import RobotState

IMU, ALL = "imu", "all readings"


# [rad], [rad/s], [rad/s^2], [m/s^2], [N*m]; larger numbers come from broken sensors, and nothing starts from them.
LARGEST_READING = 1e4
# Valid readings.
GYRO = 34.9  # [rad/s], largest angular velocity; the IMU's range is 2000 degrees per second
ACCELEROMETER = 235.0  # [m/s^2], largest specific force; the IMU's range is 24 g, and averages of impacts lie within
_SPEED = 4.0  # largest velocity of a joint, as a multiple of the robot's table
_BEYOND = 0.3  # [rad], how far outside a joint's range its encoder may read
_TORQUE = 2.0  # largest torque, as a multiple of the robot's table
_POSITION_JUMP = 0.2  # [rad], largest difference of an encoder's reading to where the last one leads
_DRIFT = 4.0  # [rad/s], growth of that difference while the joint is not read
GYRO_JUMP = 20.0  # [rad/s], largest change of the gyro between two readings
_REPEATS = 3  # number of repetitions of a reading from which on a device hangs
_STILL = 0.2  # [rad/s], speed of a joint below which equal readings are not a fault if they show that it stands
_GAP = 1.5  # usual times between two readings, from which on some are missing
_LONGEST_STEP = 0.1  # [s], largest time between two readings; a longer one, or one back, is a wrong time stamp
# [s], how long the IMU, an encoder, or all of them may be missing before the state is lost.
_IMU_LOSS, _ENCODER_LOSS, _ALL_LOSS = 0.3, 0.3, 0.2
_HISTORY = 1.5  # [s], a stride and a half
_LEAST_LEAD = 0.3  # [s] between now and the past that is repeated
_SPEED_WEIGHT = 0.05  # [s], of a velocity against a position where the past is compared with the present
_LEAP = 0.02  # [rad], what it costs to leave the past where it is being repeated
_FADE = 0.1  # [s], in which the difference between a joint's last reading and that of the past fades
_RESYNCHRONISE = 0.1  # [s] of refused time stamps after which the sensors' clock is believed again


def _is_attitude(state: RobotState) -> bool:
    """Return whether orientation and angular velocity are numbers; they come from the IMU and the waist's encoder."""
    return math.isfinite(state.orientation.dot(state.orientation) + state.angular_velocity.dot(state.angular_velocity))


def _is_likely(gyro: np.ndarray, accelerometer: np.ndarray, before: np.ndarray) -> bool:
    """Return whether an IMU can read this after another reading of its gyro. NaN is not likely."""
    within = (np.abs(gyro) <= GYRO).all() and (np.abs(accelerometer) <= ACCELEROMETER).all()
    return bool(within and (np.abs(gyro - before) <= GYRO_JUMP).all())


def plausible(readings: Sequence[RobotState], gyro: np.ndarray | None, robot: Robot) -> Sequence[RobotState]:
    """Return those of some readings whose IMU and torques can be true, by themselves: a mean would hide a wild one.

    Args:
        readings: in order, all with an IMU and torques.
        gyro: of the reading before them [rad/s], shape (3,); None if there was none.
        robot: that they are of.

    Returns:
        All, if none can be true; `ReadingGuard` then judges their mean.
    """
    if gyro is None or len(readings) == 1:
        return readings
    strongest, sound = _TORQUE * robot.torque_limit, []
    for reading in readings:
        assert reading.imu_gyro is not None and reading.imu_accelerometer is not None and reading.torque is not None
        likely = _is_likely(reading.imu_gyro, reading.imu_accelerometer, gyro)
        if likely and (np.abs(reading.torque) <= strongest).all():
            sound.append(reading)
            gyro = reading.imu_gyro
    return sound or readings


class ReadingGuard:
    """Refuses implausible readings of each device and fills the gaps, as the module says.

    Attributes:
        rejected: number of refused readings since the reset, by device; `ALL` where all were refused at once.
    """

    def __init__(self, robot: Robot) -> None:
        """Take ranges and limits from a robot."""
        self._robot = robot
        joints = len(robot.joint_names)
        ends = np.cumsum((0, 3, 3, joints, joints, joints)).tolist()
        self._gyro, self._accelerometer, self._q, self._dq, self._torque = map(slice, ends[:-1], ends[1:])
        self._low, self._high = robot.lower - _BEYOND, robot.upper + _BEYOND
        self._fastest, self._strongest = _SPEED * robot.velocity_limit, _TORQUE * robot.torque_limit
        # Of all numbers of a reading: the bounds, and how far each may be from where the last reading leads.
        self._highest = np.concatenate(
            (np.full(3, GYRO), np.full(3, ACCELEROMETER), self._high, self._fastest, self._strongest)
        )
        self._lowest = -self._highest
        self._lowest[self._q] = self._low
        self._room = np.full(self._highest.size, np.inf)
        self._room[self._gyro], self._room[self._q] = GYRO_JUMP, _POSITION_JUMP
        self.reset(None)

    def reset(self, state: RobotState | None, period: float = 0.002) -> None:
        """Forget the past. Begin with time and attitude of a state, if given; readings come once in a period [s]."""
        self._history, self._least_lead = round(_HISTORY / period), round(_LEAST_LEAD / period)
        self._records, self._end = np.zeros((2 * self._history, self._torque.stop)), self._history
        self._past = self._records[: self._history]  # the latest readings, a view
        self.rejected: dict[str, int] = {}
        self._length = 0
        self._last: np.ndarray | None = None  # as it was given to the estimator
        self._raw: np.ndarray | None = None
        self._equal = np.zeros(1 + len(self._robot.joint_names), dtype=int)  # in succession, of each device
        self._gone = np.zeros(1 + len(self._robot.joint_names))  # [s] since the last good reading, of each device
        self._calm = True  # whether both are 0 for all
        self._analogue, self._offset = -1, np.zeros(len(self._robot.joint_names))
        self._time, self._period, self._refused, self._lost = None if state is None else state.time, period, 0, ""
        self._step = period  # [s], from the reading before to this one
        self._attitude: tuple[np.ndarray, np.ndarray] | None = None
        if state is not None and _is_attitude(state):
            self._attitude = state.orientation, state.angular_velocity

    @property
    def started(self) -> bool:
        """Whether there has been a reading to judge others by."""
        return self._last is not None

    def admit(self, state: RobotState) -> RobotState:
        """Return a reading in which what was refused is replaced, with `coasted` and `lost` set.

        A reading without an IMU or torques, or a first one beyond `LARGEST_READING`, is returned as it is.
        """
        if state.imu_gyro is None or state.imu_accelerometer is None or state.torque is None:
            return state
        raw = np.concatenate((state.imu_gyro, state.imu_accelerometer, state.q, state.dq, state.torque))
        before = self._time
        time, timely = self._clock(state.time)
        self._step = self._period if before is None else min(max(time - before, 0.0), _LONGEST_STEP)
        if self._last is None:
            if not (np.abs(raw) <= LARGEST_READING).all():
                return state
            self._last, self._raw = raw, raw
        if not (timely and self._is_sound(raw)):
            bad = self._judge(raw, timely)
            if bad.any() or not (np.abs(raw[self._torque]) <= self._strongest).all():  # nor is NaN
                return self._coast(state, raw, bad, time)
            self._analogue = -1
            self._gone[:] = 0.0
            self._calm = not self._equal.any()
        self._remember(raw)
        self._last, self._raw = raw, raw
        if _is_attitude(state):
            self._attitude = state.orientation, state.angular_velocity
        return dataclasses.replace(state, time=time, lost=self._lost) if self._lost else state

    def _is_sound(self, raw: np.ndarray) -> bool:
        """Return whether nothing at all is wrong with a reading, after one with which nothing was: the usual case."""
        last, before = self._last, self._raw
        assert last is not None and before is not None
        if self._analogue >= 0 or not self._calm or self._step > _GAP * self._period:
            return False
        change = raw - last
        change[self._q] -= self._step * last[self._dq]
        # A comparison with NaN is false.
        sound = (np.abs(change) <= self._room) & (raw <= self._highest) & (raw >= self._lowest) & (raw != before)
        return np.count_nonzero(sound) == sound.size  # in a tenth of the time of `all`

    def _clock(self, time: float) -> tuple[float, bool]:
        """Return the time of a reading [s], and whether its stamp can be true."""
        if self._time is None or not math.isfinite(time):
            now = (self._time or 0.0) + self._period if not math.isfinite(time) else time
            self._time = now
            return now, math.isfinite(time)
        step = time - self._time
        if 0.0 <= step <= _LONGEST_STEP or self._refused * self._period >= _RESYNCHRONISE:
            self._refused, self._time = 0, time
            return time, True
        self._refused += 1
        self._time += self._period
        return self._time, False

    def _judge(self, raw: np.ndarray, timely: bool) -> np.ndarray:
        """Return whether to refuse each device: the IMU, then the joints' encoders; shape (1 + n,), bool."""
        last, before = self._last, self._raw
        assert last is not None and before is not None
        bad = np.zeros(self._gone.size, dtype=bool)
        if not timely:
            bad[:] = True
            return bad
        with np.errstate(invalid="ignore"):  # comparisons with NaN are false, so each says what is good
            gyro, q, dq = raw[self._gyro], raw[self._q], raw[self._dq]
            good_imu = _is_likely(gyro, raw[self._accelerometer], last[self._gyro])
            room = _POSITION_JUMP + _DRIFT * (self._gone[1:] + max(self._step - self._period, 0.0))
            near = np.abs(q - last[self._q] - self._step * last[self._dq]) <= room
            good = near & (q >= self._low) & (q <= self._high) & (np.abs(dq) <= self._fastest)
            same = raw == before
        repeated = np.concatenate(([same[:6].all()], same[self._q] & same[self._dq]))
        self._equal = np.where(repeated, self._equal + 1, 0)
        hanging = self._equal >= _REPEATS
        at_rest = (dq == 0.0) & (np.abs(last[self._dq]) < _STILL) & (self._gone[1:] == 0.0)
        hanging[1:] &= ~at_rest
        bad[0], bad[1:] = not good_imu or hanging[0], ~good | hanging[1:]
        return bad

    def _coast(self, state: RobotState, raw: np.ndarray, bad: np.ndarray, time: float) -> RobotState:
        """Return the reading with the refused devices replaced by what the past says."""
        names = (IMU, *self._robot.joint_names)
        given = self._patched(raw, bad)
        self._gone, self._calm = np.where(bad, self._gone + self._step, 0.0), False
        devices = (
            (ALL,) if bad.all() else tuple(name for name, refused in zip(names, bad.tolist(), strict=True) if refused)
        )
        for name in devices:
            self.rejected[name] = self.rejected.get(name, 0) + 1
        if not self._lost:
            longest = self._gone[1:].max()
            if self._gone.min() > _ALL_LOSS:
                self._lost = f"{ALL} failed for {1e3 * _ALL_LOSS:.0f} ms"
            elif self._gone[0] > _IMU_LOSS:
                self._lost = f"the IMU failed for {1e3 * _IMU_LOSS:.0f} ms"
            elif longest > _ENCODER_LOSS:
                joint = names[1 + int(np.argmax(self._gone[1:]))]
                self._lost = f"the encoder of {joint} failed for {1e3 * _ENCODER_LOSS:.0f} ms"
        self._last, self._raw = given, raw
        orientation, rate = state.orientation, state.angular_velocity
        if self._attitude is not None and (bad[0] or not _is_attitude(state)):
            orientation, rate = self._attitude
        return dataclasses.replace(
            state,
            q=given[self._q],
            dq=given[self._dq],
            orientation=orientation,
            angular_velocity=rate,
            imu_gyro=given[self._gyro],
            imu_accelerometer=given[self._accelerometer],
            torque=given[self._torque],
            time=time,
            coasted=devices,
            lost=self._lost,
        )

    def _patched(self, raw: np.ndarray, bad: np.ndarray) -> np.ndarray:
        """Return a reading in which the past replaces refused devices and torques beyond the motors' limits."""
        assert self._last is not None
        starts = self._analogue < 0
        self._analogue = self._next_analogue(raw, bad)
        if self._analogue < 0:  # no past to compare with: what was is what is
            past = self._last.copy()
            past[self._dq] = 0.0
        else:
            past = self._past[self._analogue]
        newly = bad[1:] & (self._gone[1:] == 0.0)
        self._offset[newly] = (self._last[self._q] - past[self._q])[newly]
        if starts:
            self._offset[~bad[1:]] = 0.0
        given = raw.copy()
        if bad[0]:
            given[:6] = past[:6]
        joints = bad[1:]
        fade = np.exp(-self._gone[1:] / _FADE)
        given[self._q] = np.where(joints, past[self._q] + fade * self._offset, raw[self._q])
        given[self._dq] = np.where(joints, past[self._dq], raw[self._dq])
        torque = raw[self._torque]
        with np.errstate(invalid="ignore"):
            usable = (np.abs(torque) <= self._strongest) & ~(bad.all())
        given[self._torque] = np.where(usable, torque, past[self._torque])
        return given

    def _remember(self, raw: np.ndarray) -> None:
        """Append a good reading to the past, which moves along its memory and now and then back to its beginning."""
        if self._end == len(self._records):
            self._records[: self._history], self._end = self._past, self._history
        self._records[self._end] = raw
        self._end += 1
        self._past = self._records[self._end - self._history : self._end]
        self._length = min(self._length + 1, self._history)

    def _next_analogue(self, raw: np.ndarray, bad: np.ndarray) -> int:
        """Return the row of the past that is most like the present; -1 if there is not enough past."""
        first, last = self._history - self._length, self._history - self._least_lead
        if last - first < self._least_lead:
            return -1
        following = self._analogue + 1
        if bad.all():
            if self._analogue >= 0:
                return min(following, self._history - 1)
            present, joints = self._last, np.ones(bad.size - 1, dtype=bool)
        else:
            present, joints = raw, ~bad[1:]
        assert present is not None
        weight = np.concatenate((np.zeros(6), joints, _SPEED_WEIGHT * joints, np.zeros(joints.size)))
        used = np.flatnonzero(weight)
        far = (self._past[first:last, used] - present[used]) * weight[used]
        distance = np.sqrt(np.einsum("ij,ij->i", far, far))
        if self._analogue >= 0:
            distance += _LEAP * np.minimum(np.abs(np.arange(first, last) - following), 5)
        return first + int(np.argmin(distance))

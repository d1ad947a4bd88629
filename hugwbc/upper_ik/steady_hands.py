r"""Hand targets that stay where the robot is on average, while the pelvis sways with every step.

Walking is periodic, and its period is commanded: 1/f. What shakes a hand in one stride shakes it in the next one,
whether it came from the pelvis, from an impact of a foot or from the lag of the arm. A correction that is learned from
the strides before is therefore right in phase also where the state is known 10 ms late, where feedback would only
excite the hands. It is a Fourier series of the stride's phase :math:`\theta`, added to the targets,

.. math::
    d(\theta) = \sum_{k=1}^{N} \mathrm{Re}\,(c_k e^{i k \theta}), \qquad
    \dot c_k = -2 \mu\, e\, e^{-i k (\theta - 2 \pi f \tau)},

with e the hand's departure from its mean over a stride, and :math:`\tau` the time from a target to the hand's reading.
This is adaptive feed-forward cancellation (Bodson, Sacks, Khosla, "Harmonic generation in adaptive feedforward
cancellation schemes", IEEE TAC 1994), which equals an internal model of the disturbance. An amplitude converges with
the time constant :math:`1 / \mu`.
"""

import math

import numpy as np

from hugwbc import rotations
from hugwbc.commands import Command
from hugwbc.gait import Gait
from hugwbc.kinematics import Kinematics
from hugwbc.robot import Robot
from hugwbc.state import RobotState
from hugwbc.targets import HandTargets

RATE = 1.0  # [1/s], mu: fast enough for a walk of a few seconds, slow enough to average out noise
FINE = 8.0  # [Hz], above which the encoders' noise asks for slower learning
COARSE = 0.01  # [s], control period from which on the accelerometer's impacts would be sampled too rarely
SMOOTH = 0.2  # [s], time constant with which what is learned is used
LAG = 0.004  # [s], from a target to the arm's motion: the delay of the drives, and what the servo leaves
HIGHEST = 25.0  # [Hz], of the harmonics
SAMPLES = 3.5  # control periods in the shortest harmonic
LARGEST = 0.05  # [m], of the correction; the pelvis sways by 1 to 2 cm
FADING = 2.0  # [1/s], at which the correction fades in a stand
STRIDES = (1.0, 4.0)  # [Hz], range of the stride frequency, so that any command gives a finite stride
_MOST = 20  # harmonics


class SteadyHands:
    """Turns targets of the "steady" frame into targets of the pelvis frame.

    The steady frame lies level at the mean of the pelvis over the last stride and turns with its heading. The targets
    that come out move smoothly: they contain the mean tilt and the learned series, and no single reading.
    """

    def __init__(self, robot: Robot) -> None:
        kinematics = Kinematics(robot)
        self._robot = robot
        frame = kinematics.model.frames[kinematics.frame_id("imu")]
        # Places of the IMU in the frame of its joint, and of this joint in the pelvis, 0 for the root joint [m].
        self._imu = frame.placement.translation.copy()
        self._turned_at = kinematics.model.jointPlacements[frame.parentJoint].translation.copy()
        self._order = np.arange(1, _MOST + 1)
        self.reset()

    def reset(self) -> None:
        """Forget what was learned."""
        self._angle = 0.0
        self._learned = np.zeros((_MOST, 2, 3), dtype=complex)
        self._series = np.zeros((_MOST, 2, 3), dtype=complex)  # what is used
        self._past = np.empty((0, 17))

    @property
    def correction(self) -> np.ndarray:
        """Present correction of the targets, in the axes of the steady frame [m], shape (2, 3)."""
        waves = np.exp(1j * self._angle * self._order)
        return np.einsum("k,khi->hi", waves, self._series).real

    def place(
        self, targets: HandTargets, hands: np.ndarray, state: RobotState, command: Command, dt: float
    ) -> HandTargets:
        """Return the targets in the pelvis frame, and learn from where the hands are.

        Args:
            targets: in the steady frame, usable (`HandTargets.is_usable`).
            hands: where the hands were at the reading, in the pelvis frame [m], shape (2, 3).
            state: the robot's reading. The pelvis's translation is learned from the accelerometer or, without one or at
                periods from `COARSE` on, from the position; with neither, only the pelvis's rotation is learned.
            command: the one that the controller follows. It gives the stride frequency; nothing is learned, and the
                correction fades, while it says to stand.
            dt: time since the last call [s].
        """
        dt = dt if 0.0 < dt < math.inf else 0.0
        asked = np.nan_to_num(targets.array())
        low, high = STRIDES
        frequency = min(max(command.f, low), high) if math.isfinite(command.f) else low
        self._angle = (self._angle + 2.0 * math.pi * frequency * dt) % (2.0 * math.pi)
        if not (state.is_usable and np.isfinite(hands).all()):
            return self._in_pelvis(targets, asked)
        pelvis = rotations.to_matrix(state.orientation)
        origin, felt = np.zeros(3) if state.position is None else state.position, np.zeros(3)
        if state.imu_accelerometer is not None and dt < COARSE:
            torso = rotations.rotation_z(self._robot.imu_turn(state.q, state.dq)[0])
            origin = -(pelvis @ self._turned_at + pelvis @ torso @ self._imu)
            felt = pelvis @ torso @ state.imu_accelerometer
        roll, pitch = rotations.roll_of(state.orientation), rotations.pitch_of(state.orientation)
        world = origin + hands @ pelvis.T
        row = np.concatenate((world.ravel(), asked.ravel(), felt, (roll, pitch)))
        if dt > 0.0:
            length = max(2, round(1.0 / (frequency * dt)))
            self._past = np.concatenate((self._past, row[None]))[-length - 1 :]
            if command.gait is Gait.STANDING:
                self._learned *= max(0.0, 1.0 - FADING * dt)
            elif len(self._past) == length + 1:
                self._learn(state, frequency, targets.given, dt)
            # Every single reading is noise, and the arms would be told its second derivative.
            self._series += (self._learned - self._series) * min(1.0, dt / SMOOTH)
        return self._in_pelvis(targets, asked)

    def _learn(self, state: RobotState, frequency: float, given: np.ndarray, dt: float) -> None:
        """Correct the series by the hands' departure from their mean over the last stride."""
        first, last = self._past[0], self._past[-1]
        # The mean belongs to the middle of the stride; half of the stride's way brings it to its end.
        away = (last - 0.5 * (last - first) - self._past[1:].mean(axis=0))[:15].reshape(5, 3)
        heading = rotations.rotation_z(state.yaw)
        error = away[:2] @ heading - away[2:4]
        shaken = (self._past[-1] - self._past[1:].mean(axis=0))[12:15] @ heading
        error = np.minimum(np.maximum(error, -LARGEST), LARGEST) * given[:, None]
        turning = 2.0 * math.pi * frequency
        then = self._angle - turning * (state.age + LAG + dt)
        waves = np.exp(-1j * then * self._order)
        waves *= RATE / (1.0 + (self._order * frequency / FINE) ** 2)
        waves *= self._order * frequency <= min(HIGHEST, 1.0 / (SAMPLES * dt))
        errors = error - (shaken / (turning * self._order[:, None]) ** 2)[:, None] * given[:, None]
        self._learned -= 2.0 * dt * waves[:, None, None] * errors
        size = float(np.abs(self._learned).sum(axis=0).max())
        self._learned *= min(1.0, LARGEST / max(size, 1e-9))

    def _in_pelvis(self, targets: HandTargets, asked: np.ndarray) -> HandTargets:
        """Return the targets with the correction, turned by the mean tilt."""
        tilt = self._past[-max(1, len(self._past) - 1) :, 15:].mean(axis=0) if len(self._past) else np.zeros(2)
        turn = rotations.to_matrix(rotations.from_yaw_pitch_roll(0.0, float(tilt[1]), float(tilt[0])))
        points = (asked + self.correction) @ turn
        return targets.turned(turn, points, "pelvis")

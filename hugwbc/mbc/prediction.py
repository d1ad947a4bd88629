"""From a state that is some time old to the present one, by the accelerations that were commanded since."""

import collections
import dataclasses

import numpy as np
import pinocchio as pin

from hugwbc import rotations
from hugwbc.kinematics import Kinematics
from hugwbc.state import RobotState

_LONGEST_AGE = 0.03  # [s], up to which a prediction is better than the reading


class Predictor:
    """Integrates the accelerations of the last solutions over the age of a reading.

    They account for contacts as the QP plans them, so that only what it did not foresee, such as an impact, is seen
    late.
    """

    def __init__(self, kinematics: Kinematics, period: float) -> None:
        """Predict for a model, with accelerations held for `period` [s]."""
        self._model = kinematics.model
        self._columns = kinematics.columns
        self._period = period
        self._accelerations: collections.deque[np.ndarray] = collections.deque(maxlen=int(_LONGEST_AGE / period) + 1)

    def reset(self) -> None:
        """Forget all accelerations."""
        self._accelerations.clear()

    def record(self, acceleration: np.ndarray) -> None:
        """Note what the next period is to do: Pinocchio's dv/dt, shape (nv,)."""
        self._accelerations.append(acceleration)

    def predict(self, state: RobotState) -> RobotState:
        """The state `state.age` later; one that is not old comes back as it is."""
        if state.age <= 0.0:
            return state
        age = min(state.age, _LONGEST_AGE)
        # Whole periods before the present, and the part of the one in which the reading was taken.
        pieces = min(int(np.ceil(age / self._period - 1e-6)), len(self._accelerations))
        if pieces <= 0:
            return state
        durations = np.full(pieces, self._period)
        durations[0] = min(age - (pieces - 1) * self._period, self._period)
        assert state.position is not None and state.velocity is not None
        q, v = np.zeros(self._model.nq), np.zeros(self._model.nv)
        q[:3], q[3:6], q[6] = state.position, state.orientation[1:], state.orientation[0]
        v[:3], v[3:6] = rotations.rotate_inverse(state.orientation, state.velocity), state.angular_velocity
        q[self._columns + 1], v[self._columns] = state.q, state.dq
        for acceleration, duration in zip(list(self._accelerations)[-pieces:], durations, strict=True):
            q = pin.integrate(self._model, q, duration * (v + 0.5 * duration * acceleration))
            v += duration * acceleration
        orientation = q[[6, 3, 4, 5]]
        return dataclasses.replace(
            state,
            q=q[self._columns + 1],
            dq=v[self._columns],
            orientation=orientation,
            angular_velocity=v[3:6],
            position=q[:3],
            velocity=rotations.rotate(orientation, v[:3]),
            age=state.age - float(durations.sum()),
        )

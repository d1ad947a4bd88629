"""State completion: position and velocity by leg odometry, latency by prediction."""

import collections
import dataclasses
import itertools
import math

import numpy as np
import pinocchio as pin

from hugwbc import rotations
from hugwbc.kinematics import Kinematics, in_place
from hugwbc.numeric import changed
from hugwbc.robot import SIDES, Robot
from hugwbc.state import GRAVITY, RobotState

_LONGEST_AGE = 0.03  # [s], age up to which a prediction is better than the reading


class LegOdometry:
    """Completes a state that lacks position or velocity, assuming that standing feet do not move.

    The velocity of the pelvis is minus that of a standing sole as seen from a pelvis that does not translate. Of two
    standing soles, the one counts that changes the velocity of the centre of mass less, because a foot that has just
    come down may still slide. The position is the integral of that velocity, with the height taken from the lowest
    standing sole on ground at z = 0. While no foot stands, the centre of mass falls freely and the pelvis follows it.
    """

    def __init__(self, robot: Robot) -> None:
        self._kinematics = Kinematics(robot)
        self.reset()

    def reset(self) -> None:
        """Start again above the origin."""
        self._position = np.zeros(3)
        self._com, self._com_velocity = np.zeros(3), np.zeros(3)

    def complete(self, state: RobotState, contact: np.ndarray, dt: float) -> RobotState:
        """Return the state with position [m] and velocity [m/s] in the world; a complete state is returned as it is.

        Args:
            state: reading with or without position and velocity.
            contact: whether the left and the right foot stand, shape (2,), bool.
            dt: time since the last call [s].
        """
        if state.position is not None and state.velocity is not None:
            return state
        kinematics = self._kinematics
        kinematics.update(dataclasses.replace(state, position=np.zeros(3), velocity=np.zeros(3)))
        com = pin.centerOfMass(kinematics.model, kinematics.data, kinematics.q, kinematics.v).copy()
        com_velocity = kinematics.data.vcom[0].copy()
        soles = [f"{side}_sole" for side, stands in zip(SIDES, contact, strict=True) if stands]
        if soles:
            told = [-kinematics.velocity(sole)[:3] for sole in soles]
            velocity = min(told, key=lambda each: float(np.sum((each + com_velocity - self._com_velocity) ** 2)))
            self._position += velocity * dt
            self._position[2] = -min(kinematics.position(sole)[2] for sole in soles)
        else:
            # In flight the joints move the pelvis against the centre of mass, which alone follows a parabola.
            fallen = np.array([0.0, 0.0, GRAVITY * dt])
            self._position += self._com - com + (self._com_velocity - 0.5 * fallen) * dt
            velocity = self._com_velocity - fallen - com_velocity
        # Place of the centre of mass relative to the pelvis, and its velocity in the world.
        self._com, self._com_velocity = com, velocity + com_velocity
        return dataclasses.replace(
            state,
            position=self._position.copy() if state.position is None else state.position,
            velocity=velocity if state.velocity is None else state.velocity,
        )


class Predictor:
    """Carries a late reading to the present by integrating the accelerations that were commanded since.

    Those accelerations contain the contacts that the QP planned, so that only what it did not foresee, such as an
    impact, is seen late.
    """

    def __init__(self, kinematics: Kinematics, period: float) -> None:
        """Set up for a robot model whose commanded accelerations each hold for `period` [s]."""
        self._model = kinematics.model
        self._v_joints, self._q_joints = in_place(kinematics.columns), in_place(kinematics.columns + 1)
        self._period = period
        self._q, self._v = np.zeros(self._model.nq), np.zeros(self._model.nv)
        self._accelerations: collections.deque[np.ndarray] = collections.deque(maxlen=int(_LONGEST_AGE / period) + 1)

    def reset(self) -> None:
        """Forget all accelerations."""
        self._accelerations.clear()

    def record(self, acceleration: np.ndarray) -> None:
        """Note the acceleration commanded for the next period: Pinocchio's dv/dt, shape (nv,)."""
        self._accelerations.append(acceleration)

    def predict(self, state: RobotState, delay: float = 0.0) -> RobotState:
        """Return the state `state.age` and a delay later; one that is not old stays as it is.

        Args:
            state: complete reading, with position and velocity.
            delay: from now on [s].
        """
        age = state.age + delay
        recorded = len(self._accelerations)
        # Whole periods before the present, and the part of the period in which the reading was taken.
        pieces = min(math.ceil(min(age, _LONGEST_AGE) / self._period - 1e-6), recorded)
        if pieces <= 0:
            return state
        assert state.position is not None and state.velocity is not None
        q, v = self._q, self._v
        q[:3], q[3:6], q[6] = state.position, state.orientation[1:], state.orientation[0]
        v[:3], v[3:6] = rotations.rotate_inverse(state.orientation, state.velocity), state.angular_velocity
        q[self._q_joints], v[self._v_joints] = state.q, state.dq
        duration = min(min(age, _LONGEST_AGE) - (pieces - 1) * self._period, self._period)
        way, carried = np.zeros(v.size), 0.0
        for acceleration in itertools.islice(self._accelerations, recorded - pieces, None):
            gain = duration * acceleration
            # The mean velocity of a piece moves the position, so that constant accelerations give exact parabolas. The
            # axis of the rotation hardly turns within so short a time, so that the pieces may be added up.
            way += duration * (v + 0.5 * gain)
            v = v + gain
            carried += duration
            duration = self._period
        q = pin.integrate(self._model, q, way)
        orientation = q[[6, 3, 4, 5]]
        return changed(
            state,
            q=q[self._q_joints],
            dq=v[self._v_joints],
            orientation=orientation,
            angular_velocity=v[3:6],
            position=q[:3],
            velocity=rotations.rotate(orientation, v[:3]),
            age=age - carried,
        )

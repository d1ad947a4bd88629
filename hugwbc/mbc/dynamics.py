"""Dynamics of the free-floating robot at one state, which the tasks and the QP read, and the state after a latency."""

import collections
import itertools
import math
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hugwbc import rotations
from hugwbc.kinematics import Kinematics, in_place
from hugwbc.numeric import changed
from hugwbc.robot import SIDES, Robot
from hugwbc.state import GRAVITY, RobotState

_SOLE_ENDS = ("heel", "toe")
_FARTHEST_SHIFT = 0.25  # [m], by which forces on the hands may shift the balance
_EDGE_ROLL = 0.02  # [rad], roll of the sole from which on only its edge touches the ground
_LONGEST_AGE = 0.03  # [s], age up to which a prediction is better than the reading


class FrameMotion(NamedTuple):
    """A frame and its motion, in world axes."""

    position: np.ndarray  # origin of the frame [m], shape (3,)
    rotation: np.ndarray  # axes of the frame in the world, shape (3, 3)
    jacobian: np.ndarray  # Jacobian of the linear, then of the angular velocity, shape (6, nv)
    velocity: np.ndarray  # linear velocity [m/s], then angular velocity [rad/s], shape (6,)
    drift: np.ndarray  # acceleration at zero generalised acceleration, dJ/dt v [m/s^2], [rad/s^2], shape (6,)


class Dynamics(Kinematics):
    """Mass matrix, bias, centroidal quantities and frame Jacobians, all computed by one `update`.

    Generalised velocities v follow Pinocchio: base linear and angular velocity in the base frame, then the joints.
    Equation of motion: M dv/dt + bias = S^T tau + sum J^T f.

    Attributes:
        mass: mass of the robot [kg].
        M: mass matrix with rotor inertia, shape (nv, nv).
        bias: Coriolis, centrifugal, gravity and joint damping terms, less the generalised forces of `hand_force` [N],
            [N m], shape (nv,).
        hand_force: force on the left and the right hand from outside, world axes [N], shape (2, 3); set it before
            `update`.
        com, com_velocity: position and velocity of the centre of mass in the world [m], [m/s], shape (3,).
        com_jacobian, com_drift: with d(com_velocity)/dt = com_jacobian dv/dt + com_drift; shapes (3, nv), (3,).
        momentum: angular momentum about the centre of mass, world axes [kg m^2/s], shape (3,).
        momentum_jacobian, momentum_drift: likewise for the angular momentum.
        edge: distance from the sole's centre line at which a rolled foot touches the ground [m]; 0 for the line itself.
    """

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot)
        self.mass = float(pin.computeTotalMass(self.model))
        self._damping = np.zeros(self.model.nv)
        self._damping[self.columns] = self.robot.damping
        # Turns linear momentum into the velocity of the centre of mass and leaves the angular momentum.
        self._per_mass = np.array([[1.0 / self.mass]] * 3 + [[1.0]] * 3)
        self.edge = 0.0
        self.hand_force = np.zeros((len(SIDES), 3))

    @property
    def nv(self) -> int:
        """Number of generalised velocities."""
        return self.model.nv

    def update(self, state: RobotState) -> None:
        """Compute everything at a state; a missing position or velocity counts as 0."""
        self.add_inertia(state.untold_inertia)
        super().update(state)
        self._frames: dict[str, FrameMotion] = {}

    def _compute(self) -> None:
        model, data = self.model, self.data
        # In world axes crba gives the centroidal momentum matrix along with the mass matrix.
        pin.crba(model, data, self.q, pin.Convention.WORLD)
        self.M = data.M.copy()  # since Pinocchio 3, crba fills both triangles
        rates = data.Ag * self._per_mass
        self.com = data.com[0].copy()
        self.bias = pin.nonLinearEffects(model, data, self.q, self.v) + self._damping * self.v
        # The kinematics come last, since the calls above overwrite the accelerations of the frames.
        super()._compute()
        if np.count_nonzero(self.hand_force):
            for side, force in zip(SIDES, self.hand_force, strict=True):
                hand = pin.getFrameJacobian(model, data, self.frame_id(f"{side}_hand"), pin.LOCAL_WORLD_ALIGNED)
                self.bias -= hand[:3].T.dot(force)
        # At zero generalised acceleration the rate of the momentum is its drift.
        drift = pin.computeCentroidalMomentumTimeVariation(model, data).vector * self._per_mass[:, 0]
        velocity = data.hg.vector * self._per_mass[:, 0]
        self.com_jacobian, self.momentum_jacobian = rates[:3], rates[3:]
        self.com_velocity, self.momentum = velocity[:3], velocity[3:]
        self.com_drift, self.momentum_drift = drift[:3], drift[3:]

    @property
    def inertia(self) -> np.ndarray:
        """Inertia of all links about the centre of mass, world axes [kg m^2], shape (3, 3)."""
        return self.data.oYcrb[0].inertia.copy()

    def hand_shift(self, pivot: np.ndarray) -> np.ndarray:
        r"""Return the shift of the balance by hand forces about a point on the ground [m], shape (2,).

        Moments about the pivot p, with forces F at the hands' places r, let the pendulum fall as one whose centre of
        mass c is shifted:

        .. math:: \ddot c = \omega^2 (c + \delta - p), \qquad
            \delta = \sum \frac{F_{xy} (r_z - p_z) - F_z (r_{xy} - p_{xy})}{m g}

        A payload shifts it towards itself, a pull towards where it pulls, by at most 0.25 m along each axis.

        Args:
            pivot: point in the world [m], shape (3,).
        """
        shift = np.zeros(2)
        if np.count_nonzero(self.hand_force):
            for side, force in zip(SIDES, self.hand_force, strict=True):
                arm = self.position(f"{side}_hand") - pivot
                shift += force[:2] * arm[2] - force[2] * arm[:2]
            shift /= self.mass * GRAVITY
        return np.minimum(np.maximum(shift, -_FARTHEST_SHIFT), _FARTHEST_SHIFT)

    def load(self, foot: int) -> float | None:
        """Return the measured normal force on the left (0) or right (1) foot [N]; None without foot sensors."""
        forces = None if self._state is None else self._state.foot_force
        return None if forces is None else float(forces[foot, 2])

    def point(self, name: str) -> np.ndarray:
        """Return the position of a frame's origin in the world [m], shape (3,).

        With `edge` above zero, heel and toe are on the lower edge of the sole.
        """
        origin, offset = self.position(name), self._edge_offset(name)
        return origin if offset is None else origin + offset

    def point_jacobian(self, name: str) -> np.ndarray:
        """Return the Jacobian of `point` in world axes, shape (3, nv)."""
        index, offset = self.frame_id(name), self._edge_offset(name)
        jacobian = pin.getFrameJacobian(self.model, self.data, index, pin.LOCAL_WORLD_ALIGNED)
        return jacobian[:3] if offset is None else jacobian[:3] - pin.skew(offset) @ jacobian[3:]

    def _edge_offset(self, name: str) -> np.ndarray | None:
        """Return the vector from the sole's centre line to its lower edge, world axes [m]; None for other points."""
        if self.edge == 0.0 or not name.endswith(_SOLE_ENDS):
            return None
        # Between the two edges the point moves linearly with the roll, so that it does not jump at zero roll.
        lateral = self.rotation(name)[:, 1]
        return -self.edge * min(max(lateral[2] / _EDGE_ROLL, -1.0), 1.0) * lateral

    def frame(self, name: str) -> FrameMotion:
        """Return a frame and its motion, computed once per update.

        The drift is the classical acceleration, since the spatial one lacks angular velocity x velocity.
        """
        try:
            return self._frames[name]
        except KeyError:
            index = self.frame_id(name)
            world = pin.LOCAL_WORLD_ALIGNED
            placement = self.data.oMf[index].homogeneous
            motion = FrameMotion(
                placement[:3, 3],
                placement[:3, :3],
                pin.getFrameJacobian(self.model, self.data, index, world),
                pin.getFrameVelocity(self.model, self.data, index, world).vector.copy(),
                pin.getFrameClassicalAcceleration(self.model, self.data, index, world).vector.copy(),
            )
            self._frames[name] = motion
        return motion


def pitch_of(rotation: np.ndarray) -> float:
    """Return the pitch of a frame with these axes in the world, shape (3, 3), positive with its front down [rad]."""
    return math.asin(min(max(-float(rotation[2, 0]), -1.0), 1.0))


class Predictor:
    """Carries a late reading to the time of the next command by integrating the accelerations commanded since.

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
        """Return the state `state.age` and a delay later, at most 0.03 s, as far as accelerations were recorded.

        Args:
            state: complete reading, with position and velocity.
            delay: time from now to the time of the returned state [s].
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

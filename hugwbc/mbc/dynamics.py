"""Dynamics of the free-floating H1 at one state: what the tasks and the QP read."""

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hugwbc.kinematics import Kinematics
from hugwbc.robot import SIDES, Robot
from hugwbc.state import GRAVITY, RobotState

_SOLE_ENDS = ("heel", "toe")
_FARTHEST_SHIFT = 0.25  # [m], by which forces on the hands may shift the balance
_EDGE_ROLL = 0.02  # [rad], roll of the sole from which on only its edge touches


class FrameMotion(NamedTuple):
    """A frame and its motion, in world axes.

    Attributes:
        position: origin of the frame [m], shape (3,).
        rotation: axes of the frame in the world, shape (3, 3).
        jacobian: Jacobian of the linear, then of the angular velocity, shape (6, nv).
        velocity: linear velocity [m/s], then angular velocity [rad/s], shape (6,).
        drift: acceleration at zero generalised acceleration, dJ/dt v [m/s^2], [rad/s^2], shape (6,).
    """

    position: np.ndarray
    rotation: np.ndarray
    jacobian: np.ndarray
    velocity: np.ndarray
    drift: np.ndarray


class Dynamics(Kinematics):
    """Mass matrix, bias, centroidal quantities and frame Jacobians, all computed by one `update`.

    Generalised velocities v follow Pinocchio: base linear and angular velocity in the base frame, then the joints.
    Equation of motion: M dv/dt + bias = S^T tau + sum J^T f.

    Attributes:
        mass: mass of the robot [kg].
        M: mass matrix with rotor inertia, shape (nv, nv).
        bias: Coriolis, centrifugal, gravity and joint friction terms, less the forces on the hands [N], [N m], shape
            (nv,).
        hand_force: force on the left and the right hand from outside, world axes [N], shape (2, 3); set it before
            `update`.
        com, com_velocity: position and velocity of the centre of mass in the world [m], [m/s], shape (3,).
        com_jacobian, com_drift: with d(com_velocity)/dt = com_jacobian dv/dt + com_drift; shapes (3, nv), (3,).
        momentum: angular momentum about the centre of mass, world axes [kg m^2/s], shape (3,).
        momentum_jacobian, momentum_drift: likewise for the angular momentum.
        edge: distance from the sole's centre line at which a rolled foot touches the ground [m]; 0 for the line itself.
    """

    def __init__(self, robot: Robot, model: pin.Model | None = None) -> None:
        """Use a copy of a robot's model, or another model with the same joints and frames."""
        super().__init__(robot, model)
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

        A payload shifts it towards itself, a pull towards where it pulls.

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

"""Forces on feet and hands inferred from joint torques: the H1 has no sensors for them.

The generalised momentum p = M(q) v of the robot changes by what is known (motors, gravity, Coriolis terms) and by what
is not: external forces. Its residual (De Luca and Mattone, "Actuator failure detection and isolation using generalized
momenta", ICRA 2003) is a first-order low-pass of the generalised external force:

    dr/dt = k (dp/dt - (tau + C^T v - g) - r) = k (M dv/dt + C v + g - tau - r)

The right-hand form takes one pass of recursive Newton-Euler, with dv/dt the difference quotient of two readings.

What the arms feel of it acts on the hands (`HandForceObserver`). Both feet share what the pelvis and the legs
feel by least squares, as if nothing touched the hands. Soles that move apart cannot both stand: the slower one, if it
has more load, then bears it all. Each sole is a narrow line: it transmits a force and the moments about its lateral
and its vertical axis.
"""

import math

import numpy as np
import pinocchio as pin
from eigenpy import LLT  # Pinocchio's: NumPy's `solve` takes longer to look at so small a matrix than to solve it

from hugwbc.kinematics import Kinematics, in_place
from hugwbc.robot import SIDES
from hugwbc.state import RobotState

_FEET = len(SIDES)
_WRENCH = 5  # numbers of a wrench: force, moments about y and z
_TRANSMITTED = [0, 1, 2, 4, 5, 6, 7, 8, 10, 11]  # of the twelve rows of both soles: all but the moment about x
_RIDGE = 1e-6  # keeps the least squares solvable where a straight leg transmits no force along itself

RATE = 180.0  # [1/s], bandwidth of the residual: the higher, the sooner an impact is seen, and the larger the noise
# Shares of the weight: normal force above which a foot that was in the air stands, and below which one that stood is in
# the air; the gap keeps noise from chattering.
_TOUCH, _LIFT = 0.1718, 0.1031
# Factor on the floating base's six rows of the residual; the legs' rows have 1. The pelvis feels what touches the hands
# as well: the more it counts, the more of a hand's push goes to the feet (at 1.0 the QP fell when a hand touched a
# post). The less it counts, the more errors of the legs' masses look like contacts.
BASE_WEIGHT = 0.3
# Speed of one sole against the other above which they do not both stand [m/s]: the faster one is in the air if it has
# less load, whatever the joints seem to feel of a leg whose mass is known wrongly. A foot that comes down is slower:
# what it seems to feel just before it touches lets the QP's steps end in time.
_PARTING = 1.0
# When a leg is in the air for certain, whatever the joints seem to feel: its sole moves, well above the other one.
_RAISED, _MOVES = 0.05, 0.3  # share of the leg's length, [m/s]
_FAMILIAR = 1.6e5  # [rad^2/s^4], sum of squared accelerations of a joint that counts as much as the robot's table
_BAND = 0.25  # share of a joint's inertia up to which what seems to be missing counts as noise
_LEAST, _MOST = -0.5, 4.0  # bounds on what can be missing, as shares of a joint's inertia
_HAND_RATE = 20.0  # [1/s], bandwidth of the hands' forces; noise of torques and joint velocities is mostly above it
_HAND_PRIOR = 60.0  # [N], standard deviation of a force on a hand before anything is known about it
_HAND_TORQUE = 0.3  # [N*m], the same of a joint's residual besides friction: motor constants, masses, zero positions


class HandForceObserver:
    """Estimate the force on each hand from outside, from the residual of the generalised momentum.

    The H1 has no sensors for it. The residual's rows of an arm's joints hold the force f on that hand alone:
    r = J^T f, with the hand's Jacobian J over these joints. Weighted least squares with a prior gives

        f = (J W J^T + 1 / s^2)^-1 J W r.

    The weights W are the inverse squares of what each joint leaves unknown. The largest part of it is Coulomb friction:
    the drive of a joint at rest holds any torque up to it, which motors do not show. The force of a still hand is known
    to about that friction divided by its lever arm, 2 to 3 N on the H1. The prior s suppresses directions that an arm
    cannot feel, such as along a stretched arm.

    A force is taken to act at the hand frame. One that acts elsewhere on the forearm counts as the force at the hand
    that loads the joints alike.

    Attributes:
        force: force on the left and the right hand, world frame [N], shape (2, 3).
    """

    def __init__(self, kinematics: Kinematics) -> None:
        """Set up for the robot of a kinematics, whose joint Jacobians are current whenever `infer` is called."""
        self._kinematics, robot = kinematics, kinematics.robot
        self._hands = [kinematics.frame_id(f"{side}_hand") for side in SIDES]
        joints = robot.arms.reshape(len(SIDES), -1)
        self._arms = [in_place(columns) for columns in kinematics.columns[joints]]
        self._weights = 1.0 / (robot.friction[joints] ** 2 + _HAND_TORQUE**2)
        self._prior = np.eye(3) / _HAND_PRIOR**2
        self.reset()

    def reset(self) -> None:
        """Forget the past: nothing is in the hands."""
        self.force = np.zeros((len(SIDES), 3))

    def infer(self, residual: np.ndarray, dt: float) -> None:
        """Take in the residual of one reading [N, N*m], shape (6 + n,), `dt` [s] after the last one."""
        model, data = self._kinematics.model, self._kinematics.data
        share = 1.0 - math.exp(-_HAND_RATE * dt)
        self.force = self.force.copy()
        for force, hand, arm, weights in zip(self.force, self._hands, self._arms, self._weights, strict=True):
            jacobian = pin.getFrameJacobian(model, data, hand, pin.LOCAL_WORLD_ALIGNED)[:3, arm]
            weighted = jacobian * weights
            felt = LLT(weighted.dot(jacobian.T) + self._prior).solve(weighted.dot(residual[arm]))
            force += share * (felt - force)


class SwingInertia:
    r"""Learns how much inertia of the legs was not told, from their swings: a table of a robot is never quite right.

    Nothing but wrong inertia should be left in the residual of a leg in the air: most of all the reflected inertia of
    its drives, which makers seldom state. Told 0.01 instead of 0.16 kg m^2 at the knee, an H1 feels a load of 110 N on
    its swinging foot. What is missing counts as inertia :math:`\delta` of each joint alone,

    .. math:: r = -\delta\, \ddot q,

    the same on both sides, and is fitted with a prior at zero. The planned acceleration is the instrument of the fit:
    noise of the measured one, which the residual has as well, would look like inertia.

    Attributes:
        missing: inertia at hip pitch, knee and ankle pitch that the table seems to lack [kg m^2], shape (3,).
        untold: the part of it that counts, by joint [kg m^2], shape (n,); None until something has counted.
    """

    def __init__(self, kinematics: Kinematics) -> None:
        """Learn the legs of a kinematics, whose model gets what is learnt."""
        robot, self._kinematics = kinematics.robot, kinematics
        self._joints = np.array([robot.pair(part) for part in ("hip_pitch", "knee", "ankle_pitch")]).T
        self._columns = kinematics.columns[self._joints]
        q = pin.neutral(kinematics.model)
        q[kinematics.columns + 1] = robot.nominal
        self._inertia = np.diagonal(pin.crba(kinematics.model, kinematics.data, q))[self._columns[0]]
        self.reset()

    def reset(self) -> None:
        """Believe the table."""
        self.missing, self._counted, self._told, self._seen = np.zeros((4, 3))
        self._count(None)

    def _count(self, untold: np.ndarray | None) -> None:
        self.untold = untold
        self._kinematics.add_inertia(untold)

    def learn(self, foot: int, acceleration: np.ndarray, residual: np.ndarray, planned: np.ndarray) -> None:
        """Take in one reading of a leg that is in the air.

        Args:
            foot: 0 for left, 1 for right.
            acceleration: measured generalised acceleration [rad/s^2], shape (nv,).
            residual: of the generalised momentum [N m], shape (nv,).
            planned: acceleration of the joints that the controller plans [rad/s^2], shape (n,).
        """
        columns, plan = self._columns[foot], planned[self._joints[foot]]
        moved = acceleration[columns]
        self._seen += plan * moved
        self._told += plan * (self._counted * moved - residual[columns])
        missing = self._told / (_FAMILIAR + np.maximum(self._seen, 0.0))
        self.missing = np.minimum(np.maximum(missing, _LEAST * self._inertia), _MOST * self._inertia)
        counted = np.where(np.abs(self.missing) > _BAND * self._inertia, self.missing, 0.0)
        if (counted != self._counted).any():
            self._counted, untold = counted, np.zeros(self._kinematics.columns.size)
            untold[self._joints] = counted
            self._count(untold)


class ContactObserver:
    """Estimate both feet's ground reactions and contacts from joint torques and motion.

    Attributes:
        residual: generalised external force [N, N*m], shape (6 + n,): on the base in the pelvis frame, then on joints.
        force: ground reaction on each foot, world frame [N], shape (2, 3).
        contact: which feet stand, shape (2,), bool.
        hands: the observer of the forces on the hands.
        inertia: what it learns of the legs.
        sole_jacobians: of the last reading, linear, then angular velocity in world axes, shape (2, 6, 6 + n).
        sole_velocity: of the last reading [m/s, rad/s], shape (2, 6).
    """

    def __init__(self, kinematics: Kinematics, base_weight: float = BASE_WEIGHT) -> None:
        """Set up for the robot of a kinematics, which the owner places before each `infer`; call `reset` first.

        The frames and Jacobians of the kinematics are left at the last reading.
        """
        self._kinematics = kinematics
        self.inertia = SwingInertia(kinematics)
        model, robot = kinematics.model, kinematics.robot
        self._columns = in_place(self._kinematics.columns)
        self._robot, self._raised = robot, _RAISED * robot.leg_length
        self._touch, self._lift = _TOUCH * robot.weight, _LIFT * robot.weight
        self.hands = HandForceObserver(self._kinematics)
        self._soles = [self._kinematics.frame_id(f"{side}_sole") for side in SIDES]
        legs = self._kinematics.columns[robot.legs]
        self._rows = in_place(np.concatenate((np.arange(6), legs)))
        self._weight = np.concatenate((np.full(6, base_weight), np.ones(legs.size)))
        self._tau, self._still = np.zeros(model.nv), np.zeros(model.nv)
        self._ridge = _RIDGE * np.eye(_FEET * _WRENCH)
        self.sole_jacobians = np.zeros((_FEET, 6, model.nv))
        self.sole_velocity = np.zeros((_FEET, 6))
        self.reset(None)

    def reset(self, state: RobotState | None) -> None:
        """Forget the past; both feet are taken to stand, with half of the weight each."""
        self.force = np.tile((0.0, 0.0, 0.5 * self._robot.weight), (_FEET, 1))
        self.contact = np.ones(_FEET, dtype=bool)
        self.residual = np.zeros(self._kinematics.model.nv)
        self._velocity = np.zeros(self._kinematics.model.nv)
        self.hands.reset()
        self.inertia.reset()
        if state is not None:
            self._kinematics.place(state)
            self._move(self._still)
            self._velocity = self._kinematics.v.copy()
            # The residual of a stand at rest: what carries the weight, as the legs tell it.
            self.residual = np.concatenate([(*force, 0.0, 0.0) for force in self.force]) @ self._wrench_jacobians()

    def infer(self, torque: np.ndarray, dt: float, planned: np.ndarray | None = None) -> np.ndarray:
        """Take in one reading, at whose state the kinematics has been placed; return which feet stand, (2,), bool.

        Args:
            torque: joint torques, averaged since the last reading [N*m], shape (n,).
            dt: time since the last reading [s].
            planned: joint accelerations that the controller planned for that time [rad/s^2], shape (n,). Without them
                nothing is learnt of the legs.
        """
        kinematics = self._kinematics
        v = kinematics.v
        acceleration = (v - self._velocity) / dt if dt > 0.0 else self._still
        motion = self._move(acceleration)
        self._velocity = v.copy()
        if dt > 0.0:
            # Motors measure their own torque, of which friction takes a part before it reaches the link.
            friction = self._robot.friction_torque(v[self._columns])
            self._tau[self._columns] = torque - friction
            share = 1.0 - math.exp(-RATE * dt)
            self.residual = self.residual + share * (motion - self._tau - self.residual)
            if planned is not None:
                self._learn(acceleration, planned)
        self.hands.infer(self.residual, dt)
        jacobians = self._wrench_jacobians()
        wrenches, felt = self._weight * jacobians[:, self._rows], self._weight * self.residual[self._rows]
        normal = wrenches.dot(wrenches.T) + self._ridge
        self.force = LLT(normal).solve(wrenches.dot(felt)).reshape(_FEET, _WRENCH)[:, :3]
        left, right = self.sole_velocity[:, :3]
        parting, loaded = left - right, int(self.force[1, 2] > self.force[0, 2])
        # The residual shows the load of a leg for some milliseconds after its lift-off: the faster sole then has more.
        slower = int(right.dot(right) < left.dot(left))
        if loaded == slower and parting.dot(parting) > _PARTING**2:
            rows = slice(_WRENCH * loaded, _WRENCH * (loaded + 1))
            self.force = np.zeros((_FEET, 3))
            self.force[loaded] = LLT(normal[rows, rows]).solve(wrenches[rows].dot(felt))[:3]
        self.contact = self.force[:, 2] > self._touch - (self._touch - self._lift) * self.contact
        return self.contact

    def _learn(self, acceleration: np.ndarray, planned: np.ndarray) -> None:
        """Learn the inertia of a leg that is in the air for certain."""
        left, right = (float(self._kinematics.data.oMf[sole].translation[2]) for sole in self._soles)
        if abs(left - right) > self._raised:
            foot = int(right > left)
            velocity = self.sole_velocity[foot, :3]
            if velocity.dot(velocity) > _MOVES**2:
                self.inertia.learn(foot, acceleration, self.residual, planned)

    def _move(self, acceleration: np.ndarray) -> np.ndarray:
        """Return the generalised forces of a motion [N, N*m], shape (6 + n,); compute frames, Jacobians and soles."""
        kinematics = self._kinematics
        model, data, q, v = kinematics.model, kinematics.data, kinematics.q, kinematics.v
        forces = pin.rnea(model, data, q, v, acceleration).copy()
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        for jacobian, sole in zip(self.sole_jacobians, self._soles, strict=True):
            jacobian[:] = pin.getFrameJacobian(model, data, sole, pin.LOCAL_WORLD_ALIGNED)
        self.sole_velocity = self.sole_jacobians @ v
        return forces

    def _wrench_jacobians(self) -> np.ndarray:
        """Return the rows from forces in the world and moments in a sole's axes to generalised forces, (10, 6 + n)."""
        jacobians = self.sole_jacobians.copy()
        for jacobian, sole in zip(jacobians, self._soles, strict=True):
            jacobian[3:] = self._kinematics.data.oMf[sole].rotation.T.dot(jacobian[3:])
        return jacobians.reshape(-1, self._tau.size)[_TRANSMITTED]

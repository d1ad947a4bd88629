"""The servo of the arms: gains and feed-forward torque for arms under external control, the same for every controller.

A feed-forward torque from the equation of motion makes the arm follow without the sag and lag of a PD law alone:

    tau = RNEA(q, v, a) + friction(dq_d),    torque at the joint = tau + kp (q_d - q) + kd (dq_d - dq),

with RNEA the recursive Newton-Euler algorithm (Featherstone, "Rigid Body Dynamics Algorithms", 2008) of the whole robot
at the commanded positions, velocities and accelerations of the arms. This is the usual computed-torque feed-forward of
a manipulator; Unitree's own teleoperation of the H1 has the same form (`xr_teleoperate`, `H1_ArmController`).

Forces f on the hands (`HandWrench`) are fed forward as torques -J^T f with the hand's Jacobian J over the arm's joints:
the weight of what a hand carries, and the force that it should meet. A wanted stiffness k of the hand [N/m] makes the
joints the spring

    K = k J^T J,

whose hand moves by f / k under a force f (Salisbury, "Active stiffness control of a manipulator in Cartesian
coordinates", CDC 1980). The drives hold its diagonal, the feed-forward torque the rest. A hand that should exert a
force gives way along it, and nowhere else (Raibert and Craig, "Hybrid position/force control of manipulators", 1981):
of the spring's torque K (q_d - q), the part that acts on the hand along the force is taken away.
"""

import math

import numpy as np
import pinocchio as pin

from hugwbc.controller import UpperBody
from hugwbc.hand_wrench import FREE
from hugwbc.kinematics import Kinematics
from hugwbc.numeric import changed
from hugwbc.robot import SIDES, Robot
from hugwbc.state import RobotState

_STIFFEST = 1e-4  # [m/N], added to the compliance of pressing hands before it is inverted: they get at most 1e4 N/m
_SOLVABLE = 1e-8  # [m/N], added to the compliance of a stretched arm so that it can be inverted
_BALANCED = 0.02  # two forces squeeze something if their sum is a smaller part than this of the sum of their lengths

# [N*m/rad] of every joint of an arm whose hand has a stiffness, besides that of the hand: it holds the elbow, which may
# turn about the line from shoulder to hand.
POSTURE_STIFFNESS = 5.0
# [m] from its target up to which a hand gives way to the force that it should exert. Further away the servo's spring
# holds it, so that a hand that meets nothing stops.
GIVE = 0.08


class ArmServo:
    """The low-level control of arms under external control.

    It turns the target motion of the arms into all five numbers that a joint drive takes. Its feed-forward torque
    carries the weight of the arms on the pelvis as it is tilted and turns now, and accelerates them as commanded. It
    has no memory: equal targets and states give equal commands.

    The acceleration of the pelvis is not known to every controller and is left to the gains. Therefore `UpperBody.ddq`
    must not contain corrections for a body that sways: an arm whose base accelerates stays behind by its own inertia.
    A torque for that motion would move it twice as far, and its reaction would drive the sway.

    Attributes:
        robot: the robot whose arms, of k joints together, it moves, with the gains `Robot.arm_kp` and `Robot.arm_kd`.
    """

    def __init__(self, robot: Robot) -> None:
        """Set up the servo for a robot with the friction of its drives."""
        self.robot = robot
        self._arms = self.robot.arms
        self._limit = self.robot.torque_limit[self._arms]
        self._kinematics = kinematics = Kinematics(self.robot)
        self._model, self._data, self._a = kinematics.model, kinematics.data, np.zeros(kinematics.model.nv)
        self._columns = kinematics.columns[self._arms]
        self._hands = [kinematics.frame_id(f"{side}_hand") for side in SIDES]

    def friction(self, dq_arm: np.ndarray) -> np.ndarray:
        """Return the friction of the robot's drives at the commanded speeds dq_arm (..., k) [rad/s]: [N*m], (..., k).

        The commanded speed stands for the measured one, whose noise would change the sign all the time.
        """
        speeds = np.zeros((*dq_arm.shape[:-1], len(self.robot.joint_names)))
        speeds[..., self._arms] = dq_arm
        return self.robot.friction_torque(speeds)[..., self._arms]

    def __call__(self, upper_body: UpperBody, state: RobotState, dt: float) -> UpperBody:
        """Return the targets with the servo's gains and feed-forward torque.

        Two torques are added to it: that of the targets (`UpperBody.tau`), and the one against the wrench on the hands.
        The positions lead by half a control period: the command is held for the whole period, and is right in its
        middle.

        Args:
            upper_body: targets of the arms; joints outside of its mask count as moving as they were measured.
            state: the robot now, which must be usable (`RobotState.is_usable`).
            dt: control period [s].
        """
        if not upper_body.indicator:
            return upper_body
        if not upper_body.mask.all():  # joints outside of the mask have no targets
            given = ((upper_body.q, state.q[self._arms]), (upper_body.dq, state.dq[self._arms]), (upper_body.ddq, 0.0))
            q, dq, ddq = (np.where(upper_body.mask, *each) for each in given)
            upper_body = changed(upper_body, q=q, dq=dq, ddq=ddq)
        tau = self.torque(upper_body.q, state, upper_body.dq, upper_body.ddq) + self.friction(upper_body.dq)
        kp, released = self.robot.arm_kp, 0.0
        if upper_body.wrench is not FREE:
            loads, released, kp = self._loads(upper_body, state)
            tau = tau + loads
        tau = np.minimum(np.maximum(tau + upper_body.tau, -self._limit), self._limit)
        # The springs' torques are taken away by shifting their targets: as torques they might exceed the limits.
        q = upper_body.q + 0.5 * dt * upper_body.dq + released / kp
        return changed(upper_body, q=q, tau=tau, kp=kp, kd=self.robot.arm_kd)

    def jacobians(self, q_arm: np.ndarray, state: RobotState) -> np.ndarray:
        """Return how both hands move with the joints of both arms at `q_arm` [rad], world axes [m/rad], (2, 3, k)."""
        self._place(q_arm, state)
        pin.computeJointJacobians(self._model, self._data, self._kinematics.q)
        pin.updateFramePlacements(self._model, self._data)
        return np.array(
            [
                pin.getFrameJacobian(self._model, self._data, hand, pin.LOCAL_WORLD_ALIGNED)[:3, self._columns]
                for hand in self._hands
            ]
        )

    def _loads(self, upper_body: UpperBody, state: RobotState) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return torques against the wrench, those that free pressing hands [N*m], and the drives' kp, each (k,)."""
        wrench, jacobians = upper_body.wrench, self.jacobians(upper_body.q, state)
        error = np.where(upper_body.mask, upper_body.q - state.q[self._arms], 0.0)
        springs = np.diag(self.robot.arm_kp)
        if wrench.stiffness is not None:
            springs = self._springs(jacobians, wrench.stiffness)
        kp = springs.diagonal().copy()
        tau = (springs - np.diag(kp)) @ error - np.einsum("hij,hi->j", jacobians, wrench.total)
        free = _free_directions(wrench.force)
        released = np.zeros(self._arms.size)
        if free.size:
            both = jacobians.reshape(-1, self._arms.size)
            released = both.T @ self._released(both, springs, error, free)
        return tau, released, kp

    def _released(self, jacobian: np.ndarray, springs: np.ndarray, error: np.ndarray, free: np.ndarray) -> np.ndarray:
        r"""Return the forces at both hands that take the springs away along the free directions [N], shape (6,).

        With the hands' stiffness :math:`S = (J K^{-1} J^T)^{-1}`, their distance x from the targets and the projector
        P across the free directions, the springs pull by S x, and they should pull by P S P x. Hands that are farther
        than `GIVE` from their targets along a free direction are pulled back along it.

        Args:
            jacobian: of both hands, shape (6, k).
            springs: stiffness of the joints [N*m/rad], shape (k, k).
            error: distance of the joints to their targets [rad], shape (k,).
            free: directions in which the hands give way, orthonormal, shape (m, 6).
        """
        compliance, unit = jacobian @ np.linalg.solve(springs, jacobian.T), np.eye(len(jacobian))
        away = jacobian @ error
        # The springs' pull is taken away exactly. The pull in its place must stay small for a stretched arm, which
        # holds its hand nearly rigidly along its length.
        pulled = np.linalg.solve(compliance + _SOLVABLE * unit, away)
        stiffness = np.linalg.inv(compliance + _STIFFEST * unit)
        along = free @ away
        across = away - along @ free
        held = stiffness @ across
        held -= (free @ held) @ free
        beyond = along - np.minimum(np.maximum(along, -GIVE), GIVE)
        returning = np.einsum("ki,ij,kj,k->k", free, stiffness, free, beyond)
        return held + returning @ free - pulled

    def _springs(self, jacobians: np.ndarray, stiffness: float) -> np.ndarray:
        """Return the joints' stiffness that makes both hands springs, at most the servo's own [N*m/rad], (k, k)."""
        springs = np.zeros((self._arms.size, self._arms.size))
        for own, jacobian in zip(np.arange(self._arms.size).reshape(len(SIDES), -1), jacobians, strict=True):
            spring = stiffness * jacobian[:, own].T @ jacobian[:, own]
            posture = np.minimum(self.robot.arm_kp[own], POSTURE_STIFFNESS)
            room = self.robot.arm_kp[own] - posture
            spring = spring * min(1.0, float((room / np.maximum(spring.diagonal(), 1e-9)).min()))
            springs[np.ix_(own, own)] = spring + np.diag(posture)
        return springs

    def torque(
        self,
        q_arm: np.ndarray,
        state: RobotState,
        dq_arm: np.ndarray | None = None,
        ddq_arm: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the torques that move the arms on this body as given, without friction [N*m], shape (k,).

        Args:
            q_arm: positions of the arm joints [rad], shape (k,).
            state: the robot now; its arms are replaced by the given ones.
            dq_arm: velocities [rad/s], shape (k,); None for arms and body at rest.
            ddq_arm: accelerations [rad/s^2], shape (k,); None for none.
        """
        self._place(q_arm, state, dq_arm)
        q, v = self._kinematics.q, self._kinematics.v
        if dq_arm is None:
            return pin.computeGeneralizedGravity(self._model, self._data, q)[self._columns]
        self._a[self._columns] = 0.0 if ddq_arm is None else ddq_arm
        return pin.rnea(self._model, self._data, q, v, self._a)[self._columns]

    def _place(self, q_arm: np.ndarray, state: RobotState, dq_arm: np.ndarray | None = None) -> None:
        q, dq = state.q.copy(), state.dq.copy()
        q[self._arms], dq[self._arms] = q_arm, 0.0 if dq_arm is None else dq_arm
        self._kinematics.place_joints(q, dq)
        # A constant linear velocity of the base needs no torque, so it may be left at zero.
        self._kinematics.place_pelvis(state.orientation, state.angular_velocity, None, None)


def _free_directions(force: np.ndarray) -> np.ndarray:
    """Return the m directions in which hands give way: unit vectors of both hands together, shape (m, 6).

    Each hand with a force, world axes [N], shape (2, 3), gives way along it. Two hands whose forces balance each other
    give way against each other only: their middle is held, or what they squeeze would drift off.
    """
    lengths = np.sqrt((force * force).sum(axis=1))
    pressing = [hand for hand in range(len(SIDES)) if lengths[hand] > 0.0]
    directions = np.zeros((len(pressing), len(SIDES), 3))
    for row, hand in enumerate(pressing):
        directions[row, hand] = force[hand] / lengths[hand]
    total = force.sum(axis=0)
    if len(pressing) == len(SIDES) and math.sqrt(total @ total) < _BALANCED * lengths.sum():
        directions = directions.sum(axis=0, keepdims=True) / math.sqrt(2.0)
    return directions.reshape(-1, 3 * len(SIDES))

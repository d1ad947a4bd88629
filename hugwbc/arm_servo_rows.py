"""The servo of the arms for many robots at once, such as those of a training: row i equals `ArmServo` of robot i.

Both arms of all robots go through the recursive Newton-Euler algorithm together, from the torso outwards and back
(Featherstone, "Rigid Body Dynamics Algorithms", 2008, here with classical accelerations in the links' own frames):

    w_k = R_k^T w + s_k dq_k,            dw_k = R_k^T dw + (R_k^T w) x s_k dq_k + s_k ddq_k,
    a_k = R_k^T (a + dw x p_k + w x (w x p_k)),
    F_k = m_k (a_k + dw_k x c_k + w_k x (w_k x c_k)),     N_k = I_k dw_k + w_k x I_k w_k,
    f_k = F_k + R_k+1 f_k+1,             n_k = N_k + c_k x F_k + R_k+1 n_k+1 + p_k+1 x R_k+1 f_k+1,
    tau_k = s_k . n_k + J_k ddq_k,

with the rotation R_k from link k to its parent, the joint's place p_k in the parent and its axis s_k, mass m_k, centre
of mass c_k and inertia I_k of the link, and the reflected inertia J_k of its drive. w, dw and a without an index are
those of the parent.
"""

from typing import NamedTuple

import numpy as np

from hugwbc import rotations
from hugwbc.arm_servo import ArmServoConfig, ServoOfArms, hand_loads
from hugwbc.kinematics import pinocchio_model
from hugwbc.robot import SIDES, Robot
from hugwbc.state import GRAVITY

_JOINTS = 4  # of an arm


class _Joint(NamedTuple):
    """Constants of one joint and the link that it moves, of both arms; vectors have the shape (3, 2, 1).

    Attributes:
        mount: rotation from the joint's frame at angle 0 to the parent's, shape (3, 3, 2, 1).
        place: origin in the parent's frame [m].
        axis: unit vector in the joint's own frame.
        mass: of the link [kg], shape (2, 1).
        centre: its centre of mass [m].
        inertia: about the centre of mass [kg m^2], shape (3, 3, 2, 1).
        armature: reflected inertia of the drive [kg m^2], shape (2, 1).
    """

    mount: np.ndarray
    place: np.ndarray
    axis: np.ndarray
    mass: np.ndarray
    centre: np.ndarray
    inertia: np.ndarray
    armature: np.ndarray


class _Motion(NamedTuple):
    """Motion of a link in its own frame, of both arms of n robots, each of shape (3, 2, n).

    Attributes:
        rate: angular velocity [rad/s].
        rate_change: angular acceleration [rad/s^2].
        acceleration: of the origin, minus gravity [m/s^2].
    """

    rate: np.ndarray
    rate_change: np.ndarray
    acceleration: np.ndarray


class _Turn:
    """Rotation by the angles of one joint, between the frames of a link and its parent."""

    def __init__(self, joint: _Joint, angle: np.ndarray) -> None:
        self._mount, self._axis = joint.mount, joint.axis
        self._cos, self._sin = np.cos(angle), np.sin(angle)

    def outwards(self, vector: np.ndarray) -> np.ndarray:
        return self._rotate(_product(self._mount.swapaxes(0, 1), vector), -self._sin)

    def inwards(self, vector: np.ndarray) -> np.ndarray:
        return _product(self._mount, self._rotate(vector, self._sin))

    def _rotate(self, vector: np.ndarray, sin: np.ndarray) -> np.ndarray:
        """Rodrigues' formula."""
        along = self._axis * (self._axis * vector).sum(axis=0)
        return along + self._cos * (vector - along) + sin * _cross(self._axis, vector)


class ArmServoRows(ServoOfArms):
    """Feed-forward torques and position targets of the arms of n robots. It has no memory.

    All arrays are NumPy's; a tensor on the CPU shares its memory with one by `tensor.numpy()`. A call for 1,024 robots
    takes about 5 ms of processor time, so it may be made in every control step of a training. The torque then belongs
    to the state at the beginning of the step, as it does for a controller that is called as often.
    """

    def __init__(self, config: ArmServoConfig | None = None, robot: Robot | None = None) -> None:
        """Set up the servo; arguments as in `ServoOfArms`."""
        super().__init__(config, robot)
        names = np.array(self.robot.arm_names).reshape(len(SIDES), _JOINTS)
        waist = self.robot.joint_names[self.robot.waist]
        self._waist = self._joint([waist, waist])
        self._hand = self.robot.hand.reshape(3, 1, 1)  # the same in both forearms
        self._chain = [self._joint(names[:, joint].tolist()) for joint in range(_JOINTS)]

    def _joint(self, names: list[str]) -> _Joint:
        """Read the constants of a left and a right joint from the model of the single robot."""
        model = pinocchio_model(self.robot)
        ids = [model.getJointId(name) for name in names]
        placements, inertias = [model.jointPlacements[i] for i in ids], [model.inertias[i] for i in ids]

        def pair(values: list[np.ndarray]) -> np.ndarray:
            return np.stack(values, axis=-1)[..., None]

        return _Joint(
            mount=pair([placement.rotation for placement in placements]),
            place=pair([placement.translation for placement in placements]),
            axis=pair([self.robot.axes[self.robot.index(name)] for name in names]),
            mass=np.array([[inertia.mass] for inertia in inertias]),
            centre=pair([inertia.lever for inertia in inertias]),
            inertia=pair([inertia.inertia for inertia in inertias]),
            armature=np.array([[model.armature[model.joints[i].idx_v]] for i in ids]),
        )

    def __call__(
        self,
        q_arm: np.ndarray,
        dq_arm: np.ndarray,
        qpos: np.ndarray,
        qvel: np.ndarray,
        dt: float,
        ddq_arm: np.ndarray | None = None,
        hand_force: np.ndarray | None = None,
        payload: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return position targets [rad] and feed-forward torques [N*m] of the arms, shapes (n, 8), as `ArmServo` does.

        The drives complete the torque: tau + kp (q - q_measured) + kd (dq_arm - dq_measured). A drive that takes a
        position alone, as those of `BatchSimulation` do, gets it from `position_targets`.

        Args:
            q_arm: target positions of the arm joints [rad], shape (n, 8).
            dq_arm: target velocities [rad/s], shape (n, 8).
            qpos: positions of the robots, as in `BatchSimulation`, shape (n, 26).
            qvel: velocities, likewise, shape (n, 25).
            dt: control period [s].
            ddq_arm: accelerations of the planned motion [rad/s^2], shape (n, 8); None for none.
            hand_force: force that the hands shall exert, world axes [N], shape (n, 2, 3); None for none. Here the hands
                do not give way along it.
            payload: mass that each hand carries [kg], shape (n, 2); None for none.
        """
        carried = None
        if hand_force is not None or payload is not None:
            wanted = np.zeros((len(q_arm), len(SIDES), 3)) if hand_force is None else hand_force
            carried = hand_loads(wanted, payload)
        tau = self.torque(q_arm, qpos, qvel, dq_arm, ddq_arm, carried) + self.friction(dq_arm)
        tau = np.clip(tau, -self._limit, self._limit)
        q = q_arm + 0.5 * dt * dq_arm
        bad = ~(np.isfinite(tau).all(axis=1) & np.isfinite(q).all(axis=1))
        tau[bad], q[bad] = 0.0, q_arm[bad]
        return q, tau

    def position_targets(self, q: np.ndarray, dq_arm: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return position targets that give drives with the gains `kp` and `kd` the whole torque [rad], shape (n, 8).

        Args:
            q: position targets [rad], shape (n, 8).
            dq_arm: target velocities [rad/s], shape (n, 8).
            tau: feed-forward torques [N*m], shape (n, 8).
        """
        return q + (tau + self.kd * dq_arm) / self.kp

    def torque(
        self,
        q_arm: np.ndarray,
        qpos: np.ndarray,
        qvel: np.ndarray,
        dq_arm: np.ndarray | None = None,
        ddq_arm: np.ndarray | None = None,
        carried: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the torques that move the arms as given, without friction [N*m], shape (n, 8).

        Args:
            q_arm: positions of the arm joints [rad], shape (n, 8).
            qpos: positions of the robots, shape (n, 26); their arms are replaced by the given ones.
            qvel: velocities, likewise, shape (n, 25).
            dq_arm: velocities [rad/s], shape (n, 8); None for arms and body at rest.
            ddq_arm: accelerations [rad/s^2], shape (n, 8); None for none.
            carried: force that the hands exert, payloads included, world axes [N], shape (n, 2, 3); None for none.
        """
        count, column = len(q_arm), 7 + self.robot.waist
        up = rotations.rotate_inverse(qpos[:, 3:7], np.broadcast_to([0.0, 0.0, GRAVITY], (count, 3)))
        still = dq_arm is None
        rate = np.zeros((count, 3)) if still else qvel[:, 3:6]
        waist_rate = np.zeros(count) if still else qvel[:, column - 1]
        pelvis = _Motion(_both(rate), np.zeros((3, 2, count)), _both(up))
        turn = _Turn(self._waist, qpos[:, column])
        link = _carried(self._waist, turn, pelvis, waist_rate, np.zeros(count))
        q, dq, ddq = (_by_joint(np.zeros((count, 8)) if v is None else v) for v in (q_arm, dq_arm, ddq_arm))
        turns, links = [], []
        for joint, angle, speed, change in zip(self._chain, q, dq, ddq, strict=True):
            turns.append(_Turn(joint, angle))
            link = _carried(joint, turns[-1], link, speed, change)
            links.append(link)
        tau = np.empty((_JOINTS, len(SIDES), count))
        force = moment = np.zeros((3, len(SIDES), count))  # on the next link, in this one's frame
        if carried is not None:
            force = np.stack(
                [rotations.rotate_inverse(qpos[:, 3:7], carried[:, hand]).T for hand in range(len(SIDES))], 1
            )
            for outer in (turn, *turns):
                force = outer.outwards(force)
            moment = _cross(self._hand, force)
        for k in reversed(range(_JOINTS)):
            joint = self._chain[k]
            own_force, own_moment = _wrench(joint, links[k])
            force, moment = own_force + force, own_moment + moment
            tau[k] = (joint.axis * moment).sum(axis=0) + joint.armature * ddq[k]
            force, moment = turns[k].inwards(force), turns[k].inwards(moment)
            moment = moment + _cross(joint.place, force)
        return tau.transpose(2, 1, 0).reshape(count, -1)


def _carried(joint: _Joint, turn: _Turn, parent: _Motion, speed: np.ndarray, change: np.ndarray) -> _Motion:
    """Return the motion of a link whose joint moves at a speed and acceleration of shape (2, n)."""
    rate, own = turn.outwards(parent.rate), joint.axis * speed
    swing = _cross(parent.rate, _cross(parent.rate, joint.place)) + _cross(parent.rate_change, joint.place)
    return _Motion(
        rate + own,
        turn.outwards(parent.rate_change) + _cross(rate, own) + joint.axis * change,
        turn.outwards(parent.acceleration + swing),
    )


def _wrench(joint: _Joint, link: _Motion) -> tuple[np.ndarray, np.ndarray]:
    """Return force [N] and moment [N*m] about the joint that move a link, in its frame, shapes (3, 2, n)."""
    swing = _cross(link.rate_change, joint.centre) + _cross(link.rate, _cross(link.rate, joint.centre))
    force = joint.mass * (link.acceleration + swing)
    spin = _product(joint.inertia, link.rate_change) + _cross(link.rate, _product(joint.inertia, link.rate))
    return force, spin + _cross(joint.centre, force)


def _both(vectors: np.ndarray) -> np.ndarray:
    """Return vectors (n, 3) for both arms, shape (3, 2, n)."""
    return np.repeat(vectors.T[:, None], len(SIDES), axis=1)


def _by_joint(values: np.ndarray) -> np.ndarray:
    """Return values of the arm joints (n, 8) by joint, arm and robot, shape (4, 2, n)."""
    by_joint = np.asarray(values, dtype=float).reshape(-1, len(SIDES), _JOINTS).transpose(2, 1, 0)
    return np.ascontiguousarray(by_joint)  # NumPy is fastest along whole rows of robots


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product along the first axis; several times faster than NumPy's own."""
    return np.stack((a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]))


def _product(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Multiply matrices (3, 3, 2, 1) by vectors (3, 2, n)."""
    return matrix[:, 0] * vector[0] + matrix[:, 1] * vector[1] + matrix[:, 2] * vector[2]

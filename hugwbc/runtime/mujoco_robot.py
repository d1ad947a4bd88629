"""A robot in somebody else's MuJoCo model: found by its joint names, told to controllers, and driven.

Model and data belong to a gymnasium task, a benchmark or a scene of a laboratory, which makes the physics steps too
(docs/how-to/use-your-own-simulator.md).
"""

import dataclasses
from collections import Counter
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin

from hugwbc import rotations
from hugwbc.commands import Command
from hugwbc.controller import Controller, JointCommand
from hugwbc.description import CORNERS, outline
from hugwbc.errors import ConfigError, ModelError
from hugwbc.kinematics import pinocchio_model
from hugwbc.numeric import frozen
from hugwbc.robot import SIDES, Robot, load_robot, on_both_sides
from hugwbc.runtime.control_period import ControlPeriod
from hugwbc.runtime.sight import Sight
from hugwbc.scripts.view import CommandSource, Constant, Grip
from hugwbc.sim.scenes.objects import Picture, force_on_second
from hugwbc.state import RobotState
from hugwbc.upper_ik import UpperBodySource

_FARTHEST, _LEAST_ALIGNED = 0.01, 0.99  # [m] and cosine between a joint's axis in the model and in the description
_FLAT = 0.005  # [m], height over the lowest point up to which a foot is its sole
_PAUSE = 0.5  # [s] between two inputs, from which on nobody controlled the robot
_POSE, _TWIST = 7, 6  # numbers of a free joint: position and quaternion; linear and angular velocity
# What a body is: left or right foot (0, 1), left or right hand (2, 3), another link, or none of the robot's.
_HANDS, _LINK, _OBJECT = 2, 4, 5


class MujocoRobot:
    """One robot in a MuJoCo model, and the objects around it: a `World` of `hugwbc.runtime.sight`.

    Attributes:
        robot: what controllers are told: names, gains and lengths of the description; masses, inertias, ranges, torque
            limits, armature, damping, friction, delay, soles and hands of the model.
        prefix: what the model puts before the names of the joints.
        extra_joints: the robot's joints that the description does not have, such as fingers; they count as rigid.
        names: names of the bodies that are not the robot's.
        actuators: places of the joints' inputs in `data.ctrl`, in the order of `Robot.joint_names`, shape (n,).
        clipped: how often the actuator of a joint could not give the torque that a command asked for.
        problems: what went wrong, such as a request to a gripper, of which there are none.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        robot: Robot | str = "h1",
        *,
        prefix: str | None = None,
        joints: Mapping[str, str] | None = None,
    ) -> None:
        """Find the robot; later changes of the model are not seen.

        Args:
            model: the model; of dm_control: `physics.model.ptr`.
            data: its data; of dm_control: `physics.data.ptr`.
            robot: the robot as hugwbc knows it, or its name.
            prefix: of the joints' names, such as "robot/"; None to find it.
            joints: names of those joints that the model calls otherwise, without the prefix.

        Raises:
            ModelError: if the model does not hold the robot, holds several, or differs in joints, axes or actuators.
            UnknownNameError: if there is no such robot, or `joints` names a joint that it does not have.
        """
        described = load_robot(robot) if isinstance(robot, str) else robot
        self._model, self._data = model, data
        self.prefix, self._joints = _find_joints(model, described, prefix, joints or {})
        self._root = int(model.body_rootid[model.jnt_bodyid[self._joints[0]]])
        free = int(model.body_jntadr[self._root])
        if free < 0 or model.jnt_type[free] != mujoco.mjtJoint.mjJNT_FREE:
            raise ModelError(f"body '{model.body(self._root).name}' has no free joint; the robot must move freely")
        self._pose = slice(int(model.jnt_qposadr[free]), int(model.jnt_qposadr[free]) + _POSE)
        self._twist = slice(int(model.jnt_dofadr[free]), int(model.jnt_dofadr[free]) + _TWIST)
        self._q, self._dq = model.jnt_qposadr[self._joints], model.jnt_dofadr[self._joints]
        moved_by = {int(body): joint for joint, body in enumerate(model.jnt_bodyid[self._joints])} | {self._root: -1}
        count = len(self._joints)
        mover = np.full(model.nbody, count)  # of each body: one of the robot's joints, -1 for the base, count for none
        for body in range(1, model.nbody):  # parents come before their children
            mover[body] = moved_by.get(body, mover[model.body_parentid[body]])
        own = np.flatnonzero(mover[model.jnt_bodyid] < count)
        self.extra_joints = tuple(model.joint(i).name for i in own if i != free and i not in self._joints)
        self._find_actuators()
        self.robot = self._told(described, mover)
        self._standing = described.nominal_height + described.sole_z - self.robot.sole_z  # of the nominal pose [m]
        self._role = np.where(mover == count, _OBJECT, _LINK)
        for side, (foot, hand) in enumerate(zip(_last(described.legs), _last(described.arms), strict=True)):
            self._role[mover == foot], self._role[mover == hand] = side, _HANDS + side
        self._objects = [i for i in range(1, model.nbody) if self._role[i] == _OBJECT and model.body(i).name]
        self.names = tuple(model.body(i).name for i in self._objects)
        self.clipped: Counter[str] = Counter()
        self.problems: list[str] = []
        self._hold, self._given_at = 0.0, np.inf  # [s]
        self._controller: Controller | None = None

    def control_period(
        self, controller: Controller, source: CommandSource | Command, upper_body: UpperBodySource | None = None
    ) -> ControlPeriod:
        """Return the control of this robot by its exact state: `start` it, then `observe` and `decide` in each period.

        Args:
            controller: any controller; one that takes a robot should be told `robot`.
            source: gives commands and hand targets over time, such as a `BehaviourSource`; or one command.
            upper_body: turns hand targets into arm targets (`UpperBodySource(robot=...)`); None ignores them.
        """
        source = Constant(source) if isinstance(source, Command) else source
        self._controller, self._hold, self._given_at = controller, 0.0, np.inf
        sight = Sight(self, self.robot, noisy=False, drifting=False)
        return ControlPeriod(controller, source, sight, robot=self.robot, estimator=None, upper_body=upper_body)

    def stand(self, x: float = 0.0, y: float = 0.0, ground: float = 0.0, yaw: float = 0.0) -> None:
        """Place the robot at rest in the nominal pose at x, y [m] on ground of a height [m], with a yaw [rad]."""
        self._hold, self._given_at = 0.0, np.inf  # what moves it next is another run
        data, turn = self._data, rotations.from_yaw_pitch_roll(yaw, 0.0, 0.0)
        data.qpos[self._pose] = (x, y, ground + self._standing, *turn)
        data.qpos[self._q], data.qvel[self._twist], data.qvel[self._dq] = self.robot.nominal, 0.0, 0.0
        mujoco.mj_forward(self._model, data)

    def state(self) -> RobotState:
        """Return the true state, with the forces of contacts on feet and hands."""
        data, force = self._data, self._contact_forces()
        pose, twist = data.qpos[self._pose].copy(), data.qvel[self._twist].copy()
        return RobotState(
            q=data.qpos[self._q],
            dq=data.qvel[self._dq],
            position=pose[:3],
            orientation=pose[3:],
            velocity=twist[:3],
            angular_velocity=twist[3:],
            foot_force=force[:_HANDS],
            hand_force=force[_HANDS:],
            time=float(data.time),
        )

    def controls(self, command: JointCommand) -> np.ndarray:
        r"""Return the inputs of the joints' actuators that give the torques of a command, shape (n,).

        A command asks for :math:`\tau = \tau_{ff} + k_p (q^* - q) + k_d (\dot q^* - \dot q)`. An actuator with the
        input u and the gear g gives :math:`g (a u + b_0 + b_1 g q + b_2 g \dot q)`; a motor has a = 1 and no b, a
        position servo with the gains K and D has :math:`a = -b_1 = K, b_2 = -D`. So

        .. math:: u = (\tau / g - b_0 - b_1 g q - b_2 g \dot q) / a, \qquad
            \text{for a position servo} \quad u = q + (\tau + D \dot q) / K.

        Until the next input the actuator's own gains act, and not those of the command. q is therefore taken in the
        middle of this time h, which is taken to be as long as the last one. What the command has in damping beyond the
        actuator's own loses the share :math:`|k_d - D| h / I`, with the joint's inertia I: applied late, it would
        shake the joint.

        Raises:
            ConfigError: if inputs are kept for longer than the controller's period.
        """
        hold = self._kept()
        q, dq = self._data.qpos[self._q], self._data.qvel[self._dq]
        q = q + 0.5 * hold * dq
        more = command.kd - self._own_damping
        kd = self._own_damping + more * np.maximum(1.0 - hold * self._mobility * np.abs(more), 0.0)
        wanted = (command.tau + command.kp * (command.q - q) + kd * (command.dq - dq)) / self._gear
        own = self._bias[0] + self._gear * (self._bias[1] * q + self._bias[2] * dq)
        given = np.clip((np.clip(wanted, *self._force_range) - own) / self._gain, *self._input_range)
        # A NaN is not enough either. MuJoCo would make 0 of it for all actuators, so the last input stays.
        enough = np.abs(self._gain * given + own - wanted) <= 1e-6 + 1e-3 * np.abs(wanted)
        self.clipped.update(self.robot.joint_names[i] for i in np.flatnonzero(~enough))
        return np.where(np.isfinite(given), given, self._data.ctrl[self.actuators])

    def _kept(self) -> float:
        """Return for how long inputs are kept [s]: as long as the last ones were; 0 for the first."""
        now, controller = float(self._data.time), self._controller
        if 0.0 < now - self._given_at < _PAUSE:
            self._hold = now - self._given_at
        self._given_at = now
        if controller is not None and self._hold > 1.01 * controller.period:
            raise ConfigError(
                f"inputs are kept for {1e3 * self._hold:.0f} ms, and the period of {controller.name} is "
                f"{1e3 * controller.period:.0f} ms: give new ones at least as often, in smaller physics steps if need "
                f"be, or the controller a longer period, as WholeBodyController(robot=..., period={self._hold:.3g})"
            )
        return self._hold

    def apply(self, command: JointCommand) -> None:
        """Write the inputs for a command into `data.ctrl` (`controls`)."""
        self._data.ctrl[self.actuators] = self.controls(command)

    def picture(self) -> Picture:
        """Return where objects and robot are."""
        poses = np.hstack((self._data.xpos, self._data.xquat))
        return Picture(float(self._data.time), 0.0, poses[self._objects], poses[self._root])

    def held(self, side: str) -> str | None:
        """Return None: there are no grippers."""
        return None

    def grip(self, grips: tuple[Grip, ...]) -> None:
        """Note that there are no grippers."""
        if grips and not self.problems:
            self.note(f"the {grips[0].side} gripper was asked for '{grips[0].name}', and there are no grippers")

    def note(self, problem: str) -> None:
        """Note a problem."""
        self.problems.append(problem)

    def _find_actuators(self) -> None:
        """Find the actuator of each joint, and what turns a torque into its input."""
        model, kind = self._model, mujoco.mjtTrn
        at_joint = (model.actuator_trntype == kind.mjTRN_JOINT) | (model.actuator_trntype == kind.mjTRN_JOINTINPARENT)
        affine = model.actuator_biastype == mujoco.mjtBias.mjBIAS_AFFINE
        known = (model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED) & (model.actuator_gainprm[:, 0] != 0.0)
        known &= affine | (model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE)
        known &= model.actuator_dyntype == mujoco.mjtDyn.mjDYN_NONE
        rows = []
        for joint in self._joints:
            found = np.flatnonzero(at_joint & (model.actuator_trnid[:, 0] == joint)).tolist()
            if len(found) != 1 or not known[found[0]]:
                names = ", ".join(f"'{model.actuator(i).name}'" for i in found) or "none"
                raise ModelError(
                    f"joint '{model.joint(joint).name}' has the actuators: {names}; give it one motor or one position "
                    "servo: a gain times its input plus a linear function of position and speed"
                )
            rows += found
        self._rows, self.actuators = rows, model.actuator_ctrladr[rows]
        self._gear, self._gain = model.actuator_gear[rows, 0], model.actuator_gainprm[rows, 0]
        self._bias = np.where(affine[rows], model.actuator_biasprm[rows, :3].T, 0.0)
        self._own_damping, self._mobility = -(self._gear**2) * self._bias[2], model.dof_invweight0[self._dq]
        self._input_range = _ranges(model.actuator_ctrlrange, model.actuator_ctrllimited, self.actuators)
        own = _ranges(model.actuator_forcerange, model.actuator_forcelimited, rows)
        at_joint = _ranges(model.jnt_actfrcrange, model.jnt_actfrclimited, self._joints) / self._gear
        self._force_range = np.maximum(own[0], at_joint.min(axis=0)), np.minimum(own[1], at_joint.max(axis=0))

    def _torque_limit(self, described: Robot) -> np.ndarray:
        """Return the torque that each joint can get in both directions [N*m], shape (n,)."""
        by_input = np.where(self._bias.any(axis=0), np.inf, np.abs(self._gain * self._input_range).min(axis=0))
        limit = np.abs(self._gear) * np.minimum(np.abs(self._force_range).min(axis=0), by_input)
        return np.where(np.isfinite(limit), limit, described.torque_limit)

    def _told(self, described: Robot, mover: np.ndarray) -> Robot:
        """Return the description with what the model says otherwise."""
        model, kinematics, pose = self._model, pinocchio_model(described), mujoco.MjData(self._model)
        pose.qpos[self._pose], pose.qpos[self._q] = (0, 0, 0, 1, 0, 0, 0), 0.0
        mujoco.mj_kinematics(model, pose)
        placed = kinematics.createData()
        pin.forwardKinematics(kinematics, placed, pin.neutral(kinematics))
        names = ("root_joint", *described.joint_names)
        places = [placed.oMi[kinematics.getJointId(name)] for name in names]
        inertias, hands = {}, described.hands
        for number, (name, place) in enumerate(zip(names, places, strict=True), start=-1):
            if number >= 0:
                joint, axis = self._joints[number], place.rotation @ described.axes[number]
                away = float(np.linalg.norm(np.cross(pose.xanchor[joint] - place.translation, axis)))
                if away > _FARTHEST or pose.xaxis[joint] @ axis < _LEAST_ALIGNED:
                    raise ModelError(
                        f"joint '{model.joint(joint).name}' with all joints at 0 has an axis along "
                        f"{np.round(pose.xaxis[joint], 2)}, {100 * away:.1f} cm from that of {name} in "
                        f"{described.name}, along {np.round(axis, 2)}; give the model's robot as `robot`"
                    )
            moved = pin.Inertia.Zero()
            for body in np.flatnonzero(mover == number):
                turn = pose.ximat[body].reshape(3, 3)
                spread = turn @ np.diag(model.body_inertia[body]) @ turn.T
                moved += pin.Inertia(float(model.body_mass[body]), pose.xipos[body], spread)
            moved = place.actInv(moved)
            inertias[name] = moved.mass, moved.lever, moved.inertia
        site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, f"{self.prefix}{SIDES[0]}_hand")
        elbow = _last(described.arms)[0]
        if site >= 0 and mover[model.site_bodyid[site]] == elbow:
            hands = on_both_sides(places[elbow + 1].actInv(pose.site_xpos[site]))
        foot = _last(described.legs)[0]
        sole = _sole(
            described, places[foot + 1].translation, _lowest_points(model, pose, np.flatnonzero(mover == foot))
        )
        limited, ranges = model.jnt_limited[self._joints].astype(bool), model.jnt_range[self._joints]
        vectors = {
            "lower": np.where(limited, ranges[:, 0], described.lower),
            "upper": np.where(limited, ranges[:, 1], described.upper),
            "torque_limit": self._torque_limit(described),
            "armature": model.dof_armature[self._dq] + self._gear**2 * model.actuator_armature[self._rows],
            "damping": model.dof_damping[self._dq] + self._gear**2 * model.actuator_damping[self._rows],
            "friction": model.dof_frictionloss[self._dq],
            "viscous": np.zeros(len(self._joints)),
            "hands": hands,
        }
        vectors = {name: frozen(vector) for name, vector in vectors.items()}
        mass, delay = sum(mass for mass, *_ in inertias.values()), float(model.actuator_delay[self._rows].max())
        return dataclasses.replace(described, mass=mass, inertias=inertias, command_delay=delay, **sole, **vectors)

    def _contact_forces(self) -> np.ndarray:
        """Return the forces on feet and hands from outside the robot in the world [N], shape (4, 3)."""
        force = np.zeros((_LINK, 3))
        geoms = self._data.contact.geom  # -1 for a cloth or a rope
        roles = np.where(geoms < 0, _OBJECT, self._role[self._model.geom_bodyid[geoms]]).reshape(-1, 2)
        for index in np.flatnonzero((roles.min(axis=1) < _LINK) & (roles.max(axis=1) == _OBJECT)):
            on_second = force_on_second(self._model, self._data, int(index))
            one, other = roles[index]
            force[min(one, other)] += on_second if other < one else -on_second
        return force


def _find_joints(
    model: mujoco.MjModel, robot: Robot, prefix: str | None, joints: Mapping[str, str]
) -> tuple[str, np.ndarray]:
    """Return what the model puts before the joints' names, and the indices of the joints in the robot's order."""
    for name in joints:
        robot.index(name)
    in_model = {model.joint(i).name: i for i in range(model.njnt)}
    # Other descriptions of the same robot leave out the end of our names.
    names = [{joints.get(name, name), joints.get(name, name.removesuffix("_joint"))} for name in robot.joint_names]
    ends = tuple(set().union(*names))
    starts = Counter(name.removesuffix(end) for name in in_model for end in ends if name.endswith(end))
    found = {start: [{start + name for name in both} & set(in_model) for both in names] for start in starts}
    whole = [start for start in found if all(found[start])]
    if prefix is None and len(whole) > 1:
        raise ModelError(
            f"the model holds several {robot.name}: give one of the prefixes {', '.join(map(repr, whole))}"
        )
    if prefix is None:
        prefix = whole[0] if whole else max(starts, key=lambda start: starts[start], default="")
    in_order = found.get(prefix, [set()] * len(names))
    lacks = [name for name, those in zip(robot.joint_names, in_order, strict=True) if not those]
    if lacks:
        raise ModelError(
            f"the model lacks the joints of {robot.name} (prefix {prefix!r}): {', '.join(lacks)}; it has: "
            f"{', '.join(filter(None, in_model)) or 'none'}. Give joints that have other names as "
            f"joints={{'{lacks[0]}': '...'}}"
        )
    joints_found = np.array([in_model[min(those)] for those in in_order])
    for joint in joints_found:
        if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE:
            raise ModelError(f"joint '{model.joint(joint).name}' is no hinge; the robot's joints must be hinges")
    parents, robots = model.body_parentid, set(joints_found.tolist())
    for body in model.jnt_bodyid[joints_found]:
        while parents[body] > 0:
            for joint in range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body]):
                if joint not in robots:
                    raise ModelError(f"joint '{model.joint(joint).name}' moves joints of {robot.name}, which lacks it")
            body = parents[body]
    return prefix, joints_found


def _last(joints: np.ndarray) -> list[int]:
    """Return the outermost joint of the left and the right limb, from the joints of both."""
    return joints.reshape(len(SIDES), -1)[:, -1].tolist()


def _lowest_points(model: mujoco.MjModel, pose: mujoco.MjData, bodies: np.ndarray) -> np.ndarray:
    """Return the corners of what can touch the ground, or of the lower side of what is round [m], shape (n, 3)."""
    kind, points = mujoco.mjtGeom, [np.zeros((0, 3))]
    for geom in np.flatnonzero(
        np.isin(model.geom_bodyid, bodies) & ((model.geom_contype | model.geom_conaffinity) > 0)
    ):
        local, radius = outline(model, int(geom)), 0.0
        if model.geom_type[geom] in (int(kind.mjGEOM_SPHERE), int(kind.mjGEOM_CAPSULE)):
            radius, length, _ = model.geom_size[geom]
            local = CORNERS * [0.0, 0.0, length]
        points.append(pose.geom_xpos[geom] + local @ pose.geom_xmat[geom].reshape(3, 3).T - [0.0, 0.0, radius])
    return np.concatenate(points)


def _sole(described: Robot, link: np.ndarray, points: np.ndarray) -> dict[str, Any]:
    """Return the part of the described sole that the model's foot has, at the height of the foot's lowest points."""
    if not len(points):
        return {}
    low, high = (end(points[points[:, 2] < points[:, 2].min() + _FLAT], axis=0) - link for end in (np.min, np.max))
    x, y = described.sole_x, described.sole_y
    return {
        "sole_x": (max(x[0], float(low[0])), min(x[1], float(high[0]))),
        "sole_y": (max(y[0], float(low[1])), min(y[1], float(high[1]))),
        "sole_z": float(low[2]),
        "sole_depth": described.sole_depth + described.sole_z - float(low[2]),
    }


def _ranges(ranges: np.ndarray, limited: np.ndarray, rows: np.ndarray | list[int]) -> np.ndarray:
    """Return the lower and upper ends of ranges, infinite without a limit, shape (2, n)."""
    return np.where(limited[rows].astype(bool), ranges[rows].T, [[-np.inf], [np.inf]])

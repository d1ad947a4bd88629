"""One robot in PhysX 5, the second engine: the same robot table and the same interface as in MuJoCo.

PhysX runs on the processor, through SAPIEN (extra `physx`). Its articulations use reduced coordinates, so that joints
do not come apart; contacts and friction come from an impulse solver without the springs of MuJoCo's contacts. What
one engine shows and the other does not is a property of the engine, not of a controller (docs/physx.md).
"""

import importlib
import math
import warnings
from typing import Any

import numpy as np

from hugwbc import rotations
from hugwbc.errors import ConfigError
from hugwbc.robot import SIDES, Robot
from hugwbc.robot_tables import robot_table
from hugwbc.sim.actuators import TorqueSpeedLimit
from hugwbc.sim.engine import Engine
from hugwbc.sim.scenes.scene import Scene
from hugwbc.sim.sensors import Reading
from hugwbc.sim.terrain import Ground, HeightField
from hugwbc.state import GRAVITY, RobotState
from hugwbc.table_defaults import FOOT_BOX_HALF, FOOT_BOX_MIDDLE, FRICTION, SOLE_RADIUS, START_GAP

_INNER_STEP = 0.001  # [s], longest step of PhysX; the joint torques are recomputed in each
_POSITION_ITERATIONS, _VELOCITY_ITERATIONS = 16, 1
_CONTACT_OFFSET = 0.002  # [m], distance at which contacts are prepared
_FRICTION_GAIN = 1e4  # [N*m*s/rad], makes a velocity drive with a force limit a Coulomb friction
_FASTEST = 1e3  # [m/s], [rad/s]; PhysX clips velocities, MuJoCo does not
_RUNAWAY = 1e6  # a larger number in the state counts as diverged
_Sapien = Any  # an object of SAPIEN, which need not be installed where the types are checked


def load_sapien() -> tuple[Any, Any]:
    """Return the optional modules sapien and sapien.physx."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # SAPIEN looks for a graphics driver, which the physics does not need
            return importlib.import_module("sapien"), importlib.import_module("sapien.physx")
    except ImportError as error:
        raise ConfigError(f"engine physx cannot load {error.name or 'sapien'}: {error}") from error


def _principal(link: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Return a link's principal axes at its centre of mass as a frame (4, 4), and the moments about them [kg*m^2]."""
    xx, yy, zz, xy, xz, yz = (link[key] for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
    moments, axes = np.linalg.eigh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    axes[:, 2] *= np.sign(np.linalg.det(axes))  # a right-handed frame
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = axes, link["com"]
    return frame, moments


def _axis_frame(axis: np.ndarray) -> np.ndarray:
    """Return the quaternion (w, x, y, z) that turns the x-axis, about which PhysX's hinges turn, to a joint's axis."""
    x = np.array([1.0, 0.0, 0.0])
    normal = np.cross(x, axis)
    if not normal.any():  # along x, or against it: half a turn about z
        return np.array([1.0, 0.0, 0.0, 0.0] if axis[0] > 0.0 else [0.0, 0.0, 0.0, 1.0])
    return rotations.from_axis_angle(normal / np.linalg.norm(normal), float(np.arccos(x @ axis)))


def _groups(pairs: list[list[str]], name: str, *, on_ground: bool = True) -> list[int]:
    """Return PhysX's collision groups of a link's shapes, from the pairs of links that collide.

    Two shapes collide if a bit of one's first group is in the other's second; the lowest bit is the ground's.
    """
    first = sum(2 << k for k, (one, _) in enumerate(pairs) if one == name)
    second = sum(2 << k for k, (_, other) in enumerate(pairs) if other == name)
    return [first, second | int(on_ground), 0, 0]


class PhysxSimulation(Engine):
    """One robot in PhysX with PD joints, an IMU on base or trunk, and foot sensors, on a level plane.

    The joint torques are explicit: the PD law of the joint state at each inner step, within the torque limits, is the
    torque in that step. Coulomb friction is a velocity drive of PhysX at speed 0 whose torque is limited to the
    friction; it holds a joint at rest. The foot sensors measure the vertical forces only.
    """

    engine = "physx"
    package = "sapien"
    _fixed_pelvis = False  # tests hang the robot up

    def _surroundings(
        self, terrain: HeightField | None, robot: Robot | None, ground: Ground | None, scene: Scene | None
    ) -> tuple[Robot | None, Ground | None]:
        if terrain is not None:
            raise ConfigError("engine physx has level ground only; use --engine mujoco for rough or sloping ground")
        if ground is not None and ground != Ground.named("firm"):
            raise ConfigError("engine physx has firm ground only; use --ground firm, or --engine mujoco")
        if scene is not None:
            raise ConfigError("engine physx has no objects; run a scene with mujoco")
        self.check_available()
        return robot, Ground.named("firm")

    def _build(self, seed: int, scene: Scene | None) -> None:
        if self.variation.hand_payload:
            raise ConfigError("engine physx has no payload in the hands; leave it out, or run it with mujoco")
        self._sapien, self._physx = load_sapien()
        self._substeps = max(1, int(np.ceil(self.timestep / _INNER_STEP - 1e-9)))
        self._dt = self.timestep / self._substeps
        self._torque_limit = self.variation.strength * self.robot.torque_limit
        self._limit = TorqueSpeedLimit(self.robot, self._torque_limit) if self.actuators.torque_speed else None
        self._range = np.stack([-self._torque_limit, self._torque_limit], axis=1)
        self._viscous = self.robot.damping + self.actuators.friction * self.robot.viscous
        self._table = robot_table(self.robot.name)
        self._start_height = self.robot.nominal_height + START_GAP
        self._build_world()
        self.link_names = ("world", *self._links)
        self.external_force = np.zeros((len(self.link_names), 6))
        self._step_count = 0
        self.reset()

    def _build_world(self) -> None:
        """Build the ground and the robot."""
        sapien, table = self._sapien, self._table
        self._scene = sapien.Scene([self._physx.PhysxCpuSystem()])
        self._scene.set_timestep(self._dt)
        friction = FRICTION if self.variation.friction is None else self.variation.friction
        self._material = self._physx.PhysxMaterial(friction, friction, 0.0)
        self._add_ground()
        joints = {joint["child"]: joint for joint in table["joints"]}
        builder = self._scene.create_articulation_builder()
        makers: dict[str, Any] = {}
        for link in table["links"]:
            name, joint = link["name"], joints.get(link["name"])
            maker = makers[name] = builder.create_link_builder(None if joint is None else makers[joint["parent"]])
            maker.set_name(name)
            frame, moments = _principal(link)
            mass = self.variation.loaded(link["mass"]) if name == self.robot.trunk else link["mass"]
            maker.set_mass_and_inertia(mass, sapien.Pose(frame), moments)
            maker.collision_groups = _groups(table["collision_pairs"], name)
            if box := link.get("collision_box"):
                half = [size / 2.0 for size in box["size"]]
                maker.add_box_collision(sapien.Pose(box["center"]), half, self._material)
            if name in self.robot.foot_links:
                self._add_sole(maker)
            if joint is not None:
                turn = _axis_frame(np.array(joint["axis"], dtype=float))
                mount = rotations.from_yaw_pitch_roll(*reversed(joint["rpy"]))
                in_parent = sapien.Pose(joint["xyz"], rotations.multiply(mount, turn))
                maker.set_joint_name(joint["name"])
                maker.set_joint_properties("revolute", [joint["range"]], in_parent, sapien.Pose([0, 0, 0], turn))
        self._articulation = builder.build(fix_root_link=self._fixed_pelvis)
        self._links = {link.name: link for link in self._articulation.links}
        self._prepare_links()
        self._prepare_joints()

    def _add_ground(self) -> None:
        plane = self._physx.PhysxCollisionShapePlane(self._material)
        # The plane's normal is its x-axis.
        plane.local_pose = self._sapien.Pose(q=_axis_frame(np.array([0.0, 0.0, 1.0])))
        plane.set_collision_groups([1, 0, 0, 0])
        self._ground = self._physx.PhysxRigidStaticComponent()
        self._ground.attach(plane)
        entity = self._sapien.Entity()
        entity.add_component(self._ground)
        self._scene.add_entity(entity)

    def _add_sole(self, maker: _Sapien) -> None:
        """Add the spheres at the corners of a sole, and the box that collides with the other leg."""
        (x0, x1), (y0, y1), z = self._table["sole"]["x"], self._table["sole"]["y"], self._table["sole"]["z"]
        pose = self._sapien.Pose
        for x in (x0, x1):
            for y in (y0, y1):
                maker.add_sphere_collision(pose([x, y, z + SOLE_RADIUS]), SOLE_RADIUS, self._material)
        half = [(x1 - x0) / 2.0, (y1 - y0) / 2.0, FOOT_BOX_HALF]
        maker.add_box_collision(pose([(x0 + x1) / 2.0, 0.0, z + FOOT_BOX_MIDDLE]), half, self._material)

    def _prepare_links(self) -> None:
        """Set what the builder does not: no damping, no speed limits, and the collision groups of the feet."""
        self._articulation.set_solver_position_iterations(_POSITION_ITERATIONS)
        self._articulation.set_solver_velocity_iterations(_VELOCITY_ITERATIONS)
        self._articulation.set_sleep_threshold(0.0)
        for name, link in self._links.items():
            link.linear_damping = link.angular_damping = 0.0
            link.max_linear_velocity = link.max_angular_velocity = _FASTEST
            for shape in link.collision_shapes:
                shape.contact_offset, shape.rest_offset = _CONTACT_OFFSET, 0.0
                if name in self.robot.foot_links:
                    is_sphere = isinstance(shape, self._physx.PhysxCollisionShapeSphere)
                    others = _groups(self._table["collision_pairs"], name, on_ground=False)
                    shape.set_collision_groups([0, 1, 0, 0] if is_sphere else others)
        self._feet = [self._links[name] for name in self.robot.foot_links]
        self._torso, self._imu_link = self._links[self.robot.trunk], self._links[self.robot.imu_link]
        self._pelvis = self._links[self.robot.base]
        self._imu = np.array(self._table["imu"]["xyz"])

    def _prepare_joints(self) -> None:
        """Set rotor inertia, friction and damping, and find the order of PhysX's joints."""
        joints, robot = self._articulation.active_joints, self.robot
        self._columns = robot.indices([joint.name for joint in joints])
        for column, joint in zip(self._columns, joints, strict=True):
            joint.set_armature([self.actuators.armature * robot.armature[column]])
            joint.set_friction(0.0)  # PhysX's own friction is a factor on the joint's load
            joint.max_velocity = _FASTEST
            coulomb = float(self.actuators.friction * robot.friction[column])
            # A drive to speed 0 whose torque is limited to the friction. It is implicit, so it stops a joint without
            # reversing it, however large its gain.
            joint.set_drive_properties(0.0, _FRICTION_GAIN if coulomb > 0.0 else 0.0, coulomb, "force")

    def reset(  # noqa: D102
        self, *, xy: tuple[float, float] = (0.0, 0.0), yaw: float = 0.0, q: np.ndarray | None = None
    ) -> RobotState:
        if self._step_count:
            self._build_world()  # PhysX keeps contacts and impulses of the last run, which a new one must not see
        joints = self.robot.nominal.copy() if q is None else np.array(q, dtype=float)
        height = self._start_height + (0.0 if q is None else self._rise(joints))
        self._clear(joints)
        self._step_count = 0
        self._place(np.array([*xy, height]), rotations.from_yaw_pitch_roll(yaw, 0.0, 0.0), joints)
        self._start_sensors()
        return self.state()

    def _place(self, position: np.ndarray, orientation: np.ndarray, joints: np.ndarray) -> None:
        """Put the robot somewhere at rest."""
        articulation = self._articulation
        articulation.set_root_pose(self._sapien.Pose(position, orientation))
        articulation.set_qpos(joints[self._columns].astype(np.float32))
        articulation.set_root_linear_velocity(np.zeros(3))
        articulation.set_root_angular_velocity(np.zeros(3))
        articulation.set_qvel(np.zeros(joints.size, dtype=np.float32))
        articulation.set_qf(np.zeros(joints.size, dtype=np.float32))
        self._torque = np.zeros(joints.size)
        self._foot_force = np.zeros((2, 3))
        self._centres = np.full((2, 3), np.nan)
        self._trunk = False
        self._read_state()
        self._accelerometer = np.array([0.0, 0.0, GRAVITY]) @ self._imu_turn

    def _advance(self, kp: np.ndarray, kd: np.ndarray, constant: np.ndarray) -> None:
        strength, articulation = self.variation.strength, self._articulation
        torque, impulses, moments = np.zeros(self.robot.kp.size), np.zeros((2, 3)), np.zeros((2, 3))
        self._trunk = False
        velocity, turn = self._imu_velocity, self._imu_turn
        forces = [
            (self._links[self.link_names[row]], self.external_force[row])
            for row in np.flatnonzero(self.external_force.any(axis=1))
        ]
        q, dq = self._qpos[7:], self._qvel[6:]
        for _ in range(self._substeps):
            if self._limit is not None:
                self._limit.write(dq, self._range)
            drive = np.clip(strength * (constant - kp * q - kd * dq), self._range[:, 0], self._range[:, 1])
            torque += drive
            articulation.set_qf((drive - self._viscous * dq)[self._columns].astype(np.float32))
            for link, force in forces:
                link.add_force_torque(force[:3], force[3:])
            self._scene.step()
            self._collect_contacts(impulses, moments)
            q, dq = self._joint_state()
        self._read_state()
        self._step_count += 1
        self._torque = torque / self._substeps
        if not (np.abs(np.concatenate((self._qpos, self._qvel))) < _RUNAWAY).all():
            self._restart()
            return
        self._foot_force = impulses / self.timestep
        with np.errstate(invalid="ignore", divide="ignore"):
            self._centres = np.where(impulses[:, 2:] > 0.0, moments / impulses[:, 2:], np.nan)
        self._accelerometer = ((self._imu_velocity - velocity) / self.timestep + [0.0, 0.0, GRAVITY]) @ turn

    def _restart(self) -> None:
        """Stand the robot up again after the physics has failed, so that all numbers are finite."""
        self.diverged = True
        self._build_world()
        self._place(np.array([0.0, 0.0, self._start_height]), np.array([1.0, 0.0, 0.0, 0.0]), self.robot.nominal)

    def _read_state(self) -> None:
        """Read positions and velocities; PhysX gives the velocity of a link at its centre of mass."""
        position, orientation, turn, velocity, spin = self._motion(self._pelvis, np.zeros(3))
        self._qpos, self._qvel = np.empty(7 + self._columns.size), np.empty(6 + self._columns.size)
        self._qpos[:3], self._qpos[3:7], self._pelvis_turn = position, orientation, turn
        self._qvel[:3], self._qvel[3:6] = velocity, spin @ turn
        self._qpos[7:], self._qvel[6:] = self._joint_state()
        _, self._imu_orientation, turn, self._imu_velocity, spin = self._motion(self._imu_link, self._imu)
        self._imu_turn, self._imu_gyro = turn, spin @ turn

    def _motion(self, link: _Sapien, point: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return the motion of a link in the world, with the velocity of a point in the link's frame [m].

        Returns:
            Position of the link [m], its orientation as a quaternion and as a matrix, the point's velocity [m/s], and
            the angular velocity [rad/s].
        """
        pose = link.entity_pose
        orientation, turn = np.array(pose.q, dtype=float), pose.to_transformation_matrix()[:3, :3].astype(float)
        spin = np.array(link.angular_velocity, dtype=float)
        arm = turn @ (point - link.cmass_local_pose.p)
        velocity = link.linear_velocity + rotations.cross(spin, arm)
        return np.array(pose.p, dtype=float), orientation / math.sqrt(orientation @ orientation), turn, velocity, spin

    def _joint_state(self) -> tuple[np.ndarray, np.ndarray]:
        """Return positions and velocities of the joints in the robot's order, shape (n,) each."""
        q, dq = np.empty(self._columns.size), np.empty(self._columns.size)
        q[self._columns], dq[self._columns] = self._articulation.get_qpos(), self._articulation.get_qvel()
        return q, dq

    def _collect_contacts(self, impulses: np.ndarray, moments: np.ndarray) -> None:
        """Add the vertical impulses on both feet [N*s] of the last inner step, and these times the contact points."""
        for contact in self._scene.get_contacts():
            one, other = contact.bodies
            if self._ground not in (one, other):
                continue
            link = other if one == self._ground else one
            if link == self._torso:
                self._trunk |= any(point.separation <= 0.0 for point in contact.points)
            elif link in self._feet:
                foot = self._feet.index(link)
                for point in contact.points:
                    impulse = np.abs(float(point.impulse[2]))
                    impulses[foot, 2] += impulse
                    moments[foot] += impulse * np.asarray(point.position, dtype=float)

    def _reading(self) -> Reading:
        return Reading(
            time=self.time,
            qpos=self._qpos.copy(),
            qvel=self._qvel.copy(),
            imu_orientation=self._imu_orientation,
            imu_gyro=self._imu_gyro,
            foot_force=self._foot_force,
            accelerometer=self._accelerometer,
            torque=self._torque,
        )

    def push(self, velocity: np.ndarray) -> None:  # noqa: D102
        change = np.zeros(6)
        change[: np.size(velocity)] = velocity
        spin = self._pelvis_turn @ (self._qvel[3:6] + change[3:])
        arm = self._pelvis_turn @ self._pelvis.cmass_local_pose.p
        self._articulation.set_root_linear_velocity(self._qvel[:3] + change[:3] + rotations.cross(spin, arm))
        self._articulation.set_root_angular_velocity(spin)
        self._read_state()

    @property
    def time(self) -> float:  # noqa: D102
        return self._step_count * self.timestep

    @property
    def qpos(self) -> np.ndarray:  # noqa: D102
        return self._qpos.copy()

    @property
    def qvel(self) -> np.ndarray:  # noqa: D102
        return self._qvel.copy()

    @property
    def torque(self) -> np.ndarray:
        """Joint torques over the last physics step [N*m], shape (n,)."""
        return self._torque.copy()

    @property
    def pressure_centres(self) -> np.ndarray:  # noqa: D102
        return self._centres.copy()

    @property
    def sole_velocity(self) -> np.ndarray:  # noqa: D102
        centre = np.array([self.robot.sole_middle, 0.0, self.robot.sole_z])
        return np.stack([self._motion(self._links[name], centre)[3] for name in self.robot.foot_links])

    def hand_position(self, side: str) -> np.ndarray:  # noqa: D102
        number = SIDES.index(side)
        pose = self._links[self.robot.hand_links[number]].entity_pose
        return np.array(pose.p, dtype=float) + rotations.rotate(np.array(pose.q, dtype=float), self.robot.hands[number])

    def _trunk_on_ground(self) -> bool:
        return self._trunk

"""One robot in MuJoCo, driven by joint commands."""

import math

import mujoco
import numpy as np

from hugwbc import rotations
from hugwbc.errors import ConfigError, SceneError
from hugwbc.robot import SIDES, Robot, load_robot
from hugwbc.sim.actuators import TorqueSpeedLimit
from hugwbc.sim.engine import Engine, check_seed
from hugwbc.sim.footing import Footing
from hugwbc.sim.robot_model import link_names, load_model, robot_layout
from hugwbc.sim.scenes.gripper import Gripper
from hugwbc.sim.scenes.objects import SceneObjects
from hugwbc.sim.scenes.scene import OVERLAP, Scene
from hugwbc.sim.sensors import Reading
from hugwbc.sim.terrain import Ground, HeightField
from hugwbc.state import GRAVITY, RobotState

_UPWARDS = np.array([0.0, 0.0, GRAVITY])
# The part of a state that may change between two steps: a viewer moves the robot or an object, or a gripper acts.
_MOVED = int(mujoco.mjtState.mjSTATE_QPOS | mujoco.mjtState.mjSTATE_QVEL | mujoco.mjtState.mjSTATE_EQ_ACTIVE)
# Warnings after which MuJoCo resets the state.
DIVERGED = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)


_NO_ROOM = "the robot stands in object '{}' at the start; move it away from the origin"
_FLOOR_BODY = "world"


class Simulation(Engine):
    """One robot in MuJoCo with PD joints, an IMU and foot sensors, on a plane or height field, alone or among objects.

    Attributes:
        model, data: MuJoCo's model and data, for viewers and tests; `redraw` makes new ones.
    """

    engine = "mujoco"
    package = "mujoco"

    def _surroundings(
        self, terrain: HeightField | None, robot: Robot | None, ground: Ground | None, scene: Scene | None
    ) -> tuple[Robot | None, Ground | None]:
        if scene is not None and scene.robot is not None:
            if robot is not None and robot.name != scene.robot:
                raise ConfigError(f"the scene is made for robot {scene.robot}, not {robot.name}; change one of them")
            robot = robot or load_robot(scene.robot)
        if scene is not None and scene.ground is not None:
            wanted = Ground.named(scene.ground)
            if ground is not None and ground != wanted:
                raise ConfigError(f"the scene is made for {scene.ground} ground; change the ground or the scene")
            ground = wanted
        return robot, ground

    def _build(self, seed: int, scene: Scene | None) -> None:
        self._declared, self._scene_objects = scene, None
        self._install(seed)

    def _install(self, seed: int) -> None:
        """Compile the model of one episode, and place the robot in it."""
        terrain, self.scene = self.terrain, None if self._declared is None else self._declared.draw(seed)
        self.model = load_model(
            self.timestep,
            terrain,
            robot=self.robot,
            actuators=self.actuators,
            ground=self.ground,
            scene=self.scene,
        )
        self._layout = robot_layout(self.model, self.robot)
        # Where each sensor's values are; looking up a name at every step takes longer than a reading.
        self._places = {
            self.model.sensor(i).name: slice(int(start), int(start + size))
            for i, (start, size) in enumerate(zip(self.model.sensor_adr, self.model.sensor_dim, strict=True))
        }
        self._places_by_side = {  # of vectors
            name: np.array([np.r_[self._places[f"{side}_{name}"]] for side in SIDES])
            for name in ("foot_force", "sole_velocity")
        }
        self._places_by_side["hand_force"] = np.array(
            [np.r_[self._places[f"{n}_force"]] for n in self.robot.hand_links]
        )
        self._imu, self._twist = self.model.site("imu").id, np.zeros(6)
        self._feet = [self.model.body(link).id for link in self.robot.foot_links]
        self._floor, self._trunk = self.model.geom("floor").id, self.model.geom(self.robot.trunk).id
        self.variation.apply_to(self.model, self.robot)
        torque_limit = self.model.actuator_forcerange[self._layout.ctrl, 1]
        self._limit = TorqueSpeedLimit(self.robot, torque_limit) if self.actuators.torque_speed else None
        self._footing = None if terrain is None else Footing(self.model, terrain)
        self.data = mujoco.MjData(self.model)
        self._computed, self._present = np.zeros((2, mujoco.mj_stateSize(self.model, _MOVED)))
        self._warnings = self.data.warning.number  # a view; to find it takes longer than to read it
        self.link_names = link_names(self.model)
        self.external_force = self.data.xfrc_applied
        # The control input is the constant part of the PD torque. Stiffness and damping go into the bias, so that the
        # implicit integrator knows the derivatives of the torque.
        self.model.actuator_gainprm[self._layout.ctrl, 0] = self.variation.strength
        if self.scene is not None:
            names = self.scene.body_names
            self._scene_objects = SceneObjects(self.model, self.data, names, self.robot, self.sensing, seed, terrain)
            self.objects, self.gripper = self._scene_objects, Gripper(self.model, self.data, names, self.robot)
        self.reset()
        if self.scene is not None:
            self._check_room(self.scene)

    def _check_room(self, scene: Scene) -> None:
        """Refuse an object in which the robot stands at the start."""
        model, contact, names = self.model, self.data.contact, set(scene.body_names)
        for index in np.flatnonzero(contact.dist < -OVERLAP):
            bodies = [model.body(int(model.geom_bodyid[geom])).name for geom in contact.geom[index]]
            inside = [body for body in bodies if body in names]
            if len(inside) == 1 and _FLOOR_BODY not in bodies:
                raise SceneError(_NO_ROOM.format(inside[0]))
        # The pelvis touches nothing: its shapes are for pictures.
        solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        pelvis = np.flatnonzero(model.geom_bodyid == model.body(self.robot.base).id)
        for geom in np.flatnonzero(solid & (model.geom_type != mujoco.mjtGeom.mjGEOM_HFIELD)):
            body = model.body(int(model.geom_bodyid[geom])).name
            if body not in names:
                continue
            if any(mujoco.mj_geomDistance(model, self.data, g, geom, 0.1, None) < -OVERLAP for g in pelvis):
                raise SceneError(_NO_ROOM.format(body))

    def redraw(self, seed: int) -> RobotState:
        """Begin another episode: draw the scene's variations and the sensor errors from a seed, and reset.

        The episode is that of a new `Simulation` with this seed, bit for bit. The model is compiled again.
        """
        check_seed(seed)
        self._seed_errors(seed)
        self._install(seed)
        return self.state()

    def reset(  # noqa: D102
        self, *, xy: tuple[float, float] = (0.0, 0.0), yaw: float = 0.0, q: np.ndarray | None = None
    ) -> RobotState:
        mujoco.mj_resetDataKeyframe(self.model, self.data, 0)
        pelvis, joints = self.data.qpos[self._layout.qpos], self.data.qpos[self._layout.joints]  # views
        pelvis[:2] = xy
        pelvis[2] += self.ground_height(np.asarray(xy))
        pelvis[3:7] = rotations.from_yaw_pitch_roll(yaw, 0.0, 0.0)
        if q is not None:
            joints[:] = q
            pelvis[2] += self._rise(joints)
        elif self.terrain is not None:
            rise = float(np.dot(self.terrain.gradient, (math.cos(yaw), math.sin(yaw))))
            joints[self.robot.pair("ankle_pitch")] -= math.atan(rise)
        if self.gripper is not None:
            self.gripper.reset()
        # The drives give no torque before the first command, neither by the last gains nor by the keyframe's targets.
        self.data.ctrl[self._layout.ctrl], self.model.actuator_biasprm[self._layout.ctrl] = 0.0, 0.0
        self._gains: tuple[np.ndarray | None, np.ndarray | None] = (None, None)
        self._clear(joints.copy())
        if self._footing is not None:
            mujoco.mj_kinematics(self.model, self.data)
            pelvis[2] += self._footing.depth(self.data.xpos, self.data.xmat)
            mujoco.mj_kinematics(self.model, self.data)
            self._place_feet(self._footing)
        self._compute()
        self._imu_orientation, self._imu_velocity = self._sensed("imu_orientation"), self._velocity_of_imu()
        self._accelerometer = rotations.rotate_inverse(self._imu_orientation, _UPWARDS)  # at rest
        self._torque = self.torque
        if self._scene_objects is not None:
            self._scene_objects.restart()
        self._start_sensors()
        return self.state()

    def _advance(self, kp: np.ndarray, kd: np.ndarray, constant: np.ndarray) -> None:
        layout, data = self._layout, self.data
        drives = layout.ctrl
        if kp is not self._gains[0] or kd is not self._gains[1]:
            self._gains = kp, kd
            self.model.actuator_biasprm[drives, 1] = -self.variation.strength * kp
            self.model.actuator_biasprm[drives, 2] = -self.variation.strength * kd
        data.ctrl[drives] = constant
        if self._limit is not None:
            self._limit.write(data.qvel[layout.rates], self.model.actuator_forcerange[drives])
        self._warnings[:] = 0
        before = data.time
        if self._footing is not None:
            self._place_feet(self._footing)
            mujoco.mj_step(self.model, data)
        elif self._is_computed():
            mujoco.mj_step2(self.model, data)
        else:
            mujoco.mj_step(self.model, data)
        failures = [warning for warning in DIVERGED if self._warnings[warning]]
        self.diverged |= failures != []
        self._torque = data.actuator_force[drives].copy()  # of this step; `_compute` overwrites it
        if self.gripper is not None:
            self.gripper.update()
        self._compute()
        self._feel_acceleration()
        if self._scene_objects is not None:
            if failures:
                self._scene_objects.note_divergence(before, int(data.warning[failures[0]].lastinfo))
            self._scene_objects.watch()

    def _compute(self) -> None:
        """Compute what follows from the state: places, contacts, forces and the readings of the sensors."""
        mujoco.mj_forward(self.model, self.data)
        mujoco.mj_getState(self.model, self.data, self._computed, _MOVED)

    def _is_computed(self) -> bool:
        """Return whether the places and contacts are those of the state, so that a step need not compute them again.

        They are not if someone has moved the robot or an object, or if a gripper has closed or opened.
        """
        mujoco.mj_getState(self.model, self.data, self._present, _MOVED)
        return self._present.tobytes() == self._computed.tobytes()

    def _feel_acceleration(self) -> None:
        """Set the accelerometer to the change of the IMU's velocity over the step.

        MuJoCo's own accelerometer reads `qacc`, which differs from what the implicit integrator does with the velocity:
        integrated over a walk, it drifts by 0.05 m/s in every second.
        """
        orientation, velocity = self._sensed("imu_orientation"), self._velocity_of_imu()
        if orientation.dot(self._imu_orientation) < 0.0:
            orientation = -orientation
        middle = orientation + self._imu_orientation
        force = (velocity - self._imu_velocity) / self.timestep + _UPWARDS
        self._accelerometer = rotations.rotate_inverse(middle / math.sqrt(middle.dot(middle)), force)
        self._imu_orientation, self._imu_velocity = orientation, velocity

    def _velocity_of_imu(self) -> np.ndarray:
        """Return the velocity of the IMU in the world [m/s], shape (3,)."""
        mujoco.mj_objectVelocity(self.model, self.data, mujoco.mjtObj.mjOBJ_SITE, self._imu, self._twist, 0)
        return self._twist[3:].copy()

    def push(self, velocity: np.ndarray) -> None:  # noqa: D102
        velocity = np.asarray(velocity, dtype=float)
        self.data.qvel[self._layout.qvel][: velocity.size] += velocity
        self._compute()

    def _place_feet(self, footing: Footing) -> None:
        self.model.geom_pos[footing.geoms] = places = footing.positions(self.data.xpos, self.data.xmat)
        self.data.geom_xpos[footing.geoms[-1]] = places[-1]  # among objects (sleep) MuJoCo does not move fixed geoms

    def _reading(self) -> Reading:
        data, layout, sensed = self.data, self._layout, self.data.sensordata.copy()
        # A contact sensor gives the force of the link on its surroundings; the reaction acts on the link.
        foot_force = -sensed[self._places_by_side["foot_force"]]
        hand_force = -sensed[self._places_by_side["hand_force"]]
        return Reading(
            time=data.time,
            qpos=data.qpos[layout.qpos].copy(),
            qvel=data.qvel[layout.qvel].copy(),
            imu_orientation=sensed[self._places["imu_orientation"]],
            imu_gyro=sensed[self._places["imu_gyro"]],
            foot_force=foot_force,
            accelerometer=self._accelerometer,
            torque=self._torque,
            hand_force=hand_force if self.gripper is None else hand_force + self.gripper.force,
        )

    @property
    def time(self) -> float:  # noqa: D102
        return float(self.data.time)

    @property
    def qpos(self) -> np.ndarray:  # noqa: D102
        return self.data.qpos[self._layout.qpos].copy()

    @property
    def qvel(self) -> np.ndarray:  # noqa: D102
        return self.data.qvel[self._layout.qvel].copy()

    @property
    def torque(self) -> np.ndarray:
        """Torques of the drives in the present state, by the last command that reached them [N*m], shape (n,)."""
        return self.data.actuator_force[self._layout.ctrl].copy()

    @property
    def sole_velocity(self) -> np.ndarray:  # noqa: D102
        return self.data.sensordata[self._places_by_side["sole_velocity"]]

    @property
    def pressure_centres(self) -> np.ndarray:  # noqa: D102
        centres, contact, wrench = np.full((2, 3), np.nan), self.data.contact, np.zeros(6)
        links, places = self.model.geom_bodyid[contact.geom].tolist(), contact.pos
        for foot, link in enumerate(self._feet):
            weighted, total = np.zeros(3), 0.0
            for index in (i for i, pair in enumerate(links) if link in pair):
                mujoco.mj_contactForce(self.model, self.data, index, wrench)
                weighted += wrench[0] * places[index]
                total += wrench[0]
            if total > 0.0:
                centres[foot] = weighted / total
        return centres

    @property
    def links_on_ground(self) -> tuple[str, ...]:
        """Names of the robot's links that touch the ground now, the feet on a height field included."""
        pairs = self.model.geom_bodyid[self.data.contact.geom]  # the floor, and the soles' plane, are the world's
        bodies, pelvis = np.unique(pairs[(pairs == 0).any(axis=1)]), self.model.body(self.robot.base).id
        return tuple(self.model.body(body).name for body in bodies if self.model.body_rootid[body] == pelvis)

    @property
    def trunk_velocity(self) -> np.ndarray:
        """Velocity of the trunk's centre of mass in the world [m/s], shape (3,)."""
        twist = np.zeros(6)
        body = int(self.model.geom_bodyid[self._trunk])
        mujoco.mj_objectVelocity(self.model, self.data, mujoco.mjtObj.mjOBJ_BODY, body, twist, 0)
        return twist[3:]

    def hand_position(self, side: str) -> np.ndarray:  # noqa: D102
        return self._sensed(f"{side}_hand_position")

    def _sensed(self, name: str) -> np.ndarray:
        return self.data.sensordata[self._places[name]].copy()

    def _trunk_on_ground(self) -> bool:
        pairs = self.data.contact.geom.tolist()
        return [self._floor, self._trunk] in pairs or [self._trunk, self._floor] in pairs

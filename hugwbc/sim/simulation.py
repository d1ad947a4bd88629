"""One H1 in MuJoCo, driven by joint commands."""

import collections
import dataclasses
import math

import mujoco
import numpy as np

from hugwbc import rotations
from hugwbc.controller import JointCommand
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.robot import SIDES, Robot, load_robot
from hugwbc.sim.actuators import Actuators, TorqueSpeedLimit
from hugwbc.sim.footing import Footing
from hugwbc.sim.scene import SIMULATION_TIMESTEP, Ground, load_model
from hugwbc.sim.sensors import EXACT, Reading, SensorProfile, Sensors, sensor_profile
from hugwbc.sim.terrain import HeightField
from hugwbc.sim.variation import Variation
from hugwbc.state import RobotState

# A robot has fallen if it leans beyond these angles (the paper's early termination) or its pelvis is near the ground.
FALL_PITCH, FALL_ROLL, FALL_HEIGHT = 1.0, 0.8, 0.45  # [rad], [rad], [m]
# Warnings after which MuJoCo resets the state.
DIVERGED = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)


class Simulation:
    """One H1 with PD joints, an IMU on the torso and foot sensors, on a choice of ground; it can be pushed and pulled.

    Attributes:
        model, data: MuJoCo's model and data, for viewers and tests.
        robot: names, limits, gains and drives.
        actuators: what the drives do besides the PD law.
        variation: difference of this robot from its description.
        sensing: sensors of the robot.
        rejected_commands: number of joint commands that were not finite; the last valid one was held instead.
        diverged: whether the physics has failed since the last reset (MuJoCo then resets the state by itself).
    """

    def __init__(
        self,
        *,
        timestep: float = SIMULATION_TIMESTEP,
        terrain: HeightField | None = None,
        sensing: SensorProfile | str = EXACT,
        latency: float | None = None,
        seed: int = 0,
        variation: Variation | None = None,
        robot: Robot | None = None,
        actuators: Actuators | None = None,
        ground: Ground | None = None,
    ) -> None:
        """Build the model and place the robot on the ground in the nominal pose.

        Args:
            timestep: physics time step [s].
            terrain: height field to stand on; None for a plane.
            sensing: sensors of the robot, or a profile's name (`hugwbc.sim.sensors.PROFILES`).
            latency: age of the results of `sense`, rounded to whole physics steps [s]; None for the profile's.
            seed: random seed of the sensors' noise, biases and offsets.
            variation: difference of the robot from its description; None for no difference.
            robot: robot to simulate; None for the H1.
            actuators: drives of the joints; None for ideal ones.
            ground: firmness of the ground; None for the default.

        Raises:
            ConfigError: if time step, latency or seed is out of range.
        """
        profile = sensor_profile(sensing) if isinstance(sensing, str) else sensing
        if latency is not None:
            profile = dataclasses.replace(profile, latency=latency)
        if seed < 0:
            raise ConfigError(f"seed is {seed}; give 0 or more")
        self.robot = robot or load_robot()
        self.actuators = actuators or Actuators.ideal()
        self.terrain = terrain
        self.variation = variation or Variation()
        self.model = load_model(timestep, terrain, robot=self.robot, actuators=self.actuators, ground=ground)
        self.variation.apply_to(self.model)
        torque_limit = self.model.actuator_forcerange[:, 1]
        self._limit = TorqueSpeedLimit(self.robot, torque_limit) if self.actuators.torque_speed else None
        self._delay = self.actuators.delay_steps(self.robot, timestep)
        # Commands on the way to the drives, oldest first: stiffness, damping, and the constant part of the torque.
        self._pending: collections.deque[tuple[np.ndarray, np.ndarray, np.ndarray]] = collections.deque()
        self._footing = None if terrain is None else Footing(self.model, terrain)
        self.data = mujoco.MjData(self.model)
        self.rejected_commands = 0
        self.diverged = False
        self.sensing = profile
        self._sensors = Sensors(self.model, profile, seed)
        # Readings of the physics steps that the latency spans, oldest first, and the current one.
        self._readings: collections.deque[Reading] = collections.deque(maxlen=1 + round(profile.latency / timestep))
        self._pelvis = self.model.body("pelvis").id
        self._force_until: dict[int, float] = {}
        # The control input is the constant part of the PD torque. Stiffness and damping go into the bias, so that the
        # implicit integrator knows the derivatives of the torque.
        self.model.actuator_gainprm[:, 0] = self.variation.strength
        self._described_bias = self.model.actuator_biasprm.copy()
        self._command = JointCommand.position(self.robot, self.robot.nominal)
        self.reset()

    @property
    def timestep(self) -> float:
        """Physics time step [s]."""
        return self.model.opt.timestep

    def reset(
        self, *, xy: tuple[float, float] = (0.0, 0.0), yaw: float = 0.0, q: np.ndarray | None = None
    ) -> RobotState:
        """Place the robot on the ground at `xy` [m], with heading `yaw` [rad] and joint positions `q` [rad], (19,).

        By default the joints are nominal, with the ankles turned so that the soles lie on the ground's mean plane.
        """
        mujoco.mj_resetDataKeyframe(self.model, self.data, 0)
        self.data.qpos[:2] = xy
        self.data.qpos[2] += self.ground_height(np.asarray(xy))
        self.data.qpos[3:7] = rotations.from_yaw_pitch_roll(yaw, 0.0, 0.0)
        if q is not None:
            self.data.qpos[7:] = q
        elif self.terrain is not None:
            rise = float(np.dot(self.terrain.gradient, (math.cos(yaw), math.sin(yaw))))
            self.data.qpos[7 + self.robot.indices([f"{side}_ankle_joint" for side in SIDES])] -= math.atan(rise)
        self.model.actuator_biasprm[:] = self._described_bias  # forget the gains of the last command
        self.data.xfrc_applied[:] = 0.0
        self._force_until.clear()
        self._pending.clear()
        self.diverged = False
        self._command = JointCommand.position(self.robot, self.data.qpos[7:].copy())
        if self._footing is not None:
            mujoco.mj_kinematics(self.model, self.data)
            self.data.qpos[2] += self._footing.depth(self.data.xpos, self.data.xmat)
            mujoco.mj_kinematics(self.model, self.data)
            self._place_feet(self._footing)
        mujoco.mj_forward(self.model, self.data)
        self._accelerometer = self.data.sensor("imu_accelerometer").data.copy()
        self._torque = self.torque
        self._sensors.reset()
        self._readings.clear()
        self._readings.append(self._reading())
        return self.state()

    def step(self, command: JointCommand, duration: float) -> RobotState:
        """Apply a joint command for a duration [s], rounded to whole physics steps, and return the new true state.

        With a delay, the drives follow the command that many physics steps later; only the first command after a reset
        acts at once. A command that is not finite is counted, and the previous command is held instead.
        """
        if command.is_finite:
            self._command = command
        else:
            self.rejected_commands += 1
        command = self._command
        kp, kd = self.variation.gain * command.kp, self.variation.gain * command.kd
        given = (kp, kd, command.tau + kp * command.q + kd * command.dq)
        if not self._pending:
            self._pending.extend([given] * self._delay)
        for _ in range(max(1, round(duration / self.timestep))):
            self._pending.append(given)
            self._drive(*self._pending.popleft())
            self._expire_forces()
            self.data.warning.number[:] = 0
            if self._footing is not None:
                self._place_feet(self._footing)
            mujoco.mj_step(self.model, self.data)
            self.diverged |= any(self.data.warning[w].number for w in DIVERGED)
            # The acceleration during this step; `mj_forward` computes that of the next one.
            self._accelerometer = self.data.sensor("imu_accelerometer").data.copy()
            self._torque = self.torque
            mujoco.mj_forward(self.model, self.data)
            self._readings.append(self._reading())
        return self.state()

    def _drive(self, kp: np.ndarray, kd: np.ndarray, constant: np.ndarray) -> None:
        """Set the PD law and the torque limits of the next physics step."""
        self.model.actuator_biasprm[:, 1] = -self.variation.strength * kp
        self.model.actuator_biasprm[:, 2] = -self.variation.strength * kd
        self.data.ctrl[:] = constant
        if self._limit is not None:
            self._limit.write(self.data.qvel[6:], self.model.actuator_forcerange)

    def push(self, velocity: np.ndarray) -> None:
        """Add to the pelvis velocity at once.

        Args:
            velocity: linear part in the world [m/s], shape (3,); or with the angular part in the pelvis [rad/s],
                shape (6,).
        """
        velocity = np.asarray(velocity, dtype=float)
        self.data.qvel[: velocity.size] += velocity
        mujoco.mj_forward(self.model, self.data)  # update the sensors

    def apply_force(self, force: np.ndarray, duration: float, link: str = "torso_link") -> None:
        """Pull a link with a force in the world frame [N], shape (3,), for a duration [s].

        Raises:
            UnknownNameError: if no link has that name.
        """
        links = [self.model.body(i).name for i in range(1, self.model.nbody)]
        if link not in links:
            raise UnknownNameError("link", link, links)
        body = self.model.body(link).id
        self.data.xfrc_applied[body, :3] = force
        self._force_until[body] = self.data.time + duration

    def _place_feet(self, footing: Footing) -> None:
        self.model.geom_pos[footing.geoms] = footing.positions(self.data.xpos, self.data.xmat)

    def _expire_forces(self) -> None:
        for body, until in list(self._force_until.items()):
            if self.data.time >= until - 1e-9:
                self.data.xfrc_applied[body] = 0.0
                del self._force_until[body]

    def _reading(self) -> Reading:
        d = self.data
        state = (float(d.time), d.qpos.copy(), d.qvel.copy(), d.sensordata.copy())
        return Reading(*state, self._accelerometer, self._torque)

    def state(self) -> RobotState:
        """Return the true state, with position, velocity and foot forces."""
        return self._sensors.truth(self._reading())

    def sense(self) -> RobotState:
        """Return the readings of `sensing.latency` ago, as the robot's sensors give them.

        Orientation and angular velocity are converted from the IMU to the pelvis. What the robot has no sensor for is
        None; `hugwbc.runtime.estimation` estimates it.
        """
        # Read the current state again: a push or a viewer may have changed it since the last step.
        reading = self._readings[0] if self.sensing.latency > 0.0 else self._reading()
        return dataclasses.replace(self._sensors.read(reading), age=float(self.data.time) - reading.time)

    @property
    def torque(self) -> np.ndarray:
        """Joint torques of the last physics step [N*m], shape (19,)."""
        return self.data.actuator_force.copy()

    @property
    def sole_velocity(self) -> np.ndarray:
        """Velocities of the left and the right sole's centre in the world [m/s], shape (2, 3)."""
        return np.stack([self.data.sensor(f"{side}_sole_velocity").data for side in SIDES])

    @property
    def pressure_centres(self) -> np.ndarray:
        """Centres of pressure of the left and the right foot in the world [m], shape (2, 3); NaN without contact."""
        centres, contact, wrench = np.full((2, 3), np.nan), self.data.contact, np.zeros(6)
        links = self.model.geom_bodyid[contact.geom]
        for foot, side in enumerate(SIDES):
            weighted, total = np.zeros(3), 0.0
            for index in np.flatnonzero(np.any(links == self.model.body(f"{side}_ankle_link").id, axis=1)):
                mujoco.mj_contactForce(self.model, self.data, int(index), wrench)
                weighted += wrench[0] * contact.pos[index]
                total += wrench[0]
            if total > 0.0:
                centres[foot] = weighted / total
        return centres

    def hand_position(self, side: str) -> np.ndarray:
        """Return the position of a hand in the world [m], shape (3,)."""
        return self.data.sensor(f"{side}_hand_position").data.copy()

    def ground_height(self, xy: np.ndarray) -> float:
        """Return the height of the ground at a point [m]."""
        return 0.0 if self.terrain is None else float(self.terrain.height_at(np.asarray(xy)))

    @property
    def fallen(self) -> bool:
        """Whether the robot has fallen: trunk contact, large inclination, low pelvis, or diverged physics."""
        state = self.state()
        assert state.position is not None
        return bool(
            self.diverged
            or abs(rotations.pitch_of(state.orientation)) > FALL_PITCH
            or abs(rotations.roll_of(state.orientation)) > FALL_ROLL
            or state.position[2] - self.ground_height(state.position[:2]) < FALL_HEIGHT
            or self._trunk_on_ground()
        )

    def _trunk_on_ground(self) -> bool:
        floor, torso = self.model.geom("floor").id, self.model.geom("torso_link").id
        contacts = self.data.contact.geom
        return bool(np.any(np.all(np.sort(contacts, axis=1) == sorted((floor, torso)), axis=1)))

"""One H1 in MuJoCo, driven by joint commands."""

import dataclasses

import mujoco
import numpy as np

from hugwbc import rotations
from hugwbc.controller import JointCommand
from hugwbc.errors import UnknownNameError
from hugwbc.robot import SIDES, load_robot
from hugwbc.sim.scene import SIMULATION_TIMESTEP, load_model
from hugwbc.sim.terrain import HeightField
from hugwbc.state import RobotState, pelvis_from_torso_imu

# The paper's early termination: trunk contact above 1 N, or inclinations beyond these; and a pelvis near the ground.
FALL_PITCH, FALL_ROLL, FALL_HEIGHT, TRUNK_FORCE = 1.0, 0.8, 0.45, 1.0
_WARNINGS = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)


@dataclasses.dataclass(frozen=True)
class SensorNoise:
    """Half-widths of the uniform noise on each reading (defaults: the paper's training noise).

    Attributes:
        angular_velocity: [rad/s].
        orientation: small rotation about each axis [rad].
        q: joint position [rad].
        dq: joint velocity [rad/s].
        position: pelvis position [m].
        velocity: pelvis velocity [m/s].
    """

    angular_velocity: float = 0.2
    orientation: float = 0.05
    q: float = 0.01
    dq: float = 1.5
    position: float = 0.0
    velocity: float = 0.0


class Simulation:
    """The H1 with PD joints, an IMU on the torso, foot sensors, pushes and a choice of ground.

    Attributes:
        model, data: MuJoCo's, for viewers and tests.
        robot: names, limits and gains.
        rejected_commands: how many joint commands were not finite; the last good one was held instead.
        diverged: whether the physics failed since the last reset (MuJoCo then restarts the state by itself).
    """

    def __init__(
        self,
        *,
        timestep: float = SIMULATION_TIMESTEP,
        terrain: HeightField | None = None,
        noise: SensorNoise | None = None,
        seed: int = 0,
    ) -> None:
        """Build the model and stand the robot up.

        Args:
            timestep: of the physics [s].
            terrain: the ground; None for a plane.
            noise: on what `sense` returns; None for exact readings.
            seed: of the noise.
        """
        self.robot = load_robot()
        self.terrain = terrain
        self.noise = noise
        self.model = load_model(timestep, terrain)
        self.data = mujoco.MjData(self.model)
        self.rejected_commands = 0
        self.diverged = False
        self._rng = np.random.default_rng(seed)
        self._pelvis = self.model.body("pelvis").id
        self._force_until: dict[int, float] = {}
        # With unit gain, the control is the whole affine torque; stiffness and damping go into the bias, where the
        # implicit integrator sees them.
        self.model.actuator_gainprm[:, 0] = 1.0
        self._command = JointCommand.position(self.robot, self.robot.nominal)
        self.reset()

    @property
    def timestep(self) -> float:
        """Of the physics [s]."""
        return self.model.opt.timestep

    def reset(
        self, *, xy: tuple[float, float] = (0.0, 0.0), yaw: float = 0.0, q: np.ndarray | None = None
    ) -> RobotState:
        """Stand the robot on the ground at `xy` [m], heading `yaw` [rad], at joint positions `q` (default nominal)."""
        mujoco.mj_resetDataKeyframe(self.model, self.data, 0)
        self.data.qpos[:2] = xy
        self.data.qpos[2] += self.ground_height(np.asarray(xy))
        self.data.qpos[3:7] = rotations.from_yaw_pitch_roll(yaw, 0.0, 0.0)
        if q is not None:
            self.data.qpos[7:] = q
        self.data.xfrc_applied[:] = 0.0
        self._force_until.clear()
        self.diverged = False
        self._command = JointCommand.position(self.robot, self.data.qpos[7:].copy())
        mujoco.mj_forward(self.model, self.data)
        return self.state()

    def step(self, command: JointCommand, duration: float) -> RobotState:
        """Apply a joint command for a duration [s], rounded to whole physics steps, and return the new true state.

        A command that is not finite is counted and the previous one is held.
        """
        if command.is_finite:
            self._command = command
        else:
            self.rejected_commands += 1
        command = self._command
        self.model.actuator_biasprm[:, 1] = -command.kp
        self.model.actuator_biasprm[:, 2] = -command.kd
        self.data.ctrl[:] = command.tau + command.kp * command.q + command.kd * command.dq
        for _ in range(max(1, round(duration / self.timestep))):
            self._expire_forces()
            self.data.warning.number[:] = 0
            mujoco.mj_step(self.model, self.data)
            self.diverged |= any(self.data.warning[w].number for w in _WARNINGS)
        mujoco.mj_forward(self.model, self.data)
        return self.state()

    def push(self, velocity: np.ndarray) -> None:
        """Change the pelvis velocity at once, in the world frame: [m/s], shape (3,), or with [rad/s], shape (6,)."""
        velocity = np.asarray(velocity, dtype=float)
        self.data.qvel[: velocity.size] += velocity
        mujoco.mj_forward(self.model, self.data)  # so that the sensors know

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

    def _expire_forces(self) -> None:
        for body, until in list(self._force_until.items()):
            if self.data.time >= until - 1e-9:
                self.data.xfrc_applied[body] = 0.0
                del self._force_until[body]

    def state(self) -> RobotState:
        """The true state, with position, velocity and foot forces."""
        qpos, qvel = self.data.qpos.copy(), self.data.qvel.copy()
        return RobotState(
            q=qpos[7:],
            dq=qvel[6:],
            orientation=qpos[3:7] / np.linalg.norm(qpos[3:7]),
            angular_velocity=qvel[3:6],
            position=qpos[:3],
            velocity=qvel[:3],
            foot_force=np.array([self._contact_force(f"{side}_foot_force") for side in SIDES]),
            time=float(self.data.time),
        )

    def sense(self) -> RobotState:
        """What the sensors say: encoders and the torso IMU, carried over to the pelvis, with noise if configured.

        Position and velocity of the pelvis stand for an estimator's; they carry their own noise.
        """
        truth = self.state()
        orientation, rate = pelvis_from_torso_imu(
            self.data.sensor("imu_orientation").data,
            self.data.sensor("imu_gyro").data,
            float(truth.q[self.robot.waist]),
            float(truth.dq[self.robot.waist]),
        )
        noise = self.noise or SensorNoise(0.0, 0.0, 0.0, 0.0)
        tilt = self._uniform(noise.orientation, 3)
        error = np.concatenate(([1.0], tilt / 2.0))
        assert truth.position is not None and truth.velocity is not None
        return dataclasses.replace(
            truth,
            q=truth.q + self._uniform(noise.q, 19),
            dq=truth.dq + self._uniform(noise.dq, 19),
            orientation=rotations.multiply(orientation, error / np.linalg.norm(error)),
            angular_velocity=rate + self._uniform(noise.angular_velocity, 3),
            position=truth.position + self._uniform(noise.position, 3),
            velocity=truth.velocity + self._uniform(noise.velocity, 3),
        )

    def _uniform(self, half_width: float, size: int) -> np.ndarray:
        return self._rng.uniform(-half_width, half_width, size) if half_width else np.zeros(size)

    def _contact_force(self, sensor: str) -> np.ndarray:
        # The sensor gives the force of the link on its surroundings; the reaction acts on the link.
        return -self.data.sensor(sensor).data

    @property
    def torque(self) -> np.ndarray:
        """Joint torques of the last physics step [N*m], shape (19,)."""
        return self.data.actuator_force.copy()

    def hand_position(self, side: str) -> np.ndarray:
        """Position of a hand in the world [m], shape (3,)."""
        return self.data.sensor(f"{side}_hand_position").data.copy()

    def ground_height(self, xy: np.ndarray) -> float:
        """Height of the ground at a point [m]."""
        return 0.0 if self.terrain is None else float(self.terrain.height_at(np.asarray(xy)))

    @property
    def fallen(self) -> bool:
        """Whether the robot is down: trunk contact, large inclination, pelvis near the ground, or diverged physics."""
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

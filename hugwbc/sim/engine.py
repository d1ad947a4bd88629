"""One robot in a physics engine: the interface of every engine, and what all engines share."""

import abc
import collections
import dataclasses
import importlib.util
import math
import pathlib
from typing import ClassVar

import numpy as np

from hugwbc import rotations
from hugwbc.controller import JointCommand
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.kinematics import Kinematics
from hugwbc.numeric import changed
from hugwbc.robot import SIDES, Robot, load_robot
from hugwbc.sim.actuators import Actuators
from hugwbc.sim.faults import Fault, FaultInjector
from hugwbc.sim.robot_model import SIMULATION_TIMESTEP, Variation, check_timestep
from hugwbc.sim.scenes.gripper import Gripper
from hugwbc.sim.scenes.objects import Objects
from hugwbc.sim.scenes.scene import Scene, load_scene
from hugwbc.sim.sensors import ROBOT, Reading, SensorProfile, Sensors, sensor_profile
from hugwbc.sim.terrain import Ground, HeightField
from hugwbc.state import RobotState

# A robot has fallen if it leans beyond these angles [rad] (the paper's early termination), or if its pelvis is below
# this share of its nominal height: 45 of the H1's 98 cm.
FALL_PITCH, FALL_ROLL, FALL_HEIGHT = 1.0, 0.8, 0.45 / 0.98
_ROUNDING = 1e-9  # [s], tolerance for rounding errors in sums of time steps
_LARGEST = 1e9  # [N*m], bound of a drive's input; if one is beyond 1e10, MuJoCo sets the inputs of all drives to 0


def check_seed(seed: int) -> None:
    """Refuse a seed that is below 0 or no whole number."""
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise ConfigError(f"seed is {seed}; give 0 or more, a whole number")


class Engine(abc.ABC):
    """One robot with PD joints, an IMU on base or trunk, and foot sensors; it can be pushed and pulled.

    Subclasses build their model in `_build`, where they fill `external_force` and `link_names`, and call `_clear` in
    `reset`. Everything that a controller, a rollout or a page reads is on this class; what belongs to one engine stays
    in its subclass.

    Attributes:
        engine: the engine's name, as in `--engine`.
        package: name of the Python package that it needs.
        robot: names, limits, gains and drives.
        actuators: what the drives do besides the PD law.
        variation: difference of this robot from its description.
        sensing: sensors of the robot.
        terrain: height field that the robot stands on; None for a plane at z = 0.
        ground: firmness of the ground.
        timestep: physics time step [s].
        link_names: names of the rows of `external_force`; the first is the world.
        external_force: forces at the links' centres of mass and torques, world frame [N, N*m], shape (links, 6);
            writable, and kept until it is changed.
        rejected_commands: number of joint commands that were not finite, not of the robot's size or beyond `_LARGEST`;
            the last valid one was held instead.
        diverged: whether the physics has failed since the last reset. What the robot does from then on means nothing.
        scene: the objects around the robot, as drawn for this episode; None without a scene.
        objects: their states, by name; empty without a scene.
        gripper: the idealised grippers of both hands; None without a scene.
    """

    engine: ClassVar[str]
    package: ClassVar[str]
    link_names: tuple[str, ...]
    external_force: np.ndarray
    scene: Scene | None = None
    objects: Objects
    gripper: Gripper | None = None

    def __init__(
        self,
        *,
        timestep: float = SIMULATION_TIMESTEP,
        terrain: HeightField | None = None,
        sensing: SensorProfile | str = ROBOT,
        latency: float | None = None,
        seed: int = 0,
        variation: Variation | None = None,
        robot: Robot | str | None = None,
        actuators: Actuators | None = None,
        ground: Ground | str | None = None,
        scene: Scene | str | pathlib.Path | None = None,
        faults: tuple[Fault, ...] = (),
    ) -> None:
        """Build the model and place the robot on the ground in the nominal pose.

        Args:
            timestep: time between two readings and joint commands [s]; in MuJoCo that of the physics, too.
            terrain: height field to stand on; None for a plane, the only ground of PhysX.
            sensing: sensors of the robot, or a profile's name (`hugwbc.sim.sensors.PROFILES`).
            latency: age of the results of `sense`, rounded to whole time steps [s]; None for the profile's.
            seed: random seed of the sensors' noise, biases and offsets, and of what varies in the scene.
            variation: difference of the robot from its description; None for no difference.
            robot: robot to simulate, or its name; None for the scene's, or the H1.
            actuators: drives of the joints; None for real ones.
            ground: firmness of the ground, or its name; None for the scene's, or firm, the only one of PhysX.
            scene: objects around the robot, or what `load_scene` takes, in MuJoCo only; None for none.
            faults: of the sensors and motors, in every episode.
        """
        robot = load_robot(robot) if isinstance(robot, str) else robot
        ground = Ground.named(ground) if isinstance(ground, str) else ground
        scene = load_scene(scene) if isinstance(scene, str | pathlib.Path) else scene
        robot, ground = self._surroundings(terrain, robot, ground, scene)
        check_timestep(timestep)
        profile = sensor_profile(sensing) if isinstance(sensing, str) else sensing
        if latency is not None:
            profile = dataclasses.replace(profile, latency=latency)
        check_seed(seed)
        self.timestep = timestep
        self.terrain = terrain
        self.sensing = profile
        self.variation = variation or Variation()
        self.robot = robot or load_robot()
        self.actuators = actuators or Actuators()
        self.ground = ground or Ground()
        self.rejected_commands = 0
        self.diverged = False
        self.objects = Objects()
        self._delay = self.actuators.delay_steps(self.robot, timestep)
        # Commands on the way to the drives, oldest first: stiffness, damping, and the constant part of the torque.
        self._pending: collections.deque[tuple[np.ndarray, np.ndarray, np.ndarray]] = collections.deque()
        self._declared_faults = faults
        self._seed_errors(seed)
        # Readings of the physics steps that the latency spans, oldest first, and the current one.
        self._readings: collections.deque[Reading] = collections.deque(maxlen=1 + round(profile.latency / timestep))
        self._force_until: dict[int, float] = {}
        self._take(JointCommand.position(self.robot, self.robot.nominal))
        self._build(seed, scene)

    @classmethod
    def is_available(cls) -> bool:
        """Return whether the engine is installed."""
        return importlib.util.find_spec(cls.package) is not None

    @classmethod
    def check_available(cls) -> None:
        """Check that the engine is installed."""
        if not cls.is_available():
            raise ConfigError(
                f"engine {cls.engine} needs {cls.package}: run `pip install 'hugwbc[{cls.engine}]'`, or use mujoco"
            )

    @abc.abstractmethod
    def _surroundings(
        self, terrain: HeightField | None, robot: Robot | None, ground: Ground | None, scene: Scene | None
    ) -> tuple[Robot | None, Ground | None]:
        """Return robot and ground, as given or as the scene asks for; refuse what the engine does not have."""

    @abc.abstractmethod
    def _build(self, seed: int, scene: Scene | None) -> None:
        """Build the model and reset; arguments as in the constructor."""

    @abc.abstractmethod
    def reset(
        self, *, xy: tuple[float, float] = (0.0, 0.0), yaw: float = 0.0, q: np.ndarray | None = None
    ) -> RobotState:
        """Place the robot on the ground at `xy` [m], with heading `yaw` [rad] and joint positions `q` [rad], (n,).

        By default the joints are nominal, and on a slope the ankles pitch by its angle along the heading.
        """

    @abc.abstractmethod
    def push(self, velocity: np.ndarray) -> None:
        """Add to the pelvis velocity at once.

        Args:
            velocity: linear part in the world [m/s], shape (3,); or with the angular part in the pelvis [rad/s],
                shape (6,).
        """

    @property
    def known_robot(self) -> Robot:
        """The robot as known to a controller or an estimator that is told this robot and its drives."""
        return self.actuators.known_robot(self.robot)

    @property
    @abc.abstractmethod
    def time(self) -> float:
        """Time since the last reset [s]."""

    @property
    @abc.abstractmethod
    def qpos(self) -> np.ndarray:
        """Pelvis position [m], quaternion (w, x, y, z) and joint positions [rad], shape (7 + n,)."""

    @property
    @abc.abstractmethod
    def qvel(self) -> np.ndarray:
        """Pelvis velocity in the world [m/s] and in the pelvis [rad/s], joint velocities [rad/s], shape (6 + n,)."""

    @property
    @abc.abstractmethod
    def torque(self) -> np.ndarray:
        """Torques of the drives by the last command that reached them [N*m], shape (n,)."""

    @property
    @abc.abstractmethod
    def pressure_centres(self) -> np.ndarray:
        """Centres of pressure of the left and the right foot in the world [m], shape (2, 3); NaN without contact."""

    @property
    @abc.abstractmethod
    def sole_velocity(self) -> np.ndarray:
        """Velocities of the left and the right sole's centre in the world [m/s], shape (2, 3)."""

    @abc.abstractmethod
    def hand_position(self, side: str) -> np.ndarray:
        """Return the position of a hand in the world [m], shape (3,)."""

    @abc.abstractmethod
    def _advance(self, kp: np.ndarray, kd: np.ndarray, constant: np.ndarray) -> None:
        """Make one physics step with torques `variation.strength (constant - kp q - kd dq)`, within their limits."""

    @abc.abstractmethod
    def _reading(self) -> Reading:
        """Return what perfect sensors say now."""

    @abc.abstractmethod
    def _trunk_on_ground(self) -> bool:
        """Return whether the torso touches the ground."""

    def step(self, command: JointCommand, duration: float) -> RobotState:
        """Apply a joint command for a duration [s], rounded to whole physics steps, and return the new true state."""
        # A copy: the numbers of an object that is given again may have changed, which `advance` would not notice.
        self.advance(changed(command), max(1, round(duration / self.timestep)))
        return self._sensors.truth(self._readings[-1])

    def advance(self, command: JointCommand, steps: int = 1) -> None:
        """Apply a joint command for some physics steps; the same object as before is taken to be the same command.

        The drives follow a command after their delay; only the first command after a reset acts at once. A command that
        cannot be used is counted, and the previous command is held instead.
        """
        if command is not self._command:
            fits = command.is_finite and command.q.size == self.robot.kp.size
            if not (fits and self._take(command)):
                self.rejected_commands += 1
        given = self._given
        if self._faults is not None:
            kp, kd, constant = given
            given = self._faults.drive(self.time, (kp.copy(), kd.copy(), constant.copy()))
        if not self._pending:
            self._pending.extend([given] * self._delay)
        for _ in range(steps):
            self._pending.append(given)
            if self._force_until:
                self._expire_forces()
            self._advance(*self._pending.popleft())
            self._readings.append(self._reading())

    def _take(self, command: JointCommand) -> bool:
        """Turn a command into what the drives follow until the next one: stiffness, damping and constant torque.

        Return whether it can be used.
        """
        gain = self.variation.gain
        kp, kd = gain * command.kp, gain * command.kd
        constant = command.tau + kp * command.q + kd * command.dq
        if not float(np.abs(constant).max()) < _LARGEST:
            return False
        self._command, self._given = command, (kp, kd, constant)
        return True

    def apply_force(self, force: np.ndarray, duration: float, link: str | None = None) -> None:
        """Pull a link, by default the trunk, with a force in the world frame [N], shape (3,), for a duration [s]."""
        links, link = self.link_names[1:], link or self.robot.trunk
        if link not in links:
            raise UnknownNameError("link", link, links)
        row = self.link_names.index(link)
        self.external_force[row, :3] = force
        self._force_until[row] = self.time + duration

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
        sensed = self._sensors.read(reading, self.time)
        return sensed if self._faults is None else self._faults.apply(sensed)

    @property
    def foot_force(self) -> np.ndarray:
        """Ground reaction on the left and the right foot after the last physics step, world frame [N], shape (2, 3)."""
        return self._readings[-1].foot_force

    def ground_height(self, xy: np.ndarray) -> float:
        """Return the height of the ground at a point [m]."""
        return 0.0 if self.terrain is None else float(self.terrain.height_at(np.asarray(xy)))

    @property
    def fallen(self) -> bool:
        """Whether the robot has fallen: trunk contact, large inclination, low pelvis, or diverged physics."""
        qpos = self.qpos
        orientation = qpos[3:7] / math.sqrt(qpos[3:7].dot(qpos[3:7]))
        return bool(
            self.diverged
            or abs(rotations.pitch_of(orientation)) > FALL_PITCH
            or abs(rotations.roll_of(orientation)) > FALL_ROLL
            or qpos[2] - self.ground_height(qpos[:2]) < FALL_HEIGHT * self.robot.nominal_height
            or self._trunk_on_ground()
        )

    def _seed_errors(self, seed: int) -> None:
        """Let the errors of the sensors, and what is random of the faults, be those of a seed."""
        self._sensors = Sensors(self.sensing, seed, self.robot)
        self._faults = FaultInjector(self._declared_faults, self.robot, seed) if self._declared_faults else None

    def _rise(self, q: np.ndarray) -> float:
        """Return how much higher than in the nominal pose the pelvis is if the soles touch the ground with joints q."""
        robot, kinematics, lowest = self.robot, Kinematics(self.robot), []
        half = (robot.sole_x[1] - robot.sole_x[0]) / 2.0, max(map(abs, robot.sole_y))
        for joints in (robot.nominal, q):
            kinematics.update(RobotState(joints, np.zeros_like(joints), np.eye(4)[0], np.zeros(3)))
            soles = [(kinematics.position(f"{side}_sole"), kinematics.rotation(f"{side}_sole")) for side in SIDES]
            lowest.append(min(float(place[2] - np.abs(turn[2, :2]) @ half) for place, turn in soles))
        return lowest[0] - lowest[1]

    def _clear(self, q: np.ndarray) -> None:
        """Forget forces and commands before a new run that starts with joint positions `q` [rad]."""
        self.external_force[:] = 0.0
        self._force_until.clear()
        self._pending.clear()
        self.diverged = False
        self._take(JointCommand.position(self.robot, q))

    def _start_sensors(self) -> None:
        """Draw the sensors' errors of a new run and take the first reading."""
        self._sensors.reset()
        if self._faults is not None:
            self._faults.reset()
        self._readings.clear()
        self._readings.append(self._reading())

    def _expire_forces(self) -> None:
        for row, until in list(self._force_until.items()):
            if self.time >= until - _ROUNDING:
                self.external_force[row] = 0.0
                del self._force_until[row]

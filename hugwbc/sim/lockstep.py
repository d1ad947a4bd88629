"""Many robots on a plane that each move exactly as the robot of a `Simulation` does."""

import collections
import copy
from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco.batch import Batch

from hugwbc import rotations
from hugwbc.robot import SIDES, Robot, load_robot
from hugwbc.sim.actuators import Actuators, TorqueSpeedLimit
from hugwbc.sim.batch import WARNING_COUNT
from hugwbc.sim.engine import FALL_HEIGHT, FALL_PITCH, FALL_ROLL
from hugwbc.sim.ground import Ground
from hugwbc.sim.layout import robot_layout
from hugwbc.sim.robot_model import load_model
from hugwbc.sim.simulation import DIVERGED
from hugwbc.sim.variation import Variation
from hugwbc.state import RobotState, pelvis_from_torso_imu

_VARIED_FIELDS = ("body_mass", "geom_friction", "actuator_forcerange")  # that `Variation.apply_to` writes to
_DIVERGED = [int(warning) for warning in DIVERGED]


class LockstepSimulation:
    """n robots that step together, equal to the last bit to n `Simulation`s on a plane with exact sensors.

    All arrays are live: they show the state after the last step.

    Attributes:
        model: model of the robot as described, for the names and numbers of its links.
        qpos, qvel: state of the robots, shapes (n, 26) and (n, 25).
        forces: external forces and torques on the bodies in the world [N, N*m], shape (n, bodies, 6); writable.
        torque: joint torques [N*m], shape (n, 19).
        diverged: which robots' physics failed, bool, shape (n,).
    """

    def __init__(
        self,
        variations: Sequence[Variation],
        kp: np.ndarray,
        kd: np.ndarray,
        *,
        timestep: float,
        threads: int = 1,
        robot: Robot | None = None,
        actuators: Actuators | None = None,
        ground: Ground | None = None,
    ) -> None:
        """Build the models and place every robot in the nominal pose.

        Args:
            variations: difference of each robot from its description.
            kp: joint stiffness for the whole run [N*m/rad], shape (n, 19).
            kd: joint damping for the whole run [N*m*s/rad], shape (n, 19).
            timestep: physics time step [s].
            threads: number of threads that share the robots.
            robot: robot to simulate; None for the H1.
            actuators: drives of the joints; None for real ones.
            ground: firmness of the ground; None for firm.
        """
        self.robot, actuators = robot or load_robot(), actuators or Actuators()
        self.model = load_model(timestep, lean=True, imu=True, robot=self.robot, actuators=actuators, ground=ground)
        self._layout = robot_layout(self.model, self.robot)
        self._batch = Batch(self.model, len(variations), threads, persistent=True)
        gain = np.array([variation.gain for variation in variations])[:, None]
        self._kp, self._kd = gain * kp, gain * kd
        self._strength = np.array([variation.strength for variation in variations])[:, None]
        self._vary(variations)
        self._batch.reset(keyframe=0)
        self._set_gains()
        self.qpos = self._batch.bind("qpos")[:, self._layout.qpos]
        self.qvel = self._batch.bind("qvel")[:, self._layout.qvel]
        self.forces = self._batch.bind("xfrc_applied")
        self.torque = self._batch.bind("actuator_force")[:, self._layout.ctrl]
        self._ctrl = self._batch.bind("ctrl")[:, self._layout.ctrl]
        self._given = self._ctrl.copy()
        # Controls on the way to the drives, oldest first; of the whole batch, since all robots step together.
        self._pending: collections.deque[np.ndarray] = collections.deque()
        self._delay = actuators.delay_steps(self.robot, timestep)
        self._limit: TorqueSpeedLimit | None = None
        if actuators.torque_speed:
            self._force_range = self._batch.expand("actuator_forcerange")[:, self._layout.ctrl]
            self._limit = TorqueSpeedLimit(self.robot, self._force_range[:, :, 1])
        self._sensors = self._batch.bind("sensordata")
        self.diverged = np.zeros(len(variations), dtype=bool)
        self._index_sensors()

    def _vary(self, variations: Sequence[Variation]) -> None:
        """Give every robot its own mass, friction, torque limits and motor strength."""
        models: dict[Variation, mujoco.MjModel] = {}
        fields = {name: self._batch.expand(name) for name in _VARIED_FIELDS}
        for row, variation in enumerate(variations):
            if variation not in models:
                models[variation] = copy.copy(self.model)
                variation.apply_to(models[variation])
            for name, values in fields.items():
                values[row] = getattr(models[variation], name)
        if any(variation.payload for variation in variations):
            self._batch.set_const()
        self._batch.expand("actuator_gainprm")[:, self._layout.ctrl, 0] = self._strength

    def _set_gains(self) -> None:
        """Set the gains after the reset: `Simulation` resets with the description's gains, before its first command."""
        bias = self._batch.expand("actuator_biasprm")[:, self._layout.ctrl]
        bias[:, :, 1] = -self._strength * self._kp
        bias[:, :, 2] = -self._strength * self._kd

    def _index_sensors(self) -> None:
        columns = {
            self.model.sensor(i).name: np.arange(adr, adr + dim)
            for i, (adr, dim) in enumerate(zip(self.model.sensor_adr, self.model.sensor_dim, strict=True))
        }
        self._foot_force, self._soles, self._sole_velocity = (
            np.stack([columns[f"{side}_{kind}"] for side in SIDES])
            for kind in ("foot_force", "sole_position", "sole_velocity")
        )
        self._imu_orientation, self._imu_gyro = columns["imu_orientation"], columns["imu_gyro"]

    def command(self, rows: np.ndarray, q: np.ndarray, dq: np.ndarray, tau: np.ndarray | float = 0.0) -> None:
        """Set the joint targets and the feed-forward torques of some robots.

        Args:
            rows: indices of the robots, shape (m,).
            q: position targets [rad], shape (m, 19).
            dq: velocity targets [rad/s], shape (m, 19).
            tau: torques [N*m], shape (m, 19).
        """
        self._given[rows] = tau + self._kp[rows] * q + self._kd[rows] * dq

    def step(self, rows: np.ndarray) -> None:
        """Advance some robots, shape (m,), by one time step and update everything that can be read."""
        given = self._given.copy()
        if not self._pending:
            self._pending.extend([given] * self._delay)  # the first command acts at once, as in `Simulation`
        self._pending.append(given)
        self._ctrl[rows] = self._pending.popleft()[rows]
        if self._limit is not None:
            self._limit.write(self.qvel[:, 6:], self._force_range)
        self._batch.warning[rows] = 0
        # Stages that depend on position and velocity are computed once and serve the next step too.
        self._batch.step(ids=rows, stage=mujoco.mjtStage.mjSTAGE_ACC)
        self.diverged[rows] |= self._batch.warning[rows][:, _DIVERGED, WARNING_COUNT].any(axis=1)

    def orientation(self, rows: np.ndarray) -> np.ndarray:
        """Return the rotation from the pelvis to the world of some robots, unit quaternions, shape (m, 4)."""
        quaternion = self.qpos[rows, 3:7]
        return quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)

    def sensed(self, row: int) -> RobotState:
        """Return what the exact sensors of one robot say, as `Simulation.sense` does, to the last bit.

        Orientation and angular velocity are those of the torso's IMU, carried over to the pelvis, and thus rounded
        differently from those in `qpos` and `qvel`.
        """
        qpos, qvel, one = self.qpos[row], self.qvel[row], np.array([row])
        waist = self.robot.waist
        sensors = self._sensors[row]
        orientation, rate = pelvis_from_torso_imu(
            sensors[self._imu_orientation], sensors[self._imu_gyro], float(qpos[7 + waist]), float(qvel[6 + waist])
        )
        return RobotState(
            q=qpos[7:].copy(),
            dq=qvel[6:].copy(),
            orientation=orientation,
            angular_velocity=rate,
            position=qpos[:3].copy(),
            velocity=qvel[:3].copy(),
            foot_force=self.foot_force(one)[0],
        )

    def foot_force(self, rows: np.ndarray) -> np.ndarray:
        """Return the ground reaction on both feet of some robots in the world [N], shape (m, 2, 3)."""
        # The sensor measures the force of the link on its surroundings; the ground reaction is the opposite.
        return -self._sensors[rows[:, None, None], self._foot_force]

    def sole_height(self, rows: np.ndarray) -> np.ndarray:
        """Return the heights of both sole centres of some robots [m], shape (m, 2)."""
        return self._sensors[rows[:, None, None], self._soles][..., 2]

    def sole_velocity(self, rows: np.ndarray) -> np.ndarray:
        """Return the velocities of both sole centres of some robots in the world [m/s], shape (m, 2, 3)."""
        return self._sensors[rows[:, None, None], self._sole_velocity]

    def fallen(self, rows: np.ndarray) -> np.ndarray:
        """Return which of some robots have fallen as in `Simulation.fallen`, bool, shape (m,).

        Contacts of the trunk need no check: on a plane it leans too far or the pelvis is too low before it touches.
        """
        orientation = self.orientation(rows)
        return (
            self.diverged[rows]
            | (np.abs(rotations.pitch_of(orientation)) > FALL_PITCH)
            | (np.abs(rotations.roll_of(orientation)) > FALL_ROLL)
            | (self.qpos[rows, 2] < FALL_HEIGHT)
        )

"""Many robots on a plane that each move exactly as the robot of a `Simulation` does."""

import copy
from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco.batch import Batch

from hugwbc import rotations
from hugwbc.robot import SIDES
from hugwbc.sim.batch import WARNING_COUNT
from hugwbc.sim.scene import load_model
from hugwbc.sim.simulation import DIVERGED, FALL_HEIGHT, FALL_PITCH, FALL_ROLL
from hugwbc.sim.variation import Variation

_DIVERGED = [int(warning) for warning in DIVERGED]


class LockstepSimulation:
    """n robots that step together, equal to the last bit to n `Simulation`s on a plane with exact sensors.

    All arrays are live: they show the state after the last step.

    Attributes:
        model: model of the robot as described, for the names and numbers of its links.
        qpos, qvel: state, shapes (n, 26) and (n, 25).
        forces: external forces and torques on the bodies in the world [N, N*m], shape (n, bodies, 6); writable.
        torque: joint torques [N*m], shape (n, 19).
        diverged: which robots' physics failed, bool, shape (n,).
    """

    def __init__(
        self, variations: Sequence[Variation], kp: np.ndarray, kd: np.ndarray, *, timestep: float, threads: int = 1
    ) -> None:
        """Build the models and place every robot in the nominal pose.

        Args:
            variations: difference of each robot from its description.
            kp: joint stiffness for the whole run [N*m/rad], shape (n, 19).
            kd: joint damping for the whole run [N*m*s/rad], shape (n, 19).
            timestep: physics time step [s].
            threads: number of threads that share the robots.
        """
        self.model = load_model(timestep, lean=True)
        self._batch = Batch(self.model, len(variations), threads, persistent=True)
        models = self._set_models(variations, kp, kd)
        self._batch.reset(keyframe=0)
        self._set_gains(models, variations)
        self.qpos, self.qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self.forces = self._batch.bind("xfrc_applied")
        self.torque = self._batch.bind("actuator_force")
        self._ctrl = self._batch.bind("ctrl")
        self._sensors = self._batch.bind("sensordata")
        self.diverged = np.zeros(len(variations), dtype=bool)
        self._index_sensors()

    def _set_models(self, variations: Sequence[Variation], kp: np.ndarray, kd: np.ndarray) -> list[mujoco.MjModel]:
        """Set the models, one for each group of identical robots, and return the model of each robot."""
        gain = np.array([variation.gain for variation in variations])[:, None]
        self._kp, self._kd = gain * kp, gain * kd
        alike: dict[tuple[Variation, bytes, bytes], mujoco.MjModel] = {}
        models = []
        for variation, stiffness, damping in zip(variations, self._kp, self._kd, strict=True):
            key = (variation, stiffness.tobytes(), damping.tobytes())
            if key not in alike:
                alike[key] = copy.copy(self.model)
                variation.apply_to(alike[key])
                alike[key].actuator_gainprm[:, 0] = variation.strength
            models.append(alike[key])
        self._batch.set_models(models)
        return models

    def _set_gains(self, models: list[mujoco.MjModel], variations: Sequence[Variation]) -> None:
        """Set the gains after the reset: `Simulation` resets with the description's gains, before its first command."""
        for model, variation, stiffness, damping in zip(models, variations, self._kp, self._kd, strict=True):
            model.actuator_biasprm[:, 1] = -variation.strength * stiffness
            model.actuator_biasprm[:, 2] = -variation.strength * damping
        self._batch.set_models(models)

    def _index_sensors(self) -> None:
        columns = {
            self.model.sensor(i).name: np.arange(adr, adr + dim)
            for i, (adr, dim) in enumerate(zip(self.model.sensor_adr, self.model.sensor_dim, strict=True))
        }
        self._foot_force, self._soles = (
            np.stack([columns[f"{side}_{kind}"] for side in SIDES]) for kind in ("foot_force", "sole_position")
        )

    def command(self, rows: np.ndarray, q: np.ndarray, dq: np.ndarray) -> None:
        """Set the joint targets of some robots.

        Args:
            rows: indices of the robots, shape (m,).
            q: position targets [rad], shape (m, 19).
            dq: velocity targets [rad/s], shape (m, 19).
        """
        self._ctrl[rows] = self._kp[rows] * q + self._kd[rows] * dq

    def step(self, rows: np.ndarray) -> None:
        """Advance some robots, shape (m,), by one time step and update everything that can be read."""
        self._batch.warning[rows] = 0
        # Stages that depend on position and velocity are computed once and serve the next step too.
        self._batch.step(ids=rows, stage=mujoco.mjtStage.mjSTAGE_ACC)
        self.diverged[rows] |= self._batch.warning[rows][:, _DIVERGED, WARNING_COUNT].any(axis=1)

    def orientation(self, rows: np.ndarray) -> np.ndarray:
        """Return the rotation from the pelvis to the world of some robots, unit quaternions, shape (m, 4)."""
        quaternion = self.qpos[rows, 3:7]
        return quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)

    def foot_force(self, rows: np.ndarray) -> np.ndarray:
        """Return the ground reaction on both feet of some robots in the world [N], shape (m, 2, 3)."""
        # The sensor measures the force of the link on its surroundings; the ground reaction is the opposite.
        return -self._sensors[rows[:, None, None], self._foot_force]

    def sole_height(self, rows: np.ndarray) -> np.ndarray:
        """Return the heights of both sole centres of some robots [m], shape (m, 2)."""
        return self._sensors[rows[:, None, None], self._soles][..., 2]

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

"""Many H1s at once on `mujoco_warp`: the interface of `sim.batch` with the physics on a GPU."""

import dataclasses
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import MODEL_FIELDS, Batch

from hugwbc.errors import ConfigError
from hugwbc.robot import Robot, load_robot
from hugwbc.sim.actuators import Actuators
from hugwbc.sim.batch import BatchSimulation
from hugwbc.sim.layout import robot_layout
from hugwbc.sim.scene import TRAINING_TIMESTEP, Ground, load_model
from hugwbc.sim.terrain import HeightField

CONTACTS = 64  # room for the contacts of one robot; a robot that lies on the ground has about 40
CONSTRAINTS = 4 * CONTACTS + 64  # constraint rows: four for each contact, and the joint limits
_RUNAWAY = float(mujoco.mjMAXVAL)  # MuJoCo's limit for positions and velocities


def _warp(device: str) -> tuple[Any, Any]:
    """Return the optional modules warp and mujoco_warp if they can run on the device."""
    try:
        import mujoco_warp
        import warp
    except ImportError as error:
        raise ConfigError(f"physics on a GPU needs {error.name}: run `pip install 'hugwbc[gpu]'`") from error
    warp.config.quiet = True
    warp.init()
    if device != "cpu" and not warp.is_cuda_available():
        raise ConfigError(f"device {device} needs an NVIDIA GPU with its driver; none was found. Use --device cpu")
    return warp, mujoco_warp


class WarpSimulation(BatchSimulation):
    """A batch of robots on the same ground, stepped in single precision on a device.

    The interface is that of `BatchSimulation`. Arrays are in host memory and are exchanged with the device at every
    call. Set model parameters of single robots on `batch` before the first step; later changes have no effect. `batch`
    is an ordinary `mujoco.batch.Batch` that is never stepped.
    """

    def __init__(
        self,
        count: int,
        *,
        timestep: float = TRAINING_TIMESTEP,
        terrain: HeightField | None = None,
        device: str = "cuda",
        robot: Robot | None = None,
        actuators: Actuators | None = None,
        ground: Ground | None = None,
    ) -> None:
        """Build the batch.

        Args:
            count: number of robots.
            timestep: physics time step [s].
            terrain: height field to stand on; None for a plane.
            device: warp's device: "cuda", or "cpu" for tests (its first use compiles for minutes).
            robot: robot to simulate; None for the H1.
            actuators: drives of the joints; None for real ones without a torque-speed limit. Their delay is left to the
                caller, who sets `ctrl`.
            ground: firmness of the ground; None for firm.

        Raises:
            ConfigError: if mujoco_warp or the device is missing, or the drives have a torque-speed limit.
        """
        actuators = actuators or dataclasses.replace(Actuators(), torque_speed=False)
        if actuators.torque_speed:
            raise ConfigError("physics on a GPU has no torque-speed limit; use --device cpu, or other drives")
        self._wp, self._mjw = _warp(device)
        self._device = device
        self.robot = robot or load_robot()
        self.model = load_model(timestep, terrain, lean=True, robot=self.robot, actuators=actuators, ground=ground)
        self.terrain = terrain
        self.batch = Batch(self.model, count, 1)
        self._index_sensors()
        nominal = self.model.key("nominal")
        self.layout = robot_layout(self.model, self.robot)
        self._qpos, self._ctrl = np.tile(nominal.qpos, (count, 1)), np.tile(nominal.ctrl, (count, 1))
        self._qvel, self.warm_start = np.zeros((count, self.model.nv)), np.zeros((count, self.model.nv))
        self._torque = np.zeros((count, self.model.nu))
        # The robot's parts of these arrays are views.
        self.qpos, self.qvel = self._qpos[:, self.layout.qpos], self._qvel[:, self.layout.qvel]
        self.ctrl, self.torque = self._ctrl[:, self.layout.ctrl], self._torque[:, self.layout.ctrl]
        self._sensors = np.zeros((count, self.model.nsensordata))
        with self._wp.ScopedDevice(device):
            start = mujoco.MjData(self.model)
            self._data = self._mjw.put_data(self.model, start, nworld=count, nconmax=CONTACTS, njmax=CONSTRAINTS)
            self._on_device = self._mjw.put_model(self.model)
        self._stepped = False
        self.forward(np.arange(count))

    def step(self, substeps: int, targets: np.ndarray | None = None) -> np.ndarray:
        """Advance all robots and update everything that depends on positions and velocities.

        A robot whose state is not finite or too large is reset to the nominal pose, as MuJoCo does.

        Args:
            substeps: number of physics steps.
            targets: joint targets of every physics step [rad], shape (substeps, count, 19); None for `ctrl` in all.

        Returns:
            Which robots diverged, bool, shape (count,).
        """
        diverged = ~np.isfinite(self.ctrl).all(axis=1)
        self.ctrl[diverged] = 0.0
        mjw, model, data = self._mjw, self._on_device, self._data
        with self._wp.ScopedDevice(self._device):
            self._upload()
            self._stepped = True
            for substep in range(substeps):
                if targets is not None:
                    self.ctrl[:] = targets[substep]
                    data.ctrl.assign(self._ctrl.astype(np.float32))
                mjw.step(model, data)
            self._download_state()
            diverged |= self._restart_runaways()
            # After a step, quantities derived from the state are one substep old.
            mjw.fwd_position(model, data)
            mjw.sensor_pos(model, data)
            mjw.fwd_velocity(model, data)
            mjw.sensor_vel(model, data)
            self._torque[:] = data.actuator_force.numpy()
            self._sensors[:] = data.sensordata.numpy()
        return diverged

    def forward(self, ids: np.ndarray) -> None:
        """Recompute the derived quantities of some robots after their state was written."""
        data = self._data
        with self._wp.ScopedDevice(self._device):
            self._upload()
            # The device recomputes all robots; the others keep the results of their last step.
            self._mjw.forward(self._on_device, data)
            self.warm_start[ids] = data.qacc_warmstart.numpy()[ids]
            self._torque[ids] = data.actuator_force.numpy()[ids]
            self._sensors[ids] = data.sensordata.numpy()[ids]

    def _upload(self) -> None:
        """Send the state and controls to the device, and before the first step the robots' model parameters."""
        for name in () if self._stepped else MODEL_FIELDS:
            values = None if name.startswith("opt.") else self.batch.expanded(name)
            shared = getattr(self._on_device, name, None)
            if values is not None and shared is not None:
                setattr(self._on_device, name, self._wp.array(values.astype(np.float32), dtype=shared.dtype))
        arrays = {"qpos": self._qpos, "qvel": self._qvel, "ctrl": self._ctrl, "qacc_warmstart": self.warm_start}
        for name, values in arrays.items():
            getattr(self._data, name).assign(values.astype(np.float32))

    def _download_state(self) -> None:
        self._qpos[:], self._qvel[:] = self._data.qpos.numpy(), self._data.qvel.numpy()
        self.warm_start[:] = self._data.qacc_warmstart.numpy()

    def _restart_runaways(self) -> np.ndarray:
        state = np.hstack((self._qpos, self._qvel))
        # The comparison is false for NaN, so such a robot counts as lost.
        lost = np.logical_not((np.abs(state) < _RUNAWAY).all(axis=1))
        if lost.any():
            self._qpos[lost], self._qvel[lost] = self.model.key("nominal").qpos, 0.0
            self.warm_start[lost] = 0.0
            self._upload()
        return lost


def robots_on(
    device: str,
    count: int,
    *,
    terrain: HeightField | None,
    threads: int,
    robot: Robot | None = None,
    actuators: Actuators | None = None,
    ground: Ground | None = None,
    timestep: float = TRAINING_TIMESTEP,
) -> BatchSimulation:
    """Build a batch of robots for training, on the processor or on a GPU.

    Args:
        device: "cpu" for `mujoco.batch`, "cuda" for `mujoco_warp`.
        count: number of robots.
        terrain: height field to stand on; None for a plane.
        threads: number of threads on the processor.
        robot: robot to simulate; None for the H1.
        actuators: drives of the joints; None for the default of the device's class.
        ground: firmness of the ground; None for firm.
        timestep: physics time step [s].

    Raises:
        ConfigError: if the device cannot be used.
    """
    if device == "cpu":
        return BatchSimulation(
            count, timestep=timestep, terrain=terrain, threads=threads, robot=robot, actuators=actuators, ground=ground
        )
    return WarpSimulation(
        count, timestep=timestep, terrain=terrain, device=device, robot=robot, actuators=actuators, ground=ground
    )

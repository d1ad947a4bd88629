"""Many robots at once: what every engine offers, and the engine of the processor, `mujoco.batch`."""

import abc
import functools
import warnings
from typing import Any, NamedTuple

import mujoco
import numpy as np
import torch
from mujoco.batch import Batch

from hugwbc.robot import SIDES, Robot
from hugwbc.sim.actuators import Actuators, TorqueSpeedLimit
from hugwbc.sim.footing import Footing
from hugwbc.sim.robot_model import TRAINING_TIMESTEP, load_model, robot_layout
from hugwbc.sim.simulation import DIVERGED
from hugwbc.sim.terrain import Ground, HeightField

# Robots per thread in a block. A block goes through all substeps before the next one: its data then stay in the cache.
_BLOCK = 16
_FAULTS = [int(warning) for warning in (*DIVERGED, mujoco.mjtWarning.mjWARN_BADCTRL)]
WARNING_COUNT = 1  # column of MuJoCo's warning table with the number of warnings; column 0 holds the last index


class _Block(NamedTuple):
    """A block of robots: rows, torque-speed limit, and live views of joint speeds and torque ranges."""

    rows: slice
    ids: np.ndarray
    limit: TorqueSpeedLimit | None
    velocity: np.ndarray
    force_range: np.ndarray


class RobotBatch(abc.ABC):
    """A batch of robots on the same ground.

    All tensors are on the engine's device, in its precision, and live: they show the state after the last step.

    Attributes:
        model: the model that all robots share; `expand` gives each robot values of its own for a field.
        layout: place of the robot in the model's state.
        count: number of robots.
        qpos, qvel: state of the robot with n joints, shapes (count, 7 + n) and (count, 6 + n); writable, call `forward`
            afterwards.
        ctrl: position targets of the PD joints [rad], shape (count, n); writable.
        torque: joint torques of the last physics step [N*m], shape (count, n).
        forces: external forces and torques on the bodies in the world [N, N*m], shape (count, bodies, 6); writable.
        warm_start: starting point of the constraint solver, shape (count, 6 + n); needed to resume bit by bit.
    """

    qpos: torch.Tensor
    qvel: torch.Tensor
    ctrl: torch.Tensor
    torque: torch.Tensor
    forces: torch.Tensor
    warm_start: torch.Tensor
    # Sensors of positions and velocities, and of forces; an engine may keep them apart.
    _sensors: torch.Tensor
    _force_sensors: torch.Tensor
    _geom_pos: torch.Tensor
    _footing: Footing | None

    def __init__(
        self,
        count: int,
        *,
        timestep: float = TRAINING_TIMESTEP,
        terrain: HeightField | None = None,
        robot: Robot,
        actuators: Actuators | None = None,
        ground: Ground | None = None,
    ) -> None:
        """Compile the model (`load_model`); the delay of the drives is left to the caller, who sets `ctrl`."""
        self.count, self.terrain = count, terrain
        self.robot, actuators = robot, actuators or Actuators()
        self.model = load_model(timestep, terrain, lean=True, robot=self.robot, actuators=actuators, ground=ground)
        self.layout = robot_layout(self.model, self.robot)
        self._limited = actuators.torque_speed

    def _index_sensors(self) -> None:
        """Find the columns of the sensor data."""
        m = self.model
        columns = {
            m.sensor(i).name: range(m.sensor_adr[i], m.sensor_adr[i] + m.sensor_dim[i]) for i in range(m.nsensor)
        }

        def of(names: list[str]) -> torch.Tensor:
            return torch.tensor([column for name in names for column in columns[name]], device=self.device)

        kinds = ("sole_position", "sole_velocity", "foot_force")
        self._both_feet = {kind: of([f"{side}_{kind}" for side in SIDES]) for kind in kinds}
        self._link_forces = of([f"{name}_force" for name in self.robot.contact_links])

    @property
    def device(self) -> torch.device:
        """Device of all tensors."""
        return self.qpos.device

    @property
    def nominal_qpos(self) -> np.ndarray:
        """Nominal stand at the origin, as in `qpos`, shape (7 + n,)."""
        return self.model.key("nominal").qpos[self.layout.qpos].copy()

    def tensor(self, values: np.ndarray | torch.Tensor) -> torch.Tensor:
        """Return numbers on the device and in the precision of the state."""
        return torch.as_tensor(np.array(values) if isinstance(values, np.ndarray) else values).to(self.qpos)

    @abc.abstractmethod
    def expand(self, name: str) -> torch.Tensor:
        """Return a field of the model with a value for each robot, shape (count, ...), live and writable."""

    @abc.abstractmethod
    def set_const(self, ids: torch.Tensor | None = None) -> None:
        """Recompute what depends on masses after they were written, for these robots alone if the engine can."""

    @abc.abstractmethod
    def step(self, substeps: int, targets: torch.Tensor | None = None) -> torch.Tensor:
        """Advance all robots and update everything that depends on positions and velocities.

        Args:
            substeps: number of physics steps.
            targets: joint targets of every physics step [rad], shape (substeps, count, n); None for `ctrl` in all.

        Returns:
            Which robots diverged, bool, shape (count,).
        """

    @abc.abstractmethod
    def forward(self, ids: torch.Tensor) -> None:
        """Recompute the derived quantities of some robots after their state was written."""

    @abc.abstractmethod
    def link_poses(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return world origins [m], rotations (count, bodies, 3, 3) and centres of mass [m] of all bodies, live."""

    @property
    def footing(self) -> torch.Tensor:
        """Positions of the contact spheres and their plane in the last contact search, for `restore_footing`."""
        return self.qpos.new_zeros(0) if self._footing is None else self._geom_pos[:, self._footing.geoms]

    @abc.abstractmethod
    def restore_footing(self, footing: torch.Tensor) -> None:
        """Set a value of `footing` and search for contacts; needed to resume bit by bit on terrain."""

    def faults(self) -> str:
        """Return in words what the engine left out since the last call; empty if nothing. This waits for a GPU."""
        return ""

    def sole_position(self) -> torch.Tensor:
        """Return the centres of both soles in the world [m], shape (count, 2, 3)."""
        return self._sensors[:, self._both_feet["sole_position"]].reshape(-1, 2, 3)

    def sole_velocity(self) -> torch.Tensor:
        """Return the velocities of both sole centres in the world [m/s], shape (count, 2, 3)."""
        return self._sensors[:, self._both_feet["sole_velocity"]].reshape(-1, 2, 3)

    def foot_force(self) -> torch.Tensor:
        """Return the ground reaction on both feet in the world [N], shape (count, 2, 3)."""
        # The sensor measures the force of the link on its surroundings; the ground reaction is the opposite.
        return -self._force_sensors[:, self._both_feet["foot_force"]].reshape(-1, 2, 3)

    def link_force(self) -> torch.Tensor:
        """Return the magnitude of the contact force on each of `Robot.contact_links` [N], shape (count, links)."""
        return self._force_sensors[:, self._link_forces].reshape(self.count, -1, 3).square().sum(2).sqrt()


class BatchSimulation(RobotBatch):
    """The robots on `mujoco.batch`, in double precision; the tensors are views of MuJoCo's arrays."""

    def __init__(self, count: int, *, threads: int = 1, **settings: Any) -> None:  # noqa: ANN401
        """Build the batch on `threads` threads, 0 for one per processor, with the settings of `RobotBatch`."""
        super().__init__(count, **settings)
        # With persistent data, a step reuses the position and velocity stages that the last step has computed.
        self.batch = Batch(self.model, count, threads, persistent=True)
        self._velocity = self.batch.bind("qvel")[:, self.layout.rates]
        self._targets = self.batch.bind("ctrl")[:, self.layout.ctrl]
        self.qpos = self._bind("qpos")[:, self.layout.qpos]
        self.qvel = self._bind("qvel")[:, self.layout.qvel]
        self.ctrl = torch.from_numpy(self._targets)
        self.torque = self._bind("actuator_force")[:, self.layout.ctrl]
        self.forces = self._bind("xfrc_applied")
        self.warm_start = self._bind("qacc_warmstart")
        self._sensors = self._force_sensors = self._bind("sensordata")
        self._index_sensors()
        self._footing = None if self.terrain is None else Footing(self.model, self.terrain)
        if self._footing is not None:
            self._geom_pos = self.expand("geom_pos")
            self._xpos, self._xmat = self.batch.bind("xpos"), self.batch.bind("xmat")
        self._poses: tuple[torch.Tensor, torch.Tensor, torch.Tensor] | None = None
        self.batch.reset(keyframe=0)

    def _bind(self, name: str) -> torch.Tensor:
        """Return a live field of the data, without torch's warning that some fields are read-only."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            return torch.from_numpy(self.batch.bind(name))

    @functools.cached_property
    def _blocks(self) -> list[_Block]:
        """Divide the robots into blocks, each with the torque-speed limit of its robots, if there is one.

        The torque limits are read at the first step, so that a randomisation has to come before it.
        """
        source = self.batch.expand("actuator_forcerange") if self._limited else self.model.actuator_forcerange[None]
        force_range, blocks = source[:, self.layout.ctrl], []
        size = _BLOCK * max(1, self.batch.nthread)
        for start in range(0, self.count, size):
            rows = slice(start, min(start + size, self.count))
            limit = TorqueSpeedLimit(self.robot, force_range[rows, :, 1]) if self._limited else None
            blocks.append(
                _Block(rows, np.arange(rows.start, rows.stop), limit, self._velocity[rows], force_range[rows])
            )
        return blocks

    def expand(self, name: str) -> torch.Tensor:  # noqa: D102
        return torch.from_numpy(self.batch.expand(name))

    def set_const(self, ids: torch.Tensor | None = None) -> None:  # noqa: D102
        self.batch.set_const(ids=None if ids is None else ids.numpy())

    def step(self, substeps: int, targets: torch.Tensor | None = None) -> torch.Tensor:
        """Advance all robots; return which diverged.

        MuJoCo silently resets a simulation that diverges. Only its warning counters show it, so they are cleared first.
        """
        self._place_feet(np.arange(self.count))
        self.batch.warning[:] = 0
        if targets is None and not self._limited:
            self.batch.step(nstep=substeps, stage=mujoco.mjtStage.mjSTAGE_VEL)
        else:
            for block in self._blocks:
                self._step_block(block, substeps, None if targets is None else targets.numpy())
        return torch.from_numpy(self.batch.warning[:, _FAULTS, WARNING_COUNT].any(axis=1))

    def _step_block(self, block: _Block, substeps: int, targets: np.ndarray | None) -> None:
        for substep in range(substeps):
            if targets is not None:
                self._targets[block.rows] = targets[substep, block.rows]
            if block.limit is not None:
                block.limit.write(block.velocity, block.force_range)
            self.batch.step(ids=block.ids, stage=mujoco.mjtStage.mjSTAGE_VEL)

    def forward(self, ids: torch.Tensor) -> None:  # noqa: D102
        rows = ids.numpy()
        self.batch.forward(ids=rows)
        if self._footing is not None:
            self._place_feet(rows)
            self.batch.forward(ids=rows)

    def link_poses(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:  # noqa: D102
        if self._poses is None:  # a bound field costs time in every step from here on
            position, matrix, centre = (self._bind(name) for name in ("xpos", "xmat", "xipos"))
            self._poses = position, matrix.unflatten(2, (3, 3)), centre
            self.batch.forward()  # a newly bound field is filled by the next call
        return self._poses

    def _place_feet(self, ids: np.ndarray) -> None:
        if self._footing is not None and ids.size:
            positions = self._footing.positions(self._xpos[ids], self._xmat[ids])
            self._geom_pos.numpy()[ids[:, None], self._footing.geoms] = positions

    def restore_footing(self, footing: torch.Tensor) -> None:  # noqa: D102
        if self._footing is not None:
            self._geom_pos[:, self._footing.geoms] = footing.to(self._geom_pos)
            self.batch.forward()

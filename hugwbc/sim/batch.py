"""Many H1s at once on `mujoco.batch`: live state arrays, model parameters per robot, and divergence checks."""

from typing import NamedTuple

import mujoco
import numpy as np
from mujoco.batch import Batch

from hugwbc.robot import SIDES, Robot, load_robot
from hugwbc.sim.actuators import Actuators, TorqueSpeedLimit
from hugwbc.sim.footing import Footing
from hugwbc.sim.ground import Ground
from hugwbc.sim.layout import robot_layout
from hugwbc.sim.robot_model import TRAINING_TIMESTEP, load_model
from hugwbc.sim.simulation import DIVERGED
from hugwbc.sim.terrain import HeightField
from hugwbc.state import RobotState

# Robots for each thread that go through all substeps before the next ones: the data of so many stay in the cache.
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


class BatchSimulation:
    """A batch of robots on the same ground. All arrays are live: they show the state after the last step.

    Attributes:
        layout: place of the robot in the model's state.
        qpos, qvel: state of the robot, shapes (count, 26) and (count, 25); writable, call `forward` afterwards.
        ctrl: position targets of the PD joints [rad], shape (count, 19); writable.
        torque: joint torques of the last physics step [N*m], shape (count, 19).
        forces: external forces and torques on the bodies in the world [N, N*m], shape (count, bodies, 6); writable.
        warm_start: starting point of the constraint solver, shape (count, 25); needed to resume bit by bit.
    """

    def __init__(
        self,
        count: int,
        *,
        timestep: float = TRAINING_TIMESTEP,
        terrain: HeightField | None = None,
        threads: int = 1,
        robot: Robot | None = None,
        actuators: Actuators | None = None,
        ground: Ground | None = None,
    ) -> None:
        """Build the batch.

        Args:
            count: number of robots.
            timestep: physics time step [s].
            terrain: height field to stand on; None for a plane.
            threads: number of threads; 0 for one per processor.
            robot: robot to simulate; None for the H1.
            actuators: drives of the joints; None for real ones. Their delay is left to the caller, who sets `ctrl`.
            ground: firmness of the ground; None for firm.
        """
        self.robot, actuators = robot or load_robot(), actuators or Actuators()
        self.model = load_model(timestep, terrain, lean=True, robot=self.robot, actuators=actuators, ground=ground)
        self.terrain = terrain
        # With persistent data, a step reuses the position and velocity stages that the last step has computed.
        self.batch = Batch(self.model, count, threads, persistent=True)
        self.layout = robot_layout(self.model, self.robot)
        self.qpos = self.batch.bind("qpos")[:, self.layout.qpos]
        self.qvel = self.batch.bind("qvel")[:, self.layout.qvel]
        self.ctrl = self.batch.bind("ctrl")[:, self.layout.ctrl]
        self.torque = self.batch.bind("actuator_force")[:, self.layout.ctrl]
        self.forces = self.batch.bind("xfrc_applied")
        self.warm_start = self.batch.bind("qacc_warmstart")
        self._sensors = self.batch.bind("sensordata")
        self._index_sensors()
        self._limited = actuators.torque_speed
        self._blocks = self._make_blocks()
        self._footing = None if terrain is None else Footing(self.model, terrain)
        if self._footing is not None:
            self._geom_pos = self.batch.expand("geom_pos")
            self._xpos, self._xmat = self.batch.bind("xpos"), self.batch.bind("xmat")
        self.batch.reset(keyframe=0)

    def _make_blocks(self) -> list[_Block]:
        """Divide the robots into blocks, each with the torque-speed limit of its robots, if there is one."""
        source = self.batch.expand("actuator_forcerange") if self._limited else self.model.actuator_forcerange[None]
        force_range, blocks = source[:, self.layout.ctrl], []
        size = _BLOCK * max(1, self.batch.nthread)
        for start in range(0, self.count, size):
            rows = slice(start, min(start + size, self.count))
            limit = TorqueSpeedLimit(self.robot, force_range[rows, :, 1]) if self._limited else None
            blocks.append(_Block(rows, np.arange(rows.start, rows.stop), limit, self.qvel[rows, 6:], force_range[rows]))
        return blocks

    def _index_sensors(self) -> None:
        """Find the columns of the sensor data."""
        self._columns = {
            self.model.sensor(i).name: slice(int(adr), int(adr + dim))
            for i, (adr, dim) in enumerate(zip(self.model.sensor_adr, self.model.sensor_dim, strict=True))
        }
        self._both_feet = {
            kind: np.concatenate([np.r_[self._columns[f"{side}_{kind}"]] for side in SIDES])
            for kind in ("sole_position", "sole_velocity", "foot_force")
        }
        self._link_forces = np.concatenate([np.r_[self._columns[f"{n}_force"]] for n in self.robot.contact_links])

    @property
    def nominal_qpos(self) -> np.ndarray:
        """Nominal stand at the origin, as in `qpos`, shape (26,)."""
        return self.model.key("nominal").qpos[self.layout.qpos].copy()

    @property
    def count(self) -> int:
        """Number of robots."""
        return self.batch.nsim

    def step(self, substeps: int, targets: np.ndarray | None = None) -> np.ndarray:
        """Advance all robots and update everything that depends on positions and velocities.

        MuJoCo silently resets a simulation that diverges. Only its warning counters show it, so they are cleared first.

        Args:
            substeps: number of physics steps.
            targets: joint targets of every physics step [rad], shape (substeps, count, 19); None for `ctrl` in all.

        Returns:
            Which robots diverged, bool, shape (count,).
        """
        self._place_feet(np.arange(self.count))
        self.batch.warning[:] = 0
        if targets is None and not self._limited:
            self.batch.step(nstep=substeps, stage=mujoco.mjtStage.mjSTAGE_VEL)
        else:
            for block in self._blocks:
                self._step_block(block, substeps, targets)
        return self.batch.warning[:, _FAULTS, WARNING_COUNT].any(axis=1)

    def _step_block(self, block: _Block, substeps: int, targets: np.ndarray | None) -> None:
        for substep in range(substeps):
            if targets is not None:
                self.ctrl[block.rows] = targets[substep, block.rows]
            if block.limit is not None:
                block.limit.write(block.velocity, block.force_range)
            self.batch.step(ids=block.ids, stage=mujoco.mjtStage.mjSTAGE_VEL)

    def states(self) -> list[RobotState]:
        """Return the true state of every robot in the form that a controller of one robot expects."""
        return [
            RobotState(
                q=qpos[7:].copy(),
                dq=qvel[6:].copy(),
                orientation=qpos[3:7].copy(),
                angular_velocity=qvel[3:6].copy(),
                position=qpos[:3].copy(),
                velocity=qvel[:3].copy(),
                foot_force=force,
            )
            for qpos, qvel, force in zip(self.qpos, self.qvel, self.foot_force(), strict=True)
        ]

    def forward(self, ids: np.ndarray) -> None:
        """Recompute the derived quantities of some robots after their state was written."""
        self.batch.forward(ids=ids)
        if self._footing is not None:
            self._place_feet(ids)
            self.batch.forward(ids=ids)

    def _place_feet(self, ids: np.ndarray) -> None:
        if self._footing is not None and ids.size:
            self._geom_pos[ids[:, None], self._footing.geoms] = self._footing.positions(
                self._xpos[ids], self._xmat[ids]
            )

    @property
    def footing(self) -> np.ndarray:
        """Positions of the contact spheres and their plane in the last contact search, for `restore_footing`."""
        return np.zeros(0) if self._footing is None else self._geom_pos[:, self._footing.geoms]

    def restore_footing(self, footing: np.ndarray) -> None:
        """Set a value of `footing` and search for contacts; needed to resume bit by bit on terrain."""
        if self._footing is not None:
            self._geom_pos[:, self._footing.geoms] = footing
            self.batch.forward(ids=np.arange(self.count))

    def sole_position(self) -> np.ndarray:
        """Return the centres of both soles in the world [m], shape (count, 2, 3)."""
        return self._sensors[:, self._both_feet["sole_position"]].reshape(-1, 2, 3)

    def sole_velocity(self) -> np.ndarray:
        """Return the velocities of both sole centres in the world [m/s], shape (count, 2, 3)."""
        return self._sensors[:, self._both_feet["sole_velocity"]].reshape(-1, 2, 3)

    def foot_force(self) -> np.ndarray:
        """Return the ground reaction on both feet in the world [N], shape (count, 2, 3)."""
        # The sensor measures the force of the link on its surroundings; the ground reaction is the opposite.
        return -self._sensors[:, self._both_feet["foot_force"]].reshape(-1, 2, 3)

    def link_force(self) -> np.ndarray:
        """Return the magnitude of the contact force on each of `Robot.contact_links` [N], shape (count, 11)."""
        return np.linalg.norm(self._sensors[:, self._link_forces].reshape(self.count, -1, 3), axis=2)

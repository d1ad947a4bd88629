"""Many H1s at once on `mujoco.batch`: live state arrays, per-robot model parameters, guarded stepping."""

import mujoco
import numpy as np
from mujoco.batch import Batch

from hugwbc.robot import SIDES, load_robot
from hugwbc.sim.footing import Footing
from hugwbc.sim.scene import TRAINING_TIMESTEP, load_model
from hugwbc.sim.simulation import DIVERGED
from hugwbc.sim.terrain import HeightField
from hugwbc.state import RobotState

_FAULTS = [int(warning) for warning in (*DIVERGED, mujoco.mjtWarning.mjWARN_BADCTRL)]
WARNING_COUNT = 1  # second column of MuJoCo's warning table: how often; the first says where


class BatchSimulation:
    """`count` robots on the same ground. All arrays are live: reading gives the state after the last step.

    Attributes:
        qpos, qvel: state, shapes (count, 26) and (count, 25); writable, followed by `forward`.
        ctrl: position targets of the PD joints [rad], shape (count, 19); writable.
        torque: joint torques of the last physics step [N*m], shape (count, 19).
        warm_start: the constraint solver's starting point, shape (count, 25); a bit-exact resumption needs it.
    """

    def __init__(
        self,
        count: int,
        *,
        timestep: float = TRAINING_TIMESTEP,
        terrain: HeightField | None = None,
        threads: int = 1,
    ) -> None:
        """Build the batch.

        Args:
            count: number of robots.
            timestep: of the physics [s].
            terrain: the ground; None for a plane.
            threads: of the simulation; 0 for all processors.
        """
        self.robot = load_robot()
        self.model = load_model(timestep, terrain, lean=True)
        self.terrain = terrain
        # Persistent data let a step continue from the position and velocity stages that the last step already made.
        self.batch = Batch(self.model, count, threads, persistent=True)
        self.qpos, self.qvel = self.batch.bind("qpos"), self.batch.bind("qvel")
        self.ctrl = self.batch.bind("ctrl")
        self.torque = self.batch.bind("actuator_force")
        self.warm_start = self.batch.bind("qacc_warmstart")
        self._sensors = self.batch.bind("sensordata")
        self._index_sensors()
        self._footing = None if terrain is None else Footing(self.model, terrain)
        if self._footing is not None:
            self._geom_pos = self.batch.expand("geom_pos")
            self._xpos, self._xmat = self.batch.bind("xpos"), self.batch.bind("xmat")
        self.batch.reset(keyframe=0)

    def _index_sensors(self) -> None:
        """Find the columns of the sensors."""
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
    def count(self) -> int:
        """Number of robots."""
        return self.batch.nsim

    def step(self, substeps: int) -> np.ndarray:
        """Advance all robots; positions, velocities and their sensors are current afterwards.

        MuJoCo silently restarts a simulation that diverges; its warning counters tell, and are cleared first.

        Returns:
            Which robots diverged, shape (count,), bool.
        """
        self._place_feet(np.arange(self.count))
        self.batch.warning[:] = 0
        self.batch.step(nstep=substeps, stage=mujoco.mjtStage.mjSTAGE_VEL)
        return self.batch.warning[:, _FAULTS, WARNING_COUNT].any(axis=1)

    def states(self) -> list[RobotState]:
        """The true state of every robot, as a controller of one robot takes it."""
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
        """Bring the derived quantities of some robots up to date after a write to their state."""
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
        """Where the feet's contact spheres and plane were in the last contact search, for `restore_footing`."""
        return np.zeros(0) if self._footing is None else self._geom_pos[:, self._footing.geoms]

    def restore_footing(self, footing: np.ndarray) -> None:
        """Set what `footing` gave and search for contacts with it; a bit-exact resumption on terrain needs it."""
        if self._footing is not None:
            self._geom_pos[:, self._footing.geoms] = footing
            self.batch.forward(ids=np.arange(self.count))

    def sole_position(self) -> np.ndarray:
        """Centres of both soles in the world [m], shape (count, 2, 3)."""
        return self._sensors[:, self._both_feet["sole_position"]].reshape(-1, 2, 3)

    def sole_velocity(self) -> np.ndarray:
        """Velocities of both sole centres in the world [m/s], shape (count, 2, 3)."""
        return self._sensors[:, self._both_feet["sole_velocity"]].reshape(-1, 2, 3)

    def foot_force(self) -> np.ndarray:
        """Ground reaction on both feet in the world [N], shape (count, 2, 3)."""
        # The sensor gives the force of the link on its surroundings; the reaction is its opposite.
        return -self._sensors[:, self._both_feet["foot_force"]].reshape(-1, 2, 3)

    def link_force(self) -> np.ndarray:
        """Contact force magnitude on each of `Robot.contact_links` [N], shape (count, 11)."""
        return np.linalg.norm(self._sensors[:, self._link_forces].reshape(self.count, -1, 3), axis=2)

"""What many robots at once did, sampled as `Trace` has it of one."""

import math

import numpy as np

from hugwbc import rotations
from hugwbc.commands import Command
from hugwbc.robot import load_robot
from hugwbc.runtime.loop import CONTACT_FORCE
from hugwbc.runtime.trace import RECORD_PERIOD
from hugwbc.sim.lockstep import LockstepSimulation


class BatchRecord:
    """Samples of all robots; those of a robot that is done end where it did."""

    def __init__(self, count: int, duration: float) -> None:
        """Make room.

        Args:
            count: number of robots.
            duration: of the longest run [s].
        """
        samples = math.ceil(duration / RECORD_PERIOD) + 1
        shapes = {
            "command": (8,), "gait": (), "measured": (6,), "clearance": (2,), "phase": (), "foot_contact": (2,),
            "foot_force": (2, 3), "qpos": (26,), "qvel": (25,), "target": (19,), "torque": (19,),
        }  # fmt: skip
        kinds = {"gait": int, "foot_contact": bool}
        self.arrays = {
            name: np.empty((samples, count, *shape), kinds.get(name, float)) for name, shape in shapes.items()
        }
        self.times: list[float] = []
        self.lengths = np.zeros(count, dtype=int)

    def due(self, t: float) -> bool:
        """Whether the next sample is due at time t."""
        return t >= len(self.times) * RECORD_PERIOD - 1e-9

    def sample(
        self, t: float, simulation: LockstepSimulation, rows: np.ndarray, commands: list[Command], **others: np.ndarray
    ) -> None:
        """Add one row of everything at time t for some robots.

        Args:
            t: [s].
            simulation: of all robots.
            rows: which are up, shape (m,).
            commands: as asked for, clamped.
            others: `phase` (m,) and `target` (m, 19), see `Trace`.
        """
        force = simulation.foot_force(rows)
        values = {
            "command": [command.array() for command in commands],
            "gait": [int(command.gait) for command in commands],
            "measured": _measured(simulation, rows),
            "clearance": simulation.sole_height(rows),
            "foot_contact": force[..., 2] > CONTACT_FORCE,
            "foot_force": force,
            "qpos": simulation.qpos[rows],
            "qvel": simulation.qvel[rows],
            "torque": simulation.torque[rows],
            **others,
        }
        for name, value in values.items():
            self.arrays[name][len(self.times), rows] = value
        self.times.append(t)
        self.lengths[rows] = len(self.times)

    def of(self, row: int) -> dict[str, np.ndarray]:
        """The sampled fields of a robot's trace."""
        count = self.lengths[row]
        nothing = {"pressure_centre": (2, 3), "foothold": (2, 2), "hand_target_world": (2, 3), "arm_target": (8,)}
        return {
            "time": np.array(self.times[:count]),
            **{name: array[:count, row] for name, array in self.arrays.items()},
            **{name: np.broadcast_to(np.nan, (count, *shape)) for name, shape in nothing.items()},
            "hand_error": np.broadcast_to(np.nan, (count, 2)),
            "reachable": np.broadcast_to(False, (count, 2)),
        }


def _measured(simulation: LockstepSimulation, rows: np.ndarray) -> np.ndarray:
    """`MEASURED_NAMES` of some robots, as `Kinematics.measured` of one, shape (m, 6)."""
    robot = load_robot()
    qpos, qvel, orientation = simulation.qpos[rows], simulation.qvel[rows], simulation.orientation(rows)
    yaw = rotations.yaw_of(orientation)
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.stack(
        (
            cos * qvel[:, 0] + sin * qvel[:, 1],
            cos * qvel[:, 1] - sin * qvel[:, 0],
            rotations.rotate(orientation, qvel[:, 3:6])[:, 2],
            qpos[:, 2] - robot.nominal_height,
            rotations.pitch_of(orientation),
            qpos[:, 7 + robot.waist],
        ),
        axis=1,
    )

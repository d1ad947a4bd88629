"""Initial states of episodes: near the nominal pose, or in recorded motion."""

import math
import pathlib
from collections.abc import Mapping

import torch

from hugwbc.commands import COMMAND_NAMES
from hugwbc.errors import PolicyFileError
from hugwbc.gait import Gait
from hugwbc.learned.env.randomization import rand, uniform
from hugwbc.learned.env.rough_ground import RoughGround
from hugwbc.learned.policy import checkpoint
from hugwbc.learned.policy.records import versions
from hugwbc.learned.policy.terms import FRAME, HISTORY_FRAMES, size_of
from hugwbc.robot import Robot

# Of a recorded state: position and velocity of the simulation, and what the environment keeps of a robot.
COLUMNS = ("qpos", "qvel", "command", "gait", "phase", "actions", "history", "waist")

START_JOINT_NOISE = 0.1  # [rad], half-width at the start of an episode
START_VELOCITY = 0.3  # [m/s] and [rad/s], half-width of the pelvis' velocities at the start of an episode


def column_shapes(robot: Robot) -> dict[str, tuple[int, ...]]:
    """Return the shapes of one recorded state by column."""
    joints = len(robot.joint_names)
    many = {
        "qpos": (7 + joints,),
        "qvel": (6 + joints,),
        "command": (len(COMMAND_NAMES),),
        "actions": (3, joints),
        "history": (HISTORY_FRAMES, size_of(FRAME, robot)),
    }
    return dict.fromkeys(COLUMNS, ()) | many


class RecordedStarts:
    """States of robots in motion, from which episodes can start.

    An episode that starts in the middle of a hop shows the learner what a good hop is worth before it can begin one by
    itself (reference state initialisation: Peng et al., "DeepMimic", ACM Transactions on Graphics 2018).

    Attributes:
        columns: the columns of `COLUMNS` by name, one row per state.
    """

    def __init__(
        self, columns: Mapping[str, torch.Tensor], path: pathlib.Path, robot: Robot, device: torch.device | None = None
    ) -> None:
        """Take the columns of a file."""
        rows = len(columns["gait"]) if "gait" in columns else 0
        for name, shape in column_shapes(robot).items():
            found = tuple(columns[name].shape) if name in columns else None
            if not rows or found != (rows, *shape):
                raise PolicyFileError(
                    f"{path} has no usable recorded starts: '{name}' has the shape {found}, not {(rows, *shape)}; give "
                    f"a file that this version recorded with the robot {robot.name}"
                )
        self.columns = {name: column.to(device) for name, column in columns.items()}
        gait = self.columns["gait"]
        self._rows = gait.argsort(stable=True)  # by gait
        self._number = torch.bincount(gait, minlength=len(Gait))  # of each gait
        self._first = self._number.cumsum(0) - self._number

    @classmethod
    def load(cls, path: pathlib.Path, robot: Robot, device: torch.device | None = None) -> "RecordedStarts":
        """Read a file that `StartRecorder.save` wrote."""
        tensors, _ = checkpoint.load_file(path, "starts")
        return cls(tensors, path, robot, device)

    def draw(
        self, gait: torch.Tensor, share: float, generator: torch.Generator
    ) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
        """Draw recorded states for a share of the robots, each of the robot's own gait.

        Returns:
            Robots that get a state, as indices into `gait`, shape (m,), and the columns of these states, (m, ...).
            Robots whose gait was not recorded get none.
        """
        chosen = rand(generator, len(gait)) < share
        sample = rand(generator, len(gait), dtype=torch.float64)
        having = (chosen & (self._number[gait] > 0)).nonzero().squeeze(1)
        kind = gait[having]
        rows = self._rows[self._first[kind] + (sample[having] * self._number[kind]).long()]
        return having, {name: column[rows] for name, column in self.columns.items()}


class StartRecorder:
    """A collector of states for `RecordedStarts`, up to a given number.

    Attributes:
        count: number of states so far.
    """

    def __init__(self, capacity: int) -> None:
        """Make room for `capacity` states."""
        self._capacity = capacity
        self._parts: list[dict[str, torch.Tensor]] = []
        self.count = 0

    def add(self, columns: Mapping[str, torch.Tensor]) -> None:
        """Add states, given as the columns of `COLUMNS`; leave out what exceeds the capacity."""
        part = {name: columns[name][: self._capacity - self.count].clone() for name in COLUMNS}
        self._parts.append(part)
        self.count += len(part["gait"])

    @property
    def full(self) -> bool:
        """Whether the capacity is reached."""
        return self.count >= self._capacity

    def columns(self) -> dict[str, torch.Tensor]:
        """Return all states as the columns of `COLUMNS`; nothing if there are none."""
        return {name: torch.cat([part[name] for part in self._parts]) for name in COLUMNS} if self._parts else {}

    def save(self, path: pathlib.Path) -> None:
        """Write all states to a file."""
        checkpoint.save_file(path, self.columns(), "starts", {"states": self.count, "versions": versions()})


def draw_starts(
    nominal: torch.Tensor, robots: torch.Tensor, ground: RoughGround | None, generator: torch.Generator
) -> tuple[torch.Tensor, torch.Tensor]:
    """Draw the stands in which robots start: nominal joints with noise, a random heading, a moving pelvis.

    Args:
        nominal: pelvis position above the origin, quaternion (w, x, y, z) and joint positions, shape (7 + joints,).
        robots: indices, shape (k,).
        ground: rough ground on whose levels they start; None for a plane, where all start at the origin.
        generator: source of the draws.

    Returns:
        Positions in the layout of `nominal`, shape (k, 7 + joints), and velocities, zero in the joints, shape
        (k, 6 + joints).
    """
    count, joints = robots.numel(), len(nominal) - 7
    yaw = uniform(generator, count, -math.pi, math.pi)
    qpos = nominal.repeat(count, 1)
    qpos[:, 3], qpos[:, 6] = torch.cos(yaw.double() / 2.0), torch.sin(yaw.double() / 2.0)
    qpos[:, 7:] += _symmetric(generator, count, joints, START_JOINT_NOISE)
    if ground is not None:
        qpos[:, :3] += ground.starts(robots, yaw, rand(generator, count, 2))
    qvel = nominal.new_zeros(count, 6 + joints)
    qvel[:, :6] = _symmetric(generator, count, 6, START_VELOCITY)
    return qpos, qvel


def _symmetric(generator: torch.Generator, rows: int, columns: int, half_width: float) -> torch.Tensor:
    return half_width * (2.0 * rand(generator, rows, columns) - 1.0)

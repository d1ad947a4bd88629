"""Rough ground in training: height below any point, places to start, and the level of each robot.

Heights are looked up in the grid of the height field as MuJoCo's collision detection sees it. This equals casting rays
and is several times faster.
"""

import numpy as np
import torch

from hugwbc.learned import distributed
from hugwbc.learned.config import TerrainConfig
from hugwbc.learned.policy import critic_observations as obs
from hugwbc.learned.policy.terms import LENGTH_SCALE
from hugwbc.sim.batch import RobotBatch
from hugwbc.sim.terrain import level_terrain, on_grid

_LATE = 0.25  # [m], by which a robot must be beyond half a period before it is moved, so as not to move to and fro
_FOOTPRINT = torch.cartesian_prod(torch.linspace(-0.2, 0.3, 6), torch.linspace(-0.25, 0.25, 6))  # of a stand [m]


class RoughGround:
    """Rough ground of several levels, and the level of each of n robots.

    Positions `xy` are those of pelvises in the world [m], shape (k, 2), and `heading` is their yaw [rad], shape (k,).

    Attributes:
        terrain: height field of all levels.
        level: level of each robot, shape (n,).
    """

    def __init__(
        self, count: int, config: TerrainConfig, rng: np.random.Generator, device: torch.device | None = None
    ) -> None:
        """Generate the ground and spread the robots over the first levels."""
        ground = level_terrain(config.levels, config.roughness, rng)
        self.terrain = ground.field
        self.level = torch.arange(count, device=device) % (config.start_level + 1)
        self._config = config
        self._period = ground.period
        self._centres = torch.tensor(ground.centres, dtype=torch.float32, device=device)
        self._heights = torch.tensor(ground.field.heights, dtype=torch.float32, device=device)
        rows, columns = ground.field.heights.shape
        last = torch.tensor([columns - 1, rows - 1])
        self._middle, self._scale = (0.5 * last).to(device), (last / torch.tensor(ground.field.size)).to(device)
        self._points, self._footprint = obs.terrain_points().to(device), _FOOTPRINT.to(device)
        # Robots that moved up, fell back and were held, and the sum of the latter's rewards, since the last report.
        self._moves = torch.zeros(4, device=device)

    def height_at(self, xy: torch.Tensor) -> torch.Tensor:
        """Return the height of the ground [m] at points (..., 2) [m], as `HeightField.height_at`; NaN counts as 0."""
        # A diverged robot may be anywhere.
        column, row = (torch.nan_to_num(xy) * self._scale + self._middle).unbind(-1)
        return on_grid(self._heights, column, row)

    def samples(self, xy: torch.Tensor, heading: torch.Tensor) -> torch.Tensor:
        """Return the heights at the critic's sample points around robots [m], shape (k, 221)."""
        return self.height_at(_around(xy, heading, self._points))

    def depths(self, position: torch.Tensor, heading: torch.Tensor, nominal_height: float) -> torch.Tensor:
        """Return the depths of the sample points below pelvises, (k, 3), less the nominal height, scaled, (k, 221)."""
        below = position[:, 2:] - nominal_height - self.samples(position[:, :2], heading)
        return below.clamp(-1.0, 1.0) * LENGTH_SCALE

    def starts(self, robots: torch.Tensor, heading: torch.Tensor, sample: torch.Tensor) -> torch.Tensor:
        """Return places on the robots' levels to start at [m], shape (k, 3): z is the highest ground under a stand.

        Args:
            robots: indices, shape (k,).
            heading: yaw of each [rad], shape (k,).
            sample: place of each within a period of the ground, from 0 to 1, shape (k, 2).
        """
        xy = self._centres[self.level[robots]] + (sample - 0.5) * self._period
        z = self.height_at(_around(xy, heading, self._footprint)).amax(1)
        return torch.cat((xy, z[:, None]), dim=1)

    def shift(self, xy: torch.Tensor) -> torch.Tensor:
        """Return by how much to move robots that are far from the middle of their region [m], shape (n, 2).

        Shifts are whole periods of the ground, zero for all other robots.
        """
        offset = xy - self._centres[self.level]
        far = offset.abs() > 0.5 * self._period + _LATE
        return torch.where(far, -self._period * torch.round(offset / self._period), 0.0)

    def keep_inside(self, simulation: RobotBatch, xy: torch.Tensor) -> None:
        """Move robots that approach the end of their region to a place where the ground is the same."""
        shift = self.shift(xy)
        ids = shift.any(1).nonzero().squeeze(1)
        if ids.numel():
            simulation.qpos[ids, :2] += shift[ids]
            simulation.forward(ids)

    def lost(self, xy: torch.Tensor) -> torch.Tensor:
        """Return which robots are outside the region of their level, shape (n,), bool.

        This happens with the stored state of a run on other ground.
        """
        return ((xy - self._centres[self.level]).abs() > self._period).any(1)

    def advance(self, robots: torch.Tensor, fell: torch.Tensor, tracking: torch.Tensor) -> None:
        """Move robots whose episode ended one level up, one level down, or not at all.

        The distance walked does not count: robots with slow or turning commands would never pass.

        Args:
            robots: indices, shape (k,).
            fell: whether each fell, shape (k,), bool.
            tracking: linear tracking reward of each relative to its maximum, shape (k,).
        """
        up = ~fell & (tracking >= self._config.threshold)
        held = ~fell & ~up
        step = up.long() - fell.long()
        self.level[robots] = (self.level[robots] + step).clamp(0, self._config.levels - 1)
        self._moves += torch.stack((up, fell, held, held * tracking), 1).sum(0)

    @property
    def mean_level(self) -> float:
        """Mean level of all robots of all processes, from 0 to levels - 1."""
        return float(distributed.mean(self.level.float().mean()))

    def report(self) -> str:
        """Describe in words how this process's robots moved between levels since the last call."""
        up, down, held, reward = self._moves.tolist()
        self._moves.zero_()
        text = f"level {self.mean_level:.2f} of {self._config.levels - 1}, {up:.0f} up, {down:.0f} fell back"
        if held:
            text += f", {held:.0f} held: linear velocity reward {reward / held:.2f} < {self._config.threshold:.2f}"
        return text

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Return everything that a resumed run needs."""
        return {"level": self.level}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore what `state_dict` returned; an empty state leaves the levels as they are."""
        if "level" in state:
            self.level = state["level"].clamp(max=self._config.levels - 1)


def _around(xy: torch.Tensor, heading: torch.Tensor, points: torch.Tensor) -> torch.Tensor:
    """Transform points (m, 2) from the heading frames of k robots to the world, shape (k, m, 2)."""
    cos, sin = heading.cos()[:, None], heading.sin()[:, None]
    x, y = points[:, 0], points[:, 1]
    return torch.stack((xy[:, :1] + cos * x - sin * y, xy[:, 1:] + sin * x + cos * y), dim=-1)

"""Rough ground in training: the height below any point, where robots start, and the level of each robot.

Heights are looked up in the grid, as MuJoCo's collision sees them: equal to casting rays, and several times faster.
"""

import numpy as np
import torch

from hugwbc.learned import distributed
from hugwbc.learned.config import TerrainConfig
from hugwbc.learned.policy import observations as obs
from hugwbc.sim.batch import BatchSimulation
from hugwbc.sim.terrain import level_terrain

_LATE = 0.25  # [m] beyond half a period before a robot is moved back by a period, so that none is moved to and fro
_FOOTPRINT = torch.cartesian_prod(torch.linspace(-0.2, 0.3, 6), torch.linspace(-0.25, 0.25, 6))  # [m] of a stand


class RoughGround:
    """Levels of rough ground for n robots.

    Attributes:
        terrain: the height field of all levels.
        level: of each robot, shape (n,).
    """

    def __init__(self, count: int, config: TerrainConfig, rng: np.random.Generator) -> None:
        """Generate the ground and spread the robots over the first levels.

        Args:
            count: number of robots.
            config: roughness, levels and threshold.
            rng: of the ground.
        """
        ground = level_terrain(config.levels, config.roughness, rng)
        self.terrain = ground.field
        self.level = torch.arange(count) % (config.start_level + 1)
        self._config = config
        self._period = ground.period
        self._centres = torch.tensor(ground.centres, dtype=torch.float32)
        self._heights = torch.tensor(ground.field.heights, dtype=torch.float32).flatten()
        self._rows, self._columns = ground.field.heights.shape
        self._scale = torch.tensor([self._columns - 1, self._rows - 1]) / torch.tensor(ground.field.size)
        self._moves = {"up": 0, "down": 0, "held": 0}
        self._held_reward = 0.0

    def height_at(self, xy: torch.Tensor) -> torch.Tensor:
        """Height of the ground [m] at points (..., 2), as `HeightField.height_at`; NaN counts as the origin."""
        middle = 0.5 * torch.tensor([self._columns - 1.0, self._rows - 1.0])
        # A diverged robot may be anywhere; its index must be in the grid.
        cell = torch.nan_to_num(xy) * self._scale + middle
        column, row = cell[..., 0].clamp(0.0, self._columns - 1.001), cell[..., 1].clamp(0.0, self._rows - 1.001)
        left, below = column.long(), row.long()
        u, v = column - left, row - below
        index = below * self._columns + left
        near, far = self._heights[index], self._heights[index + self._columns + 1]
        corner = self._heights[index + torch.where(u > v, 1, self._columns)]
        return near + torch.maximum(u, v) * (corner - near) + torch.minimum(u, v) * (far - corner)

    def samples(self, xy: torch.Tensor, heading: torch.Tensor) -> torch.Tensor:
        """Heights at the critic's sample points around robots [m], shape (k, 221).

        Args:
            xy: positions of their pelvises, shape (k, 2).
            heading: their yaw [rad], shape (k,).
        """
        return self.height_at(_around(xy, heading, obs.terrain_points()))

    def starts(self, robots: torch.Tensor, heading: torch.Tensor, sample: torch.Tensor) -> torch.Tensor:
        """Positions at which some robots start on their levels, above the highest ground under a stand, shape (k, 3).

        Args:
            robots: indices, shape (k,).
            heading: their yaw [rad], shape (k,).
            sample: uniform numbers in [0, 1), shape (k, 2).
        """
        xy = self._centres[self.level[robots]] + (sample - 0.5) * self._period
        z = self.height_at(_around(xy, heading, _FOOTPRINT)).amax(1)
        return torch.cat((xy, z[:, None]), dim=1)

    def shift(self, xy: torch.Tensor) -> torch.Tensor:
        """Whole periods by which to move robots that went too far from the middle of their region [m], shape (n, 2).

        Args:
            xy: positions of the pelvises, shape (n, 2).
        """
        offset = xy - self._centres[self.level]
        far = offset.abs() > 0.5 * self._period + _LATE
        return torch.where(far, -self._period * torch.round(offset / self._period), 0.0)

    def keep_inside(self, simulation: BatchSimulation, xy: torch.Tensor) -> None:
        """Move robots that near the end of their region to where the ground is the same.

        Args:
            simulation: the batch.
            xy: positions of the pelvises, shape (n, 2).
        """
        shift = self.shift(xy)
        ids = shift.any(1).nonzero().squeeze(1)
        if ids.numel():
            simulation.qpos[ids.numpy(), :2] += shift[ids].numpy()
            simulation.forward(ids.numpy())

    def lost(self, xy: torch.Tensor) -> torch.Tensor:
        """Which robots are outside of their level's region, as in the state of a run on other ground, shape (n,), bool.

        Args:
            xy: positions of the pelvises, shape (n, 2).
        """
        return ((xy - self._centres[self.level]).abs() > self._period).any(1)

    def advance(self, robots: torch.Tensor, fell: torch.Tensor, tracking: torch.Tensor) -> None:
        """Move robots whose episode ended to the next level, back, or nowhere.

        Distance walked does not count: slow and turning commands would never pass.

        Args:
            robots: indices, shape (k,).
            fell: whether they fell, shape (k,), bool.
            tracking: their linear tracking reward relative to its maximum, shape (k,).
        """
        up = ~fell & (tracking >= self._config.threshold)
        held = ~fell & ~up
        step = up.long() - fell.long()
        self.level[robots] = (self.level[robots] + step).clamp(0, self._config.levels - 1)
        for name, moved in (("up", up), ("down", fell), ("held", held)):
            self._moves[name] += int(moved.sum())
        self._held_reward += float(tracking[held].sum())

    @property
    def mean_level(self) -> float:
        """Of all robots of all processes, from 0 to levels - 1."""
        return float(distributed.mean(self.level.float().mean()))

    @property
    def mastered(self) -> bool:
        """Whether the mean level lets the other curricula move."""
        return self.mean_level >= self._config.mastered * (self._config.levels - 1)

    def report(self) -> str:
        """What happened since the last call, in words."""
        moves, reward = self._moves, self._held_reward
        self._moves, self._held_reward = dict.fromkeys(moves, 0), 0.0
        text = f"level {self.mean_level:.2f} of {self._config.levels - 1}, {moves['up']} up, {moves['down']} fell back"
        if moves["held"]:
            mean = reward / moves["held"]
            text += f", {moves['held']} held: linear velocity reward {mean:.2f} < {self._config.threshold:.2f}"
        return text

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Everything that a resumed run needs."""
        return {"level": self.level}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore what `state_dict` gave; without it, the levels stay as they are."""
        if "level" in state:
            self.level = state["level"].clamp(max=self._config.levels - 1)


def _around(xy: torch.Tensor, heading: torch.Tensor, points: torch.Tensor) -> torch.Tensor:
    """Points (m, 2) of the heading frame of k robots in the world, shape (k, m, 2)."""
    cos, sin = heading.cos()[:, None], heading.sin()[:, None]
    x, y = points[:, 0], points[:, 1]
    return torch.stack((xy[:, :1] + cos * x - sin * y, xy[:, 1:] + sin * x + cos * y), dim=-1)

"""Observations of the training in torch: what actor and critic read, what the estimator learns, and mirror maps."""

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
import torch

from hugwbc.learned.policy.symmetry import SignedPermutation
from hugwbc.learned.policy.terms import FRAME, TERRAIN_SHAPE, TERRAIN_SIZE, TERRAIN_SPACING, Part
from hugwbc.robot import Robot


@dataclasses.dataclass(frozen=True, eq=False)
class Observation:
    """The inputs of the networks, and the target of the estimator; sizes are those of the H1."""

    history: torch.Tensor  # last five proprioceptive frames, oldest first, shape (n, 315)
    command: torch.Tensor  # commands, gait, clocks and indicator, shape (n, 18), then further terms
    # privileged observation, shape (n, 342); on a plane, where all heights of the terrain are one number, it has that
    # number once, shape (n, 122). Further terms come before the terrain
    critic: torch.Tensor
    estimate: torch.Tensor  # target of the estimator, shape (n, 6)


def side_by_side(parts: Sequence[Part], *values: torch.Tensor) -> torch.Tensor:
    """Return the numbers of parts, shape (n, size of each), side by side as the networks read them."""
    return torch.cat([value * torch.tensor(part.scale) for value, part in zip(values, parts, strict=True)], dim=1)


def noise_amplitude(parts: Sequence[Part], robot: Robot) -> torch.Tensor:
    """Return the half-widths of the noise on parts side by side, as the networks read them, shape (sum of sizes,)."""
    return torch.cat(
        [torch.zeros(0), *(torch.ones(part.count(robot)) * part.noise * torch.tensor(part.scale) for part in parts)]
    )


def in_units(frame: torch.Tensor, pose: torch.Tensor, robot: Robot) -> tuple[torch.Tensor, ...]:
    """Return the parts of proprioceptive frames in physical units, with absolute joint positions, in double precision.

    Args:
        frame: the frames, as the network reads them, shape (n, size).
        pose: joint positions at action 0 [rad], shape (joints,).
        robot: the robot.
    """
    values = zip(frame.double().split([part.count(robot) for part in FRAME], 1), FRAME, strict=True)
    omega, gravity, offset, dq, action = (
        value / torch.tensor(part.scale, dtype=torch.float64) for value, part in values
    )
    return omega, gravity, offset + pose, dq, action


@functools.cache
def terrain_points() -> torch.Tensor:
    """Return the sample points of the terrain in the heading frame [m], shape (221, 2); x from -0.42 to 0.70 m."""
    x = (torch.arange(TERRAIN_SHAPE[0]) - 6) * TERRAIN_SPACING
    y = (torch.arange(TERRAIN_SHAPE[1]) - 6) * TERRAIN_SPACING
    return torch.cartesian_prod(x, y)


# Mirror maps ----------------------------------------------------------------------------------------------------------


@functools.cache
def mirror(parts: tuple[Part, ...], robot: Robot) -> SignedPermutation:
    """Return the mirror map of parts side by side: hops change legs, clocks change feet, v_y changes its sign."""
    partners, signs = zip(*(part.image(robot) for part in parts), strict=True)
    starts = np.cumsum([0, *map(len, partners)])
    index = np.concatenate([start + partner for start, partner in zip(starts, partners, strict=False)])
    return SignedPermutation(torch.from_numpy(index), torch.from_numpy(np.concatenate(signs)).float())


@functools.cache
def terrain_mirror() -> SignedPermutation:
    """Return the mirror map of the terrain's samples, n = 221: y changes sign."""
    index = torch.arange(TERRAIN_SIZE).view(TERRAIN_SHAPE).flip(1).flatten()
    return SignedPermutation(index, torch.ones(TERRAIN_SIZE))

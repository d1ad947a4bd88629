"""The ground: contact settings, height fields with interpolation as in MuJoCo, and two generators of them."""

import dataclasses
import math

import mujoco
import numpy as np

from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.numeric import Array, namespace, whole
from hugwbc.settings import Positive, settings

_USUAL_TIME_CONSTANT = 0.02  # [s], MuJoCo's default
GROUNDS = ("firm", "soft")


@settings
class Ground:
    """How firmly the robot stands.

    Attributes:
        time_constant: of the spring-damper that pushes a sole out of the ground (`solref`) [s]; MuJoCo raises it to two
            time steps if it is shorter.
    """

    time_constant: Positive = 0.005

    @classmethod
    def named(cls, name: str) -> "Ground":
        """Return the firm ground of docs/arena.md, or the soft one of MuJoCo's default contacts."""
        if name not in GROUNDS:
            raise UnknownNameError("ground", name, GROUNDS)
        return cls() if name == "firm" else cls(_USUAL_TIME_CONSTANT)

    def apply_to(self, model: mujoco.MjModel) -> None:
        """Set the contacts and the solver of a newly compiled model."""
        usual = model.geom_solref[:, 0] == _USUAL_TIME_CONSTANT  # a file of the user's may ask for another
        model.geom_solref[usual, 0] = self.time_constant
        model.opt.cone, model.opt.impratio = mujoco.mjtCone.mjCONE_PYRAMIDAL, 1.0
        model.opt.iterations = 20


@dataclasses.dataclass(frozen=True, eq=False)
class HeightField:
    """Ground heights on a regular grid that is centred on the world's origin.

    Attributes:
        heights: ground height at the grid points [m], shape (rows along y, columns along x).
        size: extent in x and in y [m].
        gradient: slopes dz/dx and dz/dy of the ground's mean plane, which sets the contact normals of the feet; the
            heights include it.
    """

    heights: np.ndarray
    size: tuple[float, float]
    gradient: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if self.heights.ndim != 2 or min(self.heights.shape) < 2 or not np.all(np.isfinite(self.heights)):
            raise ConfigError(
                f"a height field needs at least 2 x 2 finite heights; the given array has shape {self.heights.shape}"
            )
        if not all(0.0 < extent < np.inf for extent in self.size):
            raise ConfigError(f"a height field's size is {self.size} m; give finite extents above 0")
        if not all(abs(rise) <= 1.0 for rise in self.gradient):
            raise ConfigError(f"a height field's gradient is {self.gradient}; give dz/dx and dz/dy from -1 to 1")

    def height_at(self, xy: np.ndarray) -> np.ndarray:
        """Return the height of the ground [m] at points (..., 2) [m]; beyond the edge it is the height of the edge.

        As in MuJoCo's collision detection, each cell consists of two triangles that share the diagonal from low x,
        low y to high x, high y.
        """
        return interpolated(self.heights, self.size, xy)


def interpolated(heights: Array, size: tuple[float, float], xy: Array) -> Array:
    """Return `HeightField.height_at` for heights and points in arrays or tensors."""
    rows, columns = heights.shape
    return on_grid(heights, (xy[..., 0] / size[0] + 0.5) * (columns - 1), (xy[..., 1] / size[1] + 0.5) * (rows - 1))


def on_grid(heights: Array, column: Array, row: Array) -> Array:
    """Return the height at places between the points of a grid, counted in columns and rows from its first point."""
    xp, (rows, columns) = namespace(column), heights.shape
    column, row = column.clip(0, columns - 1), row.clip(0, rows - 1)
    c, r = whole(column).clip(0, columns - 2), whole(row).clip(0, rows - 2)
    u, v = column - c, row - r
    near, far = heights[r, c], heights[r + 1, c + 1]
    corner = xp.where(u > v, heights[r, c + 1], heights[r + 1, c])
    return near + xp.maximum(u, v) * (corner - near) + xp.minimum(u, v) * (far - corner)


def rough_terrain(
    amplitude: float,
    rng: np.random.Generator,
    size: float = 16.0,
    spacing: float = 0.2,
    start_radius: float = 0.0,
    slope: float = 0.0,
) -> HeightField:
    """Generate uniformly random heights on a square grid around the world's origin.

    The heights lie within plus or minus `amplitude` of a level plane or of one that rises along x.

    Args:
        amplitude: half-width of the distribution of heights [m].
        rng: generator of the random heights.
        size: length of a side [m].
        spacing: distance of the grid points [m].
        start_radius: distance from the origin within which the ground is smooth, for the start [m].
        slope: angle at which the ground rises along x [rad].
    """
    if not 0.0 <= amplitude < 1.0:
        raise ConfigError(f"terrain amplitude is {amplitude}; give a height from 0 to 1 m")
    if not abs(slope) <= math.pi / 4.0:
        raise ConfigError(f"terrain slope is {slope} rad; give an angle from -0.78 to 0.78 rad")
    points = round(size / spacing) + 1
    heights = rng.uniform(-amplitude, amplitude, (points, points))
    axis = np.linspace(-size / 2.0, size / 2.0, points)
    heights[np.hypot(*np.meshgrid(axis, axis)) < start_radius] = 0.0
    rise = math.tan(slope)
    return HeightField(heights + rise * axis, (size, size), (rise, 0.0))


@dataclasses.dataclass(frozen=True, eq=False)
class LevelGround:
    """Random ground with increasing roughness: one square region for each level, side by side along x.

    Heights within a region are periodic. A robot that is moved by one period stands on the same ground, so a walk never
    ends at an edge.

    Attributes:
        field: height field with all regions.
        centres: centres of the regions [m], shape (levels, 2).
        period: period of the heights along x and y [m]; a region is two periods wide.
    """

    field: HeightField
    centres: np.ndarray
    period: float


def level_terrain(levels: int, amplitude: float, rng: np.random.Generator) -> LevelGround:
    """Generate regions of uniformly random heights, from a level plane to plus or minus `amplitude`, in equal steps.

    Args:
        levels: number of regions, at least 2.
        amplitude: half-width of the distribution of heights in the last region [m].
        rng: generator of the random heights.
    """
    if levels < 2 or not 0.0 <= amplitude < 1.0:
        raise ConfigError(f"{levels} terrain levels up to {amplitude} m; give at least 2 levels, and 0 to 1 m")
    period, spacing = 4.0, 0.2  # [m], of the heights, and between the grid points
    cells = round(period / spacing)
    tiles = [np.tile(rng.uniform(-1.0, 1.0, (cells, cells)), (2, 2)) for _ in range(levels)]
    scaled = [tile * amplitude * level / (levels - 1) for level, tile in enumerate(tiles)]
    heights = np.concatenate(scaled, axis=1)
    # Along each axis a grid has one point more than cells; the last points repeat the first of their own region.
    heights = np.concatenate((heights, scaled[-1][:, :1]), axis=1)
    heights = np.concatenate((heights, heights[:1]), axis=0)
    width = 2.0 * period
    centres = np.stack(((np.arange(levels) - (levels - 1) / 2.0) * width, np.zeros(levels)), axis=1)
    return LevelGround(HeightField(heights, (levels * width, width)), centres, period)

"""Contact of the feet with a height field: each contact sphere meets a plane at the height of the ground below it.

MuJoCo treats a height field as upright prisms. If an impact presses a small sphere in by more than its radius, the
sphere leaves its prism through the nearest face. Near an edge of the grid this face is vertical: with a grid of 2 cm,
half of a foot's contacts push sideways even on level ground, and robots stumble over nothing.

The spheres of the soles therefore do not collide with the field. They meet a plane through the ground below the
pelvis, and each sphere is moved within its foot by the difference between the plane and the ground at its own place.
On flat ground the result is exactly the plane. Contact normals are those of the ground's mean plane, and the contact
point is off by the difference in height. This suits gentle ground, a few centimetres about a level or a slope, but not
steps. All other links collide with the field.
"""

import math

import mujoco
import numpy as np

from hugwbc.numeric import Array, Place, double, namespace
from hugwbc.sim.terrain import HeightField, interpolated

PLANE_NAME = "footing"
FOOT_CONTACT_BIT = 1 << 30  # of the spheres, their plane and what they stand on; no file is likely to use it


def add_footing(spec: mujoco.MjSpec, terrain: HeightField) -> None:
    """Add the plane for the spheres of the soles to a model whose floor is this height field."""
    rise_x, rise_y = terrain.gradient
    floor = spec.geom("floor")
    spec.worldbody.add_geom(
        name=PLANE_NAME,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0.0, 0.0, 0.05],
        contype=FOOT_CONTACT_BIT,
        conaffinity=0,
        friction=floor.friction,
        rgba=[0.0, 0.0, 0.0, 0.0],  # invisible, and rays pass through it
        group=floor.group,
        # Any offset will do: MuJoCo ignores later changes of a position that is compiled as the body's origin.
        pos=[0.0, 0.0, -1e-3],
        zaxis=np.array([-rise_x, -rise_y, 1.0]) / math.sqrt(1.0 + rise_x**2 + rise_y**2),
    )
    for geom in spec.geoms:
        if geom.type == mujoco.mjtGeom.mjGEOM_SPHERE and geom.conaffinity:
            geom.conaffinity = FOOT_CONTACT_BIT
    # The midphase would use bounding boxes around the original positions of the spheres.
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE


class Footing:
    """Positions of the plane and the spheres, for one robot or many."""

    def __init__(self, model: mujoco.MjModel, terrain: HeightField, place: Place = np.asarray) -> None:
        """Find the geoms of a model that `add_footing` has changed; `place` turns constants into arrays or tensors."""
        spheres = np.flatnonzero(model.geom_conaffinity == FOOT_CONTACT_BIT)
        self.geoms = place(np.append(spheres, model.geom(PLANE_NAME).id))  # indices of the spheres and, last, the plane
        self._heights, self._size = place(terrain.heights), terrain.size
        self._gradient = place(np.array(terrain.gradient))
        self._bodies = place(model.geom_bodyid[spheres])
        self._pelvis = int(model.body_rootid[model.geom_bodyid[spheres[0]]])
        self._nominal = place(model.geom_pos[spheres].copy())
        self._radius = model.geom_size[spheres, 0].copy()

    def positions(self, xpos: Array, xmat: Array) -> Array:
        """Return the positions of `geoms` in their bodies [m], shape (..., geoms, 3).

        Args:
            xpos: origins of the bodies in the world [m], shape (..., bodies, 3).
            xmat: rotations from the bodies to the world, row by row, shape (..., bodies, 9).
        """
        xp, xpos = namespace(xpos), double(xpos)
        rotation, points = self._spheres(xpos, xmat)
        # The position of a diverged robot may be NaN.
        pelvis, below = xp.nan_to_num(xpos[..., self._pelvis, :2]), xp.nan_to_num(points[..., :2])
        # base: height at the world's origin of the mean plane through the ground below the pelvis; above: height of the
        # ground over this plane at each sphere.
        base = self._height_at(pelvis) - pelvis @ self._gradient
        above = self._height_at(below) - below @ self._gradient - base[..., None]
        # The third row of a foot's rotation is the world's vertical in the axes of the foot.
        spheres = self._nominal - above[..., None] * xp.nan_to_num(rotation[..., 2, :])
        zero = xp.zeros_like(base)
        return xp.concatenate((spheres, xp.stack((zero, zero, base), -1)[..., None, :]), -2)

    def depth(self, xpos: np.ndarray, xmat: np.ndarray) -> np.ndarray:
        """Return how far the spheres reach below the mean plane through the ground below the pelvis, at most [m].

        At least 0, shape (...); arguments as in `positions`.
        """
        _, points = self._spheres(xpos, xmat)
        pelvis = xpos[..., self._pelvis, :2]
        plane = (points[..., :2] - pelvis[..., None, :]) @ self._gradient + self._height_at(pelvis)[..., None]
        sunk = plane - points[..., 2] + self._radius
        return np.maximum(sunk.max(axis=-1), 0.0)

    def _height_at(self, xy: Array) -> Array:
        return interpolated(self._heights, self._size, xy)

    def _spheres(self, xpos: Array, xmat: Array) -> tuple[Array, Array]:
        """Return rotations of the spheres' bodies (..., spheres, 3, 3) and original centres (..., spheres, 3) [m]."""
        rotation = double(xmat)[..., self._bodies, :].reshape(*xmat.shape[:-2], len(self._bodies), 3, 3)
        return rotation, xpos[..., self._bodies, :] + namespace(xpos).einsum(
            "...sij,sj->...si", rotation, self._nominal
        )

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

from hugwbc.sim.terrain import HeightField

PLANE_NAME = "footing"
FOOT_CONTACT_BIT = 2  # only the spheres and their plane have it


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
    """Positions of the plane and the spheres, for one robot or many.

    Attributes:
        geoms: indices of the spheres and, last, the plane.
    """

    def __init__(self, model: mujoco.MjModel, terrain: HeightField) -> None:
        """Find the geoms.

        Args:
            model: model that `add_footing` has changed.
            terrain: height field of the ground.
        """
        spheres = np.flatnonzero(model.geom_conaffinity == FOOT_CONTACT_BIT)
        self.geoms = np.append(spheres, model.geom(PLANE_NAME).id)
        self._terrain = terrain
        self._gradient = np.array(terrain.gradient)
        self._bodies = model.geom_bodyid[spheres]
        self._pelvis = model.body("pelvis").id
        self._nominal = model.geom_pos[spheres].copy()
        self._radius = model.geom_size[spheres, 0].copy()

    def positions(self, xpos: np.ndarray, xmat: np.ndarray) -> np.ndarray:
        """Return the positions of `geoms` in their bodies [m], shape (..., geoms, 3).

        Args:
            xpos: origins of the bodies in the world [m], shape (..., bodies, 3).
            xmat: rotations from the bodies to the world, row by row, shape (..., bodies, 9).
        """
        rotation, points = self._spheres(xpos, xmat)
        # The position of a diverged robot may be NaN.
        pelvis, below = np.nan_to_num(xpos[..., self._pelvis, :2]), np.nan_to_num(points[..., :2])
        # Height of the plane through the ground below the pelvis at the world's origin; height of the ground above it.
        base = self._terrain.height_at(pelvis) - pelvis @ self._gradient
        above = self._terrain.height_at(below) - below @ self._gradient - base[..., None]
        result = np.zeros((*xpos.shape[:-2], len(self.geoms), 3))
        # The third row of a foot's rotation is the world's vertical in the axes of the foot.
        result[..., :-1, :] = self._nominal - above[..., None] * np.nan_to_num(rotation[..., 2, :])
        result[..., -1, 2] = base
        return result

    def depth(self, xpos: np.ndarray, xmat: np.ndarray) -> np.ndarray:
        """Return how deep the lowest sphere lies in the mean plane through the ground below the pelvis, at least 0 [m].

        Arguments as in `positions`; shape (...).
        """
        _, points = self._spheres(xpos, xmat)
        pelvis = xpos[..., self._pelvis, :2]
        plane = (points[..., :2] - pelvis[..., None, :]) @ self._gradient + self._terrain.height_at(pelvis)[..., None]
        sunk = plane - points[..., 2] + self._radius
        return np.maximum(sunk.max(axis=-1), 0.0)

    def _spheres(self, xpos: np.ndarray, xmat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rotations of the spheres' bodies (..., spheres, 3, 3) and original centres (..., spheres, 3) [m]."""
        rotation = xmat[..., self._bodies, :].reshape(*xmat.shape[:-2], len(self._bodies), 3, 3)
        return rotation, xpos[..., self._bodies, :] + np.einsum("...sij,sj->...si", rotation, self._nominal)

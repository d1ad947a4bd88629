"""Feet on a height field: each contact sphere meets a plane at the height of the ground below it.

MuJoCo collides with a height field as with upright prisms. A small sphere that an impact presses in by more than its
radius leaves its prism by the nearest face, near an edge of the grid a vertical one: at 2 cm half of the contacts of a
foot push sideways, even on level ground, and robots stumble over nothing. So the spheres of the soles do not collide
with the field. They meet a plane through the ground below the pelvis, and each sphere is moved within its foot by
the difference to the ground's height at its own place. On plane ground this is the plane, exactly. Contact normals are
those of the ground's mean plane, and the point of contact is off by that difference: right for gentle ground of a few
centimetres about a level or a slope, not for steps. The other links collide with the field.
"""

import math

import mujoco
import numpy as np

from hugwbc.sim.terrain import HeightField

PLANE_NAME = "footing"
FOOT_CONTACT_BIT = 2  # of spheres and plane alone


def add_footing(spec: mujoco.MjSpec, terrain: HeightField) -> None:
    """Add the plane for the soles' spheres to a model whose floor is this height field."""
    rise_x, rise_y = terrain.gradient
    floor = spec.geom("floor")
    spec.worldbody.add_geom(
        name=PLANE_NAME,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0.0, 0.0, 0.05],
        contype=FOOT_CONTACT_BIT,
        conaffinity=0,
        friction=floor.friction,
        rgba=[0.0, 0.0, 0.0, 0.0],  # neither seen nor hit by rays
        group=floor.group,
        # A pose of its own: MuJoCo does not look at the position of a geom that lies at its body's origin.
        pos=[0.0, 0.0, -1e-3],
        zaxis=np.array([-rise_x, -rise_y, 1.0]) / math.sqrt(1.0 + rise_x**2 + rise_y**2),
    )
    for geom in spec.geoms:
        if geom.type == mujoco.mjtGeom.mjGEOM_SPHERE and geom.conaffinity:
            geom.conaffinity = FOOT_CONTACT_BIT
    # Its boxes around bodies are those of the spheres' first places.
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE


class Footing:
    """Where plane and spheres are, for one robot or many.

    Attributes:
        geoms: indices of the spheres and, last, the plane.
    """

    def __init__(self, model: mujoco.MjModel, terrain: HeightField) -> None:
        """Find the geoms.

        Args:
            model: with `add_footing`.
            terrain: the ground.
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
        """Places of `geoms` in their bodies [m], shape (..., geoms, 3).

        Args:
            xpos: origins of the bodies in the world [m], shape (..., bodies, 3).
            xmat: their axes in the world, shape (..., bodies, 9).
        """
        rotation, points = self._spheres(xpos, xmat)
        # A diverged robot may be nowhere.
        pelvis, below = np.nan_to_num(xpos[..., self._pelvis, :2]), np.nan_to_num(points[..., :2])
        # Of the plane through the ground below the pelvis, at the world's origin and at the spheres.
        base = self._terrain.height_at(pelvis) - pelvis @ self._gradient
        above = self._terrain.height_at(below) - below @ self._gradient - base[..., None]
        result = np.zeros((*xpos.shape[:-2], len(self.geoms), 3))
        # The world's vertical in the axes of the foot is the third row of its rotation.
        result[..., :-1, :] = self._nominal - above[..., None] * np.nan_to_num(rotation[..., 2, :])
        result[..., -1, 2] = base
        return result

    def depth(self, xpos: np.ndarray, xmat: np.ndarray) -> np.ndarray:
        """How far the deepest sphere is in the mean plane through the ground below the pelvis, 0 if none is [m].

        Bodies as in `positions`; shape (...).
        """
        _, points = self._spheres(xpos, xmat)
        pelvis = xpos[..., self._pelvis, :2]
        plane = (points[..., :2] - pelvis[..., None, :]) @ self._gradient + self._terrain.height_at(pelvis)[..., None]
        sunk = plane - points[..., 2] + self._radius
        return np.maximum(sunk.max(axis=-1), 0.0)

    def _spheres(self, xpos: np.ndarray, xmat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Axes of the spheres' bodies, shape (..., spheres, 3, 3), and the unmoved spheres [m], (..., spheres, 3)."""
        rotation = xmat[..., self._bodies, :].reshape(*xmat.shape[:-2], len(self._bodies), 3, 3)
        return rotation, xpos[..., self._bodies, :] + np.einsum("...sij,sj->...si", rotation, self._nominal)

"""The robot's visual shapes, taken from the MuJoCo model as meshcat's primitives."""

import dataclasses
from collections.abc import Callable

import meshcat.geometry as geometry
import mujoco
import numpy as np

VISUAL_GROUP = 2
# meshcat's cylinder lies along y, MuJoCo's along z.
CYLINDER_TO_Z = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


@dataclasses.dataclass(frozen=True, eq=False)
class Shape:
    """One primitive of a link.

    Attributes:
        link: name of the body that carries the primitive.
        material: name of its MuJoCo material.
        colour: red, green and blue, each in [0, 1].
        primitive: the geometry, one of meshcat's.
        placement: homogeneous transform of the geometry in the link's frame, shape (4, 4).
    """

    link: str
    material: str
    colour: tuple[float, float, float]
    primitive: geometry.Geometry
    placement: np.ndarray


def homogeneous(position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """Return the homogeneous transform of a position [m] and a quaternion (w, x, y, z), shape (4, 4)."""
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, np.asarray(quaternion, dtype=float))
    placement = np.eye(4)
    placement[:3, :3], placement[:3, 3] = rotation.reshape(3, 3), position
    return placement


def along_z(z: float) -> np.ndarray:
    """Return the homogeneous transform of a shift along z [m], shape (4, 4)."""
    return homogeneous(np.array([0.0, 0.0, z]), np.array([1.0, 0, 0, 0]))


def _box(size: np.ndarray) -> list[tuple[geometry.Geometry, np.ndarray]]:
    return [(geometry.Box((2 * size).tolist()), np.eye(4))]


def _sphere(size: np.ndarray) -> list[tuple[geometry.Geometry, np.ndarray]]:
    return [(geometry.Sphere(float(size[0])), np.eye(4))]


def _ellipsoid(size: np.ndarray) -> list[tuple[geometry.Geometry, np.ndarray]]:
    return [(geometry.Ellipsoid(size), np.eye(4))]


def _cylinder(size: np.ndarray) -> list[tuple[geometry.Geometry, np.ndarray]]:
    cylinder = geometry.Cylinder(2 * float(size[1]), float(size[0]))
    cylinder.radialSegments = 24
    return [(cylinder, CYLINDER_TO_Z)]


def _capsule(size: np.ndarray) -> list[tuple[geometry.Geometry, np.ndarray]]:
    ends = [(geometry.Sphere(float(size[0])), along_z(sign * float(size[1]))) for sign in (-1, 1)]
    return _cylinder(size) + ends


_PRIMITIVES: dict[int, Callable[[np.ndarray], list[tuple[geometry.Geometry, np.ndarray]]]] = {
    mujoco.mjtGeom.mjGEOM_BOX: _box,
    mujoco.mjtGeom.mjGEOM_SPHERE: _sphere,
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: _ellipsoid,
    mujoco.mjtGeom.mjGEOM_CYLINDER: _cylinder,
    mujoco.mjtGeom.mjGEOM_CAPSULE: _capsule,
}


def visual_shapes(model: mujoco.MjModel) -> list[Shape]:
    """Return every visual shape of a model; meshcat has no capsules, so each becomes a cylinder and two spheres."""
    shapes = []
    for geom in np.flatnonzero(model.geom_group == VISUAL_GROUP):
        material = model.mat(model.geom_matid[geom])
        red, green, blue = (float(value) for value in material.rgba[:3])
        in_link = homogeneous(model.geom_pos[geom], model.geom_quat[geom])
        for primitive, placement in _PRIMITIVES[int(model.geom_type[geom])](model.geom_size[geom]):
            link = model.body(model.geom_bodyid[geom]).name
            shapes.append(Shape(link, material.name, (red, green, blue), primitive, in_link @ placement))
    return shapes

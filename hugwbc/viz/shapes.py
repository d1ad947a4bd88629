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
    """One primitive of a link, or of a body of a scene.

    Attributes:
        link: name of the body that carries the primitive.
        material: name of its MuJoCo material; empty without one.
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


def mesh_of(model: mujoco.MjModel, geom: int) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices [m], shape (n, 3), and triangles, shape (m, 3), of a mesh geom in its own frame."""
    mesh = int(model.geom_dataid[geom])
    vertices, faces = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
    return (
        model.mesh_vert[vertices : vertices + model.mesh_vertnum[mesh]].astype(float),
        model.mesh_face[faces : faces + model.mesh_facenum[mesh]].astype(int),
    )


def colour_of(model: mujoco.MjModel, geom: int) -> tuple[float, float, float]:
    """Return red, green and blue of a geom, its material's or its own, each in [0, 1]."""
    material = int(model.geom_matid[geom])
    red, green, blue = (model.geom_rgba[geom] if material < 0 else model.mat_rgba[material])[:3].tolist()
    return red, green, blue


def drawn_geoms(model: mujoco.MjModel) -> list[int]:
    """Return the geoms of a scene's model that are drawn: MuJoCo's groups 0 to 2, without planes and height fields."""
    kinds = (*map(int, _PRIMITIVES), int(mujoco.mjtGeom.mjGEOM_MESH))
    return [g for g in range(model.ngeom) if model.geom_group[g] <= VISUAL_GROUP and int(model.geom_type[g]) in kinds]


def object_shapes(model: mujoco.MjModel) -> list[Shape]:
    """Return the shapes of a scene's bodies (`Scene.model`), each with the name of its body."""
    shapes = []
    for geom in drawn_geoms(model):
        in_body = homogeneous(model.geom_pos[geom], model.geom_quat[geom])
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            vertices, faces = mesh_of(model, geom)
            parts: list[tuple[geometry.Geometry, np.ndarray]] = [
                (geometry.TriangularMeshGeometry(vertices, faces), np.eye(4))
            ]
        else:
            parts = _PRIMITIVES[int(model.geom_type[geom])](model.geom_size[geom])
        body = model.body(int(model.geom_bodyid[geom])).name
        for primitive, placement in parts:
            shapes.append(Shape(body, "", colour_of(model, geom), primitive, in_body @ placement))
    return shapes

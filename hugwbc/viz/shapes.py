"""The robot's visual shapes, taken from the MuJoCo model as meshcat's primitives."""

import dataclasses
from collections.abc import Callable
from typing import Any

import meshcat.geometry as geometry
import mujoco
import numpy as np

VISUAL_GROUP = 2
SEGMENTS = 48  # facets around a round shape
RING_SEGMENTS = 64, 16  # facets along and around a ring
_CLOSED = 1e-3  # [m], how close the ends of two links of a chain are
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


class _Fine:
    """Round shapes with smaller facets than meshcat's: patches that lie just above a shell would sink into it."""

    def lower(self, object_data: dict[str, Any]) -> dict[str, Any]:
        """Return the shape as three.js reads it."""
        lowered = super().lower(object_data)  # type: ignore[misc]
        return {**lowered, "widthSegments": SEGMENTS, "heightSegments": SEGMENTS // 2}


class FineSphere(_Fine, geometry.Sphere):
    """A sphere with small facets."""


class FineEllipsoid(_Fine, geometry.Ellipsoid):
    """An ellipsoid with small facets."""


def _sphere(size: np.ndarray) -> list[tuple[geometry.Geometry, np.ndarray]]:
    return [(FineSphere(float(size[0])), np.eye(4))]


def _ellipsoid(size: np.ndarray) -> list[tuple[geometry.Geometry, np.ndarray]]:
    return [(FineEllipsoid(size), np.eye(4))]


def _cylinder(size: np.ndarray) -> list[tuple[geometry.Geometry, np.ndarray]]:
    cylinder = geometry.Cylinder(2 * float(size[1]), float(size[0]))
    cylinder.radialSegments = SEGMENTS
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
    """Return every visual shape of a model.

    meshcat has no capsules: each becomes a cylinder and two spheres, and a closed chain of them one smooth ring.
    """
    shapes = []
    rings = capsule_rings(model)
    in_rings = {geom for ring in rings for geom in ring}
    for ring in rings:
        link, material, colour = _of_geom(model, ring[0])
        shapes.append(
            Shape(link, material, colour, geometry.TriangularMeshGeometry(*ring_mesh(model, ring)), np.eye(4))
        )
    for geom in np.flatnonzero(model.geom_group == VISUAL_GROUP).tolist():
        if geom in in_rings:
            continue
        link, material, colour = _of_geom(model, geom)
        in_link = homogeneous(model.geom_pos[geom], model.geom_quat[geom])
        for primitive, placement in _PRIMITIVES[int(model.geom_type[geom])](model.geom_size[geom]):
            shapes.append(Shape(link, material, colour, primitive, in_link @ placement))
    return shapes


def _of_geom(model: mujoco.MjModel, geom: int) -> tuple[str, str, tuple[float, float, float]]:
    """Return link, material and colour of a visual geom."""
    material = model.mat(model.geom_matid[geom])
    red, green, blue = (float(value) for value in material.rgba[:3])
    return model.body(model.geom_bodyid[geom]).name, material.name, (red, green, blue)


def _capsule_ends(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Return the centres of both ends of a capsule in its link's frame [m], shape (2, 3)."""
    along = homogeneous(model.geom_pos[geom], model.geom_quat[geom])[:3, 2] * model.geom_size[geom, 1]
    return np.stack((model.geom_pos[geom] - along, model.geom_pos[geom] + along))


def capsule_rings(model: mujoco.MjModel) -> list[list[int]]:
    """Return the closed chains of visual capsules of one link, material and radius, each as geoms in their order."""
    rings, chain = [], []
    kind = int(mujoco.mjtGeom.mjGEOM_CAPSULE)
    for geom in np.flatnonzero((model.geom_group == VISUAL_GROUP) & (model.geom_type == kind)).tolist():
        alike = chain and all(
            values[chain[-1]] == values[geom] for values in (model.geom_bodyid, model.geom_matid, model.geom_size[:, 0])
        )
        chain = [*chain, geom] if alike and _touch(model, chain[-1], geom) else [geom]
        if len(chain) > 2 and _touch(model, chain[-1], chain[0]):
            rings.append(chain)
            chain = []
    return rings


def _touch(model: mujoco.MjModel, one: int, other: int) -> bool:
    """Return whether two capsules have an end in common."""
    apart = _capsule_ends(model, one)[:, None] - _capsule_ends(model, other)[None]
    return bool(np.linalg.norm(apart, axis=-1).min() < _CLOSED)


def ring_mesh(model: mujoco.MjModel, ring: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Return a smooth tube through the middles of a ring's capsules, in the link's frame.

    Args:
        model: the model.
        ring: one of `capsule_rings`.

    Returns:
        Vertices [m], shape (n, 3), and triangles, shape (m, 3).
    """
    corners = np.array([_capsule_ends(model, geom).mean(axis=0) for geom in ring])
    along, around = RING_SEGMENTS
    # A closed curve through the points, without corners: their Fourier series.
    spectrum = np.fft.rfft(corners, axis=0)
    middle = np.fft.irfft(spectrum, along, axis=0) * (along / len(corners))
    tangent = np.roll(middle, -1, axis=0) - np.roll(middle, 1, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.cross(corners[0] - corners.mean(axis=0), corners[len(corners) // 4] - corners.mean(axis=0))
    normal /= np.linalg.norm(normal)
    outward = np.cross(tangent, normal)
    angle = 2.0 * np.pi * np.arange(around)[:, None] / around
    radius = float(model.geom_size[ring[0], 0])
    vertices = np.concatenate([m + radius * (np.cos(angle) * o + np.sin(angle) * normal)
                               for m, o in zip(middle, outward, strict=True)])  # fmt: skip
    row, column = np.divmod(np.arange(along * around), around)
    nxt = (column + 1) % around
    first, second = row * around, (row + 1) % along * around
    faces = np.concatenate((
        np.stack((first + column, second + column, second + nxt), axis=1),
        np.stack((first + column, second + nxt, first + nxt), axis=1),
    ))  # fmt: skip
    # The volume that the triangles enclose is above 0 where they face outward.
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    if np.sum(np.cross(a, b) * c) < 0.0:
        faces = faces[:, ::-1]
    return vertices, faces


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

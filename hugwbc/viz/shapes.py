"""The shapes that pictures are made of: meshcat's primitives, for the geoms of a MuJoCo model and for marks.

The live scene and the replay page draw them with meshcat, the live page as meshes, the video as MuJoCo's geoms.
"""

import dataclasses
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, cast

import meshcat.geometry as geometry
import mujoco
import numpy as np

if TYPE_CHECKING:
    import trimesh

VISUAL_GROUP = 2  # geoms of this group and those below it are drawn
SEGMENTS = 48  # facets around a round shape
# meshcat's cylinder lies along y, MuJoCo's along z.
CYLINDER_TO_Z = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


@dataclasses.dataclass(frozen=True, eq=False)
class Shape:
    """One primitive of a body or of a mark."""

    primitive: geometry.Geometry  # the geometry, one of meshcat's
    colour: str  # colour as "#rrggbb"
    # homogeneous transform of the geometry in the frame of its body or mark, shape (4, 4)
    placement: np.ndarray = dataclasses.field(default_factory=lambda: np.eye(4))
    opacity: float = 1.0  # opacity in (0, 1]
    on_top: bool = False  # whether the shape is drawn over everything that would hide it
    body: str = ""  # name of the body that carries the shape; empty for a mark
    material: str = ""  # name of the geom's MuJoCo material; empty without one


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


def hex_colour(rgb: Iterable[float]) -> str:
    """Return red, green and blue, each in [0, 1], as "#rrggbb"."""
    return "#" + "".join(f"{round(255 * value):02x}" for value in rgb)


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


def shapes_of(model: mujoco.MjModel) -> list[Shape]:
    """Return the shapes of all geoms that are drawn, which planes and height fields are not."""
    shapes = []
    for geom in np.flatnonzero(model.geom_group <= VISUAL_GROUP).tolist():
        material = int(model.geom_matid[geom])
        colour = hex_colour((model.geom_rgba[geom] if material < 0 else model.mat_rgba[material])[:3])
        named = {
            "body": model.body(int(model.geom_bodyid[geom])).name,
            "material": "" if material < 0 else model.mat(material).name,
        }
        in_body = homogeneous(model.geom_pos[geom], model.geom_quat[geom])
        parts = _primitives(model, geom)
        shapes += [Shape(primitive, colour, in_body @ placement, **named) for primitive, placement in parts]
    return shapes


def _primitives(model: mujoco.MjModel, geom: int) -> list[tuple[geometry.Geometry, np.ndarray]]:
    """Return what a geom is drawn with, and the transforms of these into its frame, shape (4, 4) each."""
    size = model.geom_size[geom]
    radius, half = size[:2].tolist()  # of round shapes
    cylinder = geometry.Cylinder(2 * half, radius)
    cylinder.radialSegments = SEGMENTS
    match mujoco.mjtGeom(model.geom_type[geom]):
        case mujoco.mjtGeom.mjGEOM_MESH:
            return [(geometry.TriangularMeshGeometry(*_mesh(model, geom)), np.eye(4))]
        case mujoco.mjtGeom.mjGEOM_BOX:
            return [(geometry.Box((2 * size).tolist()), np.eye(4))]
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            return [(FineSphere(radius), np.eye(4))]
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            return [(FineEllipsoid(size), np.eye(4))]
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            return [(cylinder, CYLINDER_TO_Z)]
        case mujoco.mjtGeom.mjGEOM_CAPSULE:  # a cylinder with a ball at each end; meshcat has no capsules
            balls = [(geometry.Sphere(radius), along_z(sign * half)) for sign in (-1, 1)]
            return [(cylinder, CYLINDER_TO_Z), *balls]
    return []


def _mesh(model: mujoco.MjModel, geom: int) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices [m], shape (n, 3), and triangles, shape (m, 3), of a mesh geom in its own frame."""
    mesh = int(model.geom_dataid[geom])
    vertices, faces = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
    return (
        model.mesh_vert[vertices : vertices + model.mesh_vertnum[mesh]].astype(float),
        model.mesh_face[faces : faces + model.mesh_facenum[mesh]].astype(int),
    )


def colour_meshes(shapes: Iterable[Shape]) -> dict[str, dict[str, "trimesh.Trimesh"]]:
    """Return the shapes of each body in its frame, joined to one mesh for each colour, by the body's name."""
    import trimesh  # of the extra [live]

    parts: dict[str, dict[str, list[trimesh.Trimesh]]] = {}
    for shape in shapes:
        mesh = _trimesh(shape.primitive).apply_transform(shape.placement)
        parts.setdefault(shape.body, {}).setdefault(shape.colour, []).append(mesh)
    return {
        body: {colour: cast(trimesh.Trimesh, trimesh.util.concatenate(meshes)) for colour, meshes in of_body.items()}
        for body, of_body in parts.items()
    }


def _trimesh(primitive: geometry.Geometry) -> "trimesh.Trimesh":
    import trimesh

    if isinstance(primitive, geometry.TriangularMeshGeometry):
        return trimesh.Trimesh(primitive.vertices, primitive.faces, process=False)
    if isinstance(primitive, geometry.Box):
        return trimesh.creation.box(extents=primitive.lengths)
    if isinstance(primitive, geometry.Cylinder):
        cylinder = trimesh.creation.cylinder(primitive.radiusTop, primitive.height, sections=40)
        return cylinder.apply_transform(CYLINDER_TO_Z.T)
    ball = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    return ball.apply_scale(primitive.radii if isinstance(primitive, geometry.Ellipsoid) else primitive.radius)

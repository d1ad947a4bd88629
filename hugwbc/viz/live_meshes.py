"""The shapes of robot and objects (`hugwbc.viz.shapes`) as meshes, for the live page."""

from collections.abc import Iterable
from typing import cast

import meshcat.geometry as geometry
import trimesh

from hugwbc.viz.shapes import CYLINDER_TO_Z, Shape


def colour_meshes(shapes: Iterable[Shape]) -> dict[str, dict[str, trimesh.Trimesh]]:
    """Return the shapes of each body in its frame, joined to one mesh for each colour, by the body's name."""
    parts: dict[str, dict[str, list[trimesh.Trimesh]]] = {}
    for shape in shapes:
        mesh = _mesh(shape.primitive).apply_transform(shape.placement)
        parts.setdefault(shape.body, {}).setdefault(shape.colour, []).append(mesh)
    return {
        body: {colour: cast(trimesh.Trimesh, trimesh.util.concatenate(meshes)) for colour, meshes in of_body.items()}
        for body, of_body in parts.items()
    }


def _mesh(primitive: geometry.Geometry) -> trimesh.Trimesh:
    if isinstance(primitive, geometry.TriangularMeshGeometry):
        return trimesh.Trimesh(primitive.vertices, primitive.faces, process=False)
    if isinstance(primitive, geometry.Box):
        return trimesh.creation.box(extents=primitive.lengths)
    if isinstance(primitive, geometry.Cylinder):
        cylinder = trimesh.creation.cylinder(primitive.radiusTop, primitive.height, sections=40)
        return cylinder.apply_transform(CYLINDER_TO_Z.T)
    ball = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    return ball.apply_scale(primitive.radii if isinstance(primitive, geometry.Ellipsoid) else primitive.radius)

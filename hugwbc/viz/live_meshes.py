"""Shapes of the robot and of objects as meshes for the live page."""

import mujoco
import numpy as np
import trimesh

from hugwbc.viz.shapes import VISUAL_GROUP, capsule_rings, colour_of, drawn_geoms, homogeneous, mesh_of, ring_mesh


def link_meshes(model: mujoco.MjModel, link: str) -> dict[str, trimesh.Trimesh]:
    """Return the visual shapes of a link in its frame, as one mesh for each material, by the material's name."""
    body = model.body(link).id
    parts: dict[str, list[trimesh.Trimesh]] = {}
    rings = [ring for ring in capsule_rings(model) if model.geom_bodyid[ring[0]] == body]
    for ring in rings:
        material = model.mat(model.geom_matid[ring[0]]).name
        parts.setdefault(material, []).append(trimesh.Trimesh(*ring_mesh(model, ring), process=False))
    in_rings = {geom for ring in rings for geom in ring}
    for geom in np.flatnonzero((model.geom_group == VISUAL_GROUP) & (model.geom_bodyid == body)).tolist():
        if geom in in_rings:
            continue
        part = _primitive(int(model.geom_type[geom]), model.geom_size[geom])
        part.apply_transform(homogeneous(model.geom_pos[geom], model.geom_quat[geom]))
        parts.setdefault(model.mat(model.geom_matid[geom]).name, []).append(part)
    return {material: _joined(shapes) for material, shapes in parts.items()}


def object_meshes(model: mujoco.MjModel, body: str) -> list[tuple[tuple[int, int, int], trimesh.Trimesh]]:
    """Return the shapes of a body of a scene's model in its frame, one mesh for each colour (three numbers to 255)."""
    parts: dict[tuple[int, int, int], list[trimesh.Trimesh]] = {}
    for geom in drawn_geoms(model):
        if model.geom_bodyid[geom] == model.body(body).id:
            part = _primitive(int(model.geom_type[geom]), model.geom_size[geom])
            if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
                part = trimesh.Trimesh(*mesh_of(model, geom), process=False)
            part.apply_transform(homogeneous(model.geom_pos[geom], model.geom_quat[geom]))
            red, green, blue = (round(255 * value) for value in colour_of(model, geom))
            parts.setdefault((red, green, blue), []).append(part)
    return [(colour, _joined(shapes)) for colour, shapes in parts.items()]


def _joined(parts: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    first = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    return trimesh.Trimesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, first, strict=True)]),
        process=False,
    )


def _primitive(kind: int, size: np.ndarray) -> trimesh.Trimesh:
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return trimesh.creation.box(extents=2 * size)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return trimesh.creation.cylinder(radius=size[0], height=2 * size[1], sections=40)
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return trimesh.creation.capsule(radius=size[0], height=2 * size[1], count=[16, 16])
    ball = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    ball.apply_scale(size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else size[0])
    return ball

"""The marks around a robot as MuJoCo's geoms, for the video: the replay's, which are meshcat's primitives."""

from collections.abc import Mapping, Sequence

import meshcat.geometry as geometry
import mujoco
import numpy as np

from hugwbc.sim.scene import SIMULATION_TIMESTEP, load_model
from hugwbc.viz.framing import Trace, moment
from hugwbc.viz.marks import Mark, Marks
from hugwbc.viz.overlays import FORCE, FORCE_RADIUS, Part, footprint, mark_parts
from hugwbc.viz.shapes import CYLINDER_TO_Z, homogeneous, visual_shapes

# A geom is a row of numbers: type, size (3), position (3), rotation (9), red, green, blue and opacity.
GEOM_NUMBERS = 20
ARROW_RADIUS = 2.0 * FORCE_RADIUS  # of its head; MuJoCo's arrows have a thinner shaft [m]
PRINT_OPACITY = 0.8


def mark_geoms(trace: Trace, samples: np.ndarray, label: str, offset: float, layers: Sequence[str]) -> list[np.ndarray]:
    """Geoms of the marks of a run at some of its samples.

    Args:
        trace: the run.
        samples: indices, shape (frames,).
        label: the robot's colour, "#rrggbb".
        offset: of the robot to the left [m].
        layers: those of `overlays.LAYERS` that are shown.

    Returns:
        For each frame an array of shape (geoms, `GEOM_NUMBERS`).
    """
    model = load_model(SIMULATION_TIMESTEP)
    marks = Marks(model)
    parts = {
        name: pieces
        for name, pieces in mark_parts(visual_shapes(model), label, marks.sole).items()
        if name.split("/")[0] in layers
    }
    prints = _footprints(trace, marks, label) if "steps" in layers else []
    frames = []
    for sample in samples:
        placed = marks.at(moment(trace, int(sample)))
        rows = [row for time, row in prints if time <= trace.time[sample]]
        for name, pieces in parts.items():
            placement = _placement(name, placed)
            if placement is not None:
                rows += [_arrow(placement)] if name.startswith("forces/") else [_geom(p, placement) for p in pieces]
        frame = np.array(rows).reshape(-1, GEOM_NUMBERS)
        frame[:, 5] += offset
        frames.append(frame)
    return frames


def _footprints(trace: Trace, marks: Marks, label: str) -> list[tuple[float, np.ndarray]]:
    """Footprints and the times from which on they are there."""
    part, prints = footprint(label, PRINT_OPACITY), []
    for foot in range(2):
        for time in trace.touch_downs[foot]:
            if time <= trace.time[-1]:
                mark = marks.footprint(trace.qpos[int(np.searchsorted(trace.time, time))], foot)
                prints.append((float(time), _geom(part, _of(mark))))
    return prints


def _placement(name: str, placed: Mapping[str, Mark]) -> np.ndarray | None:
    """Where a mark is, on the marks that it is part of, with their scales, shape (4, 4); None where one is hidden."""
    placement, steps = np.eye(4), name.split("/")
    for end in range(1, len(steps) + 1):
        mark = placed.get("/".join(steps[:end]))
        if mark is None:
            continue
        if not mark.visible:
            return None
        placement = placement @ _of(mark)
    return placement


def _of(mark: Mark) -> np.ndarray:
    placement = homogeneous(mark.position, mark.quaternion)
    placement[:3, :3] *= mark.scale
    return placement


def _geom(part: Part, placement: np.ndarray) -> np.ndarray:
    """One primitive as a row; axes of the part must be those along which the placement scales."""
    whole = placement @ part.placement
    scale = np.linalg.norm(whole[:3, :3], axis=0)
    turn, primitive = whole[:3, :3] / scale, part.primitive
    match primitive:
        case geometry.Ellipsoid():
            kind, size = mujoco.mjtGeom.mjGEOM_ELLIPSOID, np.asarray(primitive.radii) * scale
        case geometry.Sphere():
            kind, size = mujoco.mjtGeom.mjGEOM_SPHERE, primitive.radius * scale
        case geometry.Box():
            kind, size = mujoco.mjtGeom.mjGEOM_BOX, 0.5 * np.asarray(primitive.lengths) * scale
        case geometry.Cylinder():
            radius, half = primitive.radiusBottom * scale[0], 0.5 * primitive.height * scale[1]
            kind, size = mujoco.mjtGeom.mjGEOM_CYLINDER, np.array([radius, half, 0.0])
            turn = turn @ CYLINDER_TO_Z[:3, :3].T
        case _:
            raise TypeError(f"no geom of MuJoCo is a {type(primitive).__name__}")
    return _row(kind, size, whole[:3, 3], turn, part.colour, part.opacity)


def _arrow(placement: np.ndarray) -> np.ndarray:
    """An arrow of a force along z: MuJoCo has arrows, but no cones to make one of."""
    scale = np.linalg.norm(placement[:3, :3], axis=0)
    size = np.array([ARROW_RADIUS, ARROW_RADIUS, scale[2]])
    return _row(mujoco.mjtGeom.mjGEOM_ARROW, size, placement[:3, 3], placement[:3, :3] / scale, FORCE, 0.9)


def _row(
    kind: mujoco.mjtGeom, size: np.ndarray, position: np.ndarray, turn: np.ndarray, colour: str, opacity: float
) -> np.ndarray:
    rgb = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    return np.concatenate(([int(kind)], size, position, turn.ravel(), rgb, [opacity]))

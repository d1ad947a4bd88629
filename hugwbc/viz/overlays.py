"""What the marks around a robot look like: meshcat's primitives for everything that `hugwbc.viz.marks` places."""

import dataclasses
from collections.abc import Sequence

import meshcat.geometry as geometry
import numpy as np

from hugwbc.robot import SIDES, load_robot
from hugwbc.viz.marks import EDGES
from hugwbc.viz.shapes import CYLINDER_TO_Z, Shape, along_z

# Groups of marks that are shown and hidden together, with their names for people.
LAYERS = {
    "hands": "commanded hands",
    "steps": "footsteps",
    "forces": "contact forces",
    "balance": "centre of mass and support",
    "phases": "gait phases",
}
STANCE, SWING, FORCE, BALANCE = "#1a9c84", "#f0cf26", "#d1384b", "#4b2e83"
TARGET_RADIUS = 0.035  # [m]
FORCE_RADIUS, LINE_RADIUS, CENTRE_RADIUS, GROUND_RADIUS = 0.012, 0.007, 0.04, 0.03  # [m]
STEP_THICKNESS, SLAB_HEIGHT = 0.004, (0.02, 0.045)  # [m]; a phase's slab leaves the support line below it in sight
SOLE_EDGE = 0.015  # [m] by which footprints and slabs stand out around the sole
HEAD = 0.15  # of an arrow's length


@dataclasses.dataclass(frozen=True, eq=False)
class Part:
    """One primitive of a mark.

    Attributes:
        primitive: meshcat's geometry.
        colour: "#rrggbb".
        opacity: in (0, 1].
        placement: in the mark's frame, shape (4, 4).
        on_top: whether nothing hides it.
    """

    primitive: geometry.Geometry
    colour: str
    opacity: float = 1.0
    placement: np.ndarray = dataclasses.field(default_factory=lambda: np.eye(4))
    on_top: bool = False


def mark_parts(shapes: Sequence[Shape], label: str, sole: np.ndarray) -> dict[str, list[Part]]:
    """What every mark is made of, by its path below the robot.

    Args:
        shapes: of the robot, for the ghosts of its forearms.
        label: the robot's colour, "#rrggbb".
        sole: middle of a sole in the ankle link's frame [m], shape (3,).
    """
    parts: dict[str, list[Part]] = {}
    for side in SIDES:
        parts[f"hands/target_{side}"] = [Part(geometry.Sphere(TARGET_RADIUS), label, 0.75)]
        forearm = [shape for shape in shapes if shape.link == f"{side}_elbow_link"]
        parts[f"hands/ghost_{side}"] = [Part(shape.primitive, label, 0.3, shape.placement) for shape in forearm]
        parts[f"steps/planned_{side}"] = [footprint(label, 0.35)]
        parts[f"forces/{side}"] = _arrow()
        for name, colour in (("stance", STANCE), ("swing", SWING)):
            parts[f"phases/{side}/{name}"] = [_slab(colour, sole)]
    parts["balance/centre"] = [Part(geometry.Sphere(CENTRE_RADIUS), BALANCE)]
    parts["balance/plumb"] = [Part(_rod(1.0, 0.5 * LINE_RADIUS), BALANCE, 1.0, along_z(0.5) @ CYLINDER_TO_Z)]
    parts["balance/ground"] = [Part(_rod(0.004, GROUND_RADIUS), BALANCE, 1.0, along_z(0.004) @ CYLINDER_TO_Z)]
    for index in range(EDGES):
        edge = Part(_rod(1.0, LINE_RADIUS), BALANCE, 1.0, along_z(0.5) @ CYLINDER_TO_Z, on_top=True)
        parts[f"balance/edge_{index}"] = [edge]
    return parts


def footprint(colour: str, opacity: float) -> Part:
    """A sole's print on the ground, in the frame of the sole's middle."""
    return Part(_sole_box(STEP_THICKNESS), colour, opacity, along_z(0.5 * STEP_THICKNESS))


def _slab(colour: str, sole: np.ndarray) -> Part:
    low, high = SLAB_HEIGHT
    placement = along_z(0.5 * (low + high))
    placement[:3, 3] += sole
    return Part(_sole_box(high - low), colour, 1.0, placement)


def _sole_box(height: float) -> geometry.Box:
    robot = load_robot()
    length, width = float(np.diff(robot.sole_x)[0]), float(np.diff(robot.sole_y)[0])
    return geometry.Box([length + 2 * SOLE_EDGE, width + 2 * SOLE_EDGE, height])


def _rod(length: float, radius: float) -> geometry.Cylinder:
    return geometry.Cylinder(length, radius)


def _arrow() -> list[Part]:
    """Of unit length along z."""
    shaft, head = 1.0 - HEAD, geometry.Cylinder(HEAD, radiusTop=0.0, radiusBottom=2.2 * FORCE_RADIUS)
    return [
        Part(_rod(shaft, FORCE_RADIUS), FORCE, 0.9, along_z(0.5 * shaft) @ CYLINDER_TO_Z, on_top=True),
        Part(head, FORCE, 0.9, along_z(1.0 - 0.5 * HEAD) @ CYLINDER_TO_Z, on_top=True),
    ]

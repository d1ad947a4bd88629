"""Marks around a robot: commanded hands, footsteps, contact forces, balance, gait phases.

`Marks` says where each mark is in a snapshot, `mark_shapes` what it looks like. The live scene, the replay page and the
video all draw these marks.
"""

import dataclasses
from collections.abc import Sequence

import meshcat.geometry as geometry
import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from hugwbc import rotations
from hugwbc.gait import DEFAULT_DUTY, foot_phases
from hugwbc.robot import SIDES, Robot
from hugwbc.runtime.trace import Snapshot, Trace
from hugwbc.sim.robot_model import robot_layout
from hugwbc.viz.shapes import CYLINDER_TO_Z, Shape, along_z, homogeneous

FORCE_SCALE = 1e-3  # [m/N], length of a force's arrow
HAND_FORCE_SCALE = 5e-3  # [m/N]; forces on hands are small beside those on feet
LEAST_FORCE = 1.0  # [N]; smaller forces are not drawn
EDGES = 4  # largest number of edges of the support area, whose corners are two heels and two toes
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])

# Groups of marks that are shown and hidden together, with the names that users see.
LAYERS = {
    "hands": "commanded hands",
    "steps": "footsteps",
    "forces": "contact forces, 1 mm for 1 N (at hands 5 mm)",
    "balance": "centre of mass and support",
    "phases": "gait phases",
}
STANCE, SWING, FORCE, BALANCE = "#1a9c84", "#f0cf26", "#d1384b", "#4b2e83"
TARGET_RADIUS = 0.035  # [m]
FORCE_RADIUS, LINE_RADIUS, CENTRE_RADIUS, GROUND_RADIUS = 0.012, 0.007, 0.04, 0.03  # [m]
STEP_THICKNESS = 0.004  # [m]
SLAB_HEIGHT = (0.02, 0.045)  # [m], lower and upper side of a phase's slab; the support line stays visible below it
SOLE_EDGE = 0.015  # [m], how far footprints and slabs stick out around the sole
HEAD = 0.15  # length of an arrow's head, as a share of the arrow


@dataclasses.dataclass(frozen=True, eq=False)
class Mark:
    """One mark at one time; a mark that is not visible keeps its last place."""

    visible: bool = True  # whether the mark is shown
    # position in the world [m], shape (3,)
    position: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(3))
    quaternion: np.ndarray = dataclasses.field(default_factory=lambda: UPRIGHT)  # orientation (w, x, y, z), shape (4,)
    # scale along the mark's own axes, shape (3,)
    scale: np.ndarray = dataclasses.field(default_factory=lambda: np.ones(3))

    @property
    def placement(self) -> np.ndarray:
        """The transform of the mark's shapes, shape (4, 4)."""
        placement = homogeneous(self.position, self.quaternion)
        placement[:3, :3] *= self.scale
        return placement


HIDDEN = Mark(visible=False)


class Marks:
    """The marks around one robot, found from a snapshot by the robot's kinematics."""

    def __init__(self, model: mujoco.MjModel, robot: Robot) -> None:
        """Set up for a robot and a model that holds it."""
        self._model = model
        self._data, self._ghost = mujoco.MjData(model), mujoco.MjData(model)
        self._robot = robot
        self._layout = robot_layout(model, self._robot)
        self._pelvis = model.body(robot.base).id
        self._half_sole = np.array([0.5 * np.diff(robot.sole_x)[0], 0.0, 0.0])

    def at(self, snapshot: Snapshot) -> dict[str, Mark]:
        """Return all marks by their path below the robot; the first part of a path is the layer, one of `LAYERS`."""
        self._data.qpos[self._layout.qpos] = snapshot.qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        return {
            **self._hands(snapshot),
            **self._planned_steps(snapshot),
            **_forces(snapshot),
            **self._hand_forces(snapshot),
            **self._balance(snapshot.foot_contact),
            **self._phases(snapshot),
        }

    def body(self, name: str) -> Mark:
        """Return where a body of the model was at the last moment asked for."""
        return _mark_of(self._data, name)

    def footprint(self, qpos: np.ndarray, foot: int) -> Mark:
        """Return the mark that a foot (0 left, 1 right) leaves on level ground, given `Snapshot.qpos`."""
        self._data.qpos[self._layout.qpos] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        centre, turn = self._sole(foot)
        return Mark(
            position=centre,
            quaternion=rotations.from_yaw_pitch_roll(float(np.arctan2(turn[1, 0], turn[0, 0])), 0.0, 0.0),
        )

    def footprints(self, trace: Trace) -> list[tuple[float, Mark]]:
        """Return the footprints of a run in the order in which they appear, each with its time [s]."""
        downs = sorted((float(t), foot) for foot in range(2) for t in trace.touch_downs[foot] if t <= trace.time[-1])
        return [(t, self.footprint(trace.qpos[int(np.searchsorted(trace.time, t))], foot)) for t, foot in downs]

    def _sole(self, foot: int) -> tuple[np.ndarray, np.ndarray]:
        site = self._data.site(f"{SIDES[foot]}_sole")
        return site.xpos.copy(), site.xmat.reshape(3, 3)

    def _hands(self, snapshot: Snapshot) -> dict[str, Mark]:
        marks = {}
        for side, target in zip(SIDES, snapshot.hand_target_world, strict=True):
            known = bool(np.all(np.isfinite(target)))
            marks[f"hands/target_{side}"] = Mark(position=target) if known else HIDDEN
        moved = bool(np.all(np.isfinite(snapshot.arm_target)))
        if moved:
            # The ghost is the same robot with the arms where the IK wants them.
            self._ghost.qpos[self._layout.qpos] = snapshot.qpos
            self._ghost.qpos[self._layout.joints][self._robot.arms] = snapshot.arm_target
            mujoco.mj_kinematics(self._model, self._ghost)
        for side, link in zip(SIDES, self._robot.hand_links, strict=True):
            marks[f"hands/ghost_{side}"] = _mark_of(self._ghost, link) if moved else HIDDEN
        return marks

    def _hand_forces(self, snapshot: Snapshot) -> dict[str, Mark]:
        """Return the forces on the hands, as arrows that end at the hands: they push."""
        marks = {}
        for side, force in zip(SIDES, snapshot.hand_force, strict=True):
            shown = bool(np.linalg.norm(force) > LEAST_FORCE)
            hand = self._data.site(f"{side}_hand").xpos
            marks[f"forces/{side}_hand"] = _bar(hand - HAND_FORCE_SCALE * force, hand.copy()) if shown else HIDDEN
        return marks

    def _planned_steps(self, snapshot: Snapshot) -> dict[str, Mark]:
        """Return the planned footholds, on the ground below the lower sole and with the heading of the pelvis."""
        height = min(self._sole(foot)[0][2] for foot in range(2))
        heading = rotations.from_yaw_pitch_roll(float(rotations.yaw_of(snapshot.qpos[3:7])), 0.0, 0.0)
        marks = {}
        for side, foothold in zip(SIDES, snapshot.foothold, strict=True):
            known = bool(np.all(np.isfinite(foothold)))
            marks[f"steps/planned_{side}"] = Mark(True, np.array([*foothold, height]), heading) if known else HIDDEN
        return marks

    def _balance(self, foot_contact: np.ndarray) -> dict[str, Mark]:
        """Return the centre of mass and, while a foot is on the ground, its plumb line and the support area's edges.

        Each foot counts by its heel and its toe: the H1's soles are only 3 cm wide.
        """
        centre = self._data.subtree_com[self._pelvis].copy()
        marks = dict.fromkeys(("balance/plumb", "balance/ground", *(f"balance/edge_{i}" for i in range(EDGES))), HIDDEN)
        marks["balance/centre"] = Mark(position=centre)
        ends = []
        for foot in np.flatnonzero(foot_contact):
            middle, turn = self._sole(int(foot))
            ends += [middle - turn @ self._half_sole, middle + turn @ self._half_sole]
        if not ends:
            return marks
        points = np.array(ends)
        below = np.array([*centre[:2], points[:, 2].mean()])
        marks["balance/ground"], marks["balance/plumb"] = Mark(position=below), _bar(below, centre)
        for index, (start, end) in enumerate(hull_edges(points)):
            marks[f"balance/edge_{index}"] = _bar(points[start], points[end])
        return marks

    def _phases(self, snapshot: Snapshot) -> dict[str, Mark]:
        marks = {}
        stance = in_stance(snapshot.phase, snapshot.gait, snapshot.foot_contact)
        for foot, side in enumerate(SIDES):
            marks[f"phases/{side}"] = self.body(self._robot.foot_links[foot])
            marks[f"phases/{side}/stance"] = Mark(bool(stance[foot]))
            marks[f"phases/{side}/swing"] = Mark(not stance[foot])
        return marks


def _mark_of(data: mujoco.MjData, body: str) -> Mark:
    return Mark(position=data.body(body).xpos.copy(), quaternion=data.body(body).xquat.copy())


def in_stance(phase: np.ndarray | float, gait: np.ndarray | int, foot_contact: np.ndarray) -> np.ndarray:
    """Return whether each foot is in stance by the gait's clock, or in contact where there is no clock; shape (..., 2).

    Args:
        phase: the common phase in [0, 1), NaN where there is no clock, shape (...).
        gait: values of `Gait`, shape (...).
        foot_contact: whether the left and the right foot are on the ground, shape (..., 2), bool.
    """
    phase = np.asarray(phase, dtype=float)
    known = np.isfinite(phase)
    clock = foot_phases(np.where(known, phase, 0.0), np.asarray(gait)) < DEFAULT_DUTY
    return np.where(known[..., None], clock, foot_contact)


def _forces(snapshot: Snapshot) -> dict[str, Mark]:
    marks = {}
    for side, force, point in zip(SIDES, snapshot.foot_force, snapshot.pressure_centre, strict=True):
        shown = np.linalg.norm(force) > LEAST_FORCE and bool(np.all(np.isfinite(point)))
        marks[f"forces/{side}"] = _bar(point, point + FORCE_SCALE * force) if shown else HIDDEN
    return marks


def hull_edges(points: np.ndarray) -> list[tuple[int, int]]:
    """Return the edges of the convex hull of at least two points seen from above.

    The edges are pairs of indices, anticlockwise; a single pair if all points lie on a line.
    """
    try:
        corners = ConvexHull(points[:, :2]).vertices.tolist()
    except QhullError:
        order = np.lexsort((points[:, 1], points[:, 0]))
        return [(int(order[0]), int(order[-1]))]
    return list(zip(corners, corners[1:] + corners[:1], strict=True))


def _bar(start: np.ndarray, end: np.ndarray) -> Mark:
    """Return a mark that lays a part of unit length along z from one point to another."""
    length, turn = max(float(np.linalg.norm(end - start)), 1e-6), np.zeros(4)
    mujoco.mju_quatZ2Vec(turn, end - start)
    return Mark(True, start, turn, np.array([1.0, 1.0, length]))


def mark_shapes(shapes: Sequence[Shape], label: str, robot: Robot) -> dict[str, list[Shape]]:
    """Return the shapes of every mark, by the mark's path below the robot.

    The shapes are the robot's, for the ghosts of its hands; the label is its colour as "#rrggbb".
    """
    parts: dict[str, list[Shape]] = {}
    for side, hand in zip(SIDES, robot.hand_links, strict=True):
        parts[f"hands/target_{side}"] = [Shape(geometry.Sphere(TARGET_RADIUS), label, opacity=0.75)]
        forearm = [shape for shape in shapes if shape.body == hand]
        parts[f"hands/ghost_{side}"] = [Shape(shape.primitive, label, shape.placement, 0.3) for shape in forearm]
        parts[f"steps/planned_{side}"] = [footprint(robot, label, 0.35)]
        parts[f"forces/{side}"] = _arrow()
        parts[f"forces/{side}_hand"] = _arrow()
        for name, colour in (("stance", STANCE), ("swing", SWING)):
            parts[f"phases/{side}/{name}"] = [_slab(robot, colour)]
    parts["balance/centre"] = [Shape(geometry.Sphere(CENTRE_RADIUS), BALANCE)]
    parts["balance/plumb"] = [Shape(geometry.Cylinder(1.0, 0.5 * LINE_RADIUS), BALANCE, along_z(0.5) @ CYLINDER_TO_Z)]
    parts["balance/ground"] = [Shape(geometry.Cylinder(0.004, GROUND_RADIUS), BALANCE, along_z(0.004) @ CYLINDER_TO_Z)]
    for index in range(EDGES):
        edge = Shape(geometry.Cylinder(1.0, LINE_RADIUS), BALANCE, along_z(0.5) @ CYLINDER_TO_Z, on_top=True)
        parts[f"balance/edge_{index}"] = [edge]
    return parts


def footprint(robot: Robot, colour: str, opacity: float) -> Shape:
    """Return a sole's print on the ground, in a frame at the sole's centre."""
    return Shape(_sole_box(robot, STEP_THICKNESS), colour, along_z(0.5 * STEP_THICKNESS), opacity)


def _slab(robot: Robot, colour: str) -> Shape:
    low, high = SLAB_HEIGHT
    placement = along_z(0.5 * (low + high))
    placement[:3, 3] += (robot.sole_middle, 0.0, robot.sole_z)
    return Shape(_sole_box(robot, high - low), colour, placement)


def _sole_box(robot: Robot, height: float) -> geometry.Box:
    length, width = float(np.diff(robot.sole_x)[0]), float(np.diff(robot.sole_y)[0])
    return geometry.Box([length + 2 * SOLE_EDGE, width + 2 * SOLE_EDGE, height])


def _arrow() -> list[Shape]:
    """Return an arrow of unit length along z."""
    shaft, head = 1.0 - HEAD, geometry.Cylinder(HEAD, radiusTop=0.0, radiusBottom=2.2 * FORCE_RADIUS)
    return [
        Shape(geometry.Cylinder(shaft, FORCE_RADIUS), FORCE, along_z(0.5 * shaft) @ CYLINDER_TO_Z, 0.9, on_top=True),
        Shape(head, FORCE, along_z(1.0 - 0.5 * HEAD) @ CYLINDER_TO_Z, 0.9, on_top=True),
    ]

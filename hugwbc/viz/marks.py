"""Where the marks around a robot are: commanded hands, footsteps, contact forces, balance, gait phases.

What they look like is in `hugwbc.viz.overlays`.
"""

import dataclasses

import mujoco
import numpy as np

from hugwbc import rotations
from hugwbc.gait import DEFAULT_DUTY, foot_phases
from hugwbc.robot import SIDES, load_robot
from hugwbc.runtime.moment import Moment

FORCE_SCALE = 1e-3  # [m/N], length of a force's arrow
LEAST_FORCE = 1.0  # [N] that is drawn
EDGES = 4  # of the support area of two heels and two toes
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


@dataclasses.dataclass(frozen=True, eq=False)
class Mark:
    """One mark at one time; a mark that is not visible keeps its last place.

    Attributes:
        visible: whether it is shown.
        position: in the world [m], shape (3,).
        quaternion: (w, x, y, z), shape (4,).
        scale: along its own axes, shape (3,).
    """

    visible: bool = True
    position: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(3))
    quaternion: np.ndarray = dataclasses.field(default_factory=lambda: UPRIGHT)
    scale: np.ndarray = dataclasses.field(default_factory=lambda: np.ones(3))


HIDDEN = Mark(visible=False)


class Marks:
    """Finds the marks of a moment on one robot model."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._data, self._ghost = mujoco.MjData(model), mujoco.MjData(model)
        self._robot = load_robot()
        self._pelvis = model.body("pelvis").id
        length, middle = np.diff(self._robot.sole_x)[0], np.mean(self._robot.sole_x)
        self._half_sole = np.array([0.5 * length, 0.0, 0.0])
        self.sole = np.array([middle, 0.0, float(model.site("left_sole").pos[2])])

    def at(self, moment: Moment) -> dict[str, Mark]:
        """All marks by their path below the robot; the first part of a path is the layer, one of `overlays.LAYERS`."""
        self._data.qpos[:] = moment.qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        return {
            **self._hands(moment),
            **self._planned_steps(moment),
            **_forces(moment),
            **self._balance(moment.foot_contact),
            **self._phases(moment),
        }

    def footprint(self, qpos: np.ndarray, foot: int) -> Mark:
        """The sole of a foot (0 left, 1 right) on level ground, at `qpos` (26,)."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        centre, turn = self._sole(foot)
        return Mark(position=centre, quaternion=_about_z(float(np.arctan2(turn[1, 0], turn[0, 0]))))

    def _sole(self, foot: int) -> tuple[np.ndarray, np.ndarray]:
        site = self._data.site(f"{SIDES[foot]}_sole")
        return site.xpos.copy(), site.xmat.reshape(3, 3)

    def _hands(self, moment: Moment) -> dict[str, Mark]:
        marks = {}
        for side, target in zip(SIDES, moment.hand_target_world, strict=True):
            known = bool(np.all(np.isfinite(target)))
            marks[f"hands/target_{side}"] = Mark(position=target) if known else HIDDEN
        wanted = bool(np.all(np.isfinite(moment.arm_target)))
        if wanted:
            self._ghost.qpos[:] = moment.qpos
            self._ghost.qpos[7 + self._robot.arms] = moment.arm_target
            mujoco.mj_kinematics(self._model, self._ghost)
        for side in SIDES:
            body = self._ghost.body(f"{side}_elbow_link")
            mark = Mark(position=body.xpos.copy(), quaternion=body.xquat.copy()) if wanted else HIDDEN
            marks[f"hands/ghost_{side}"] = mark
        return marks

    def _planned_steps(self, moment: Moment) -> dict[str, Mark]:
        """On the ground that the lower sole is on, heading as the pelvis does."""
        height = min(self._sole(foot)[0][2] for foot in range(2))
        heading = _about_z(float(rotations.yaw_of(moment.qpos[3:7])))
        marks = {}
        for side, foothold in zip(SIDES, moment.foothold, strict=True):
            known = bool(np.all(np.isfinite(foothold)))
            marks[f"steps/planned_{side}"] = Mark(True, np.array([*foothold, height]), heading) if known else HIDDEN
        return marks

    def _balance(self, foot_contact: np.ndarray) -> dict[str, Mark]:
        """The centre of mass; its plumb line to the ground and the edges of the support area, while a foot is there."""
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

    def _phases(self, moment: Moment) -> dict[str, Mark]:
        marks = {}
        stance = in_stance(moment.phase, moment.gait, moment.foot_contact)
        for foot, side in enumerate(SIDES):
            body = self._data.body(f"{side}_ankle_link")
            marks[f"phases/{side}"] = Mark(position=body.xpos.copy(), quaternion=body.xquat.copy())
            marks[f"phases/{side}/stance"] = Mark(bool(stance[foot]))
            marks[f"phases/{side}/swing"] = Mark(not stance[foot])
        return marks


def in_stance(phase: np.ndarray | float, gait: np.ndarray | int, foot_contact: np.ndarray) -> np.ndarray:
    """Whether the gait's clock has each foot on the ground; where there is no clock, whether it is there.

    Args:
        phase: the common phase in [0, 1), NaN where there is none, shape (...).
        gait: values of `Gait`, shape (...).
        foot_contact: of the left and the right foot, bool, shape (..., 2).
    """
    phase = np.asarray(phase, dtype=float)
    known = np.isfinite(phase)
    clock = foot_phases(np.where(known, phase, 0.0), np.asarray(gait)) < DEFAULT_DUTY
    return np.where(known[..., None], clock, foot_contact)


def _forces(moment: Moment) -> dict[str, Mark]:
    marks = {}
    for side, force, point in zip(SIDES, moment.foot_force, moment.pressure_centre, strict=True):
        shown = np.linalg.norm(force) > LEAST_FORCE and bool(np.all(np.isfinite(point)))
        marks[f"forces/{side}"] = _bar(point, point + FORCE_SCALE * force) if shown else HIDDEN
    return marks


def hull_edges(points: np.ndarray) -> list[tuple[int, int]]:
    """Edges of the convex hull of points seen from above, as pairs of indices, anticlockwise; one for a straight line.

    Args:
        points: at least 2, shape (n, 2 or more).
    """
    order = [int(index) for index in np.lexsort((points[:, 1], points[:, 0]))]
    halves = []
    for way in (order, order[::-1]):
        half: list[int] = []
        for index in way:
            while len(half) > 1 and _turn(points[half[-2]], points[half[-1]], points[index]) <= 0.0:
                half.pop()
            half.append(index)
        halves.append(half)
    corners = halves[0][:-1] + halves[1][:-1]
    edges = list(zip(corners, corners[1:] + corners[:1], strict=True))
    return edges[:1] if len(edges) == 2 else edges


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    """Above 0 where the way from a to b to c turns left."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def _bar(start: np.ndarray, end: np.ndarray) -> Mark:
    """A thing of unit length along z, laid from one point to another."""
    length = max(float(np.linalg.norm(end - start)), 1e-6)
    return Mark(True, start, _from_z((end - start) / length), np.array([1.0, 1.0, length]))


def _from_z(direction: np.ndarray) -> np.ndarray:
    """The smallest turn of z into a unit vector, as a quaternion (w, x, y, z)."""
    x, y, z = direction
    if z < -1.0 + 1e-9:
        return np.array([0.0, 1.0, 0.0, 0.0])
    quaternion = np.array([1.0 + z, -y, x, 0.0])
    return quaternion / np.linalg.norm(quaternion)


def _about_z(yaw: float) -> np.ndarray:
    return rotations.from_yaw_pitch_roll(yaw, 0.0, 0.0)

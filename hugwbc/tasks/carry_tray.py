"""Carry a tray with a cup, which stands on it freely, 3 m and round a corner."""

import math

import numpy as np

from hugwbc import rotations
from hugwbc.behaviours import Course, Grip, View, doing, glide, grip, seen, step, walk_to
from hugwbc.behaviours.course import Seconds
from hugwbc.behaviours.hands import crouch, hands_in
from hugwbc.commands import Command
from hugwbc.tasks.judges import happened, lifted
from hugwbc.tasks.record import TaskRecord
from hugwbc.tasks.task import Shapes, Task, scene_of
from hugwbc.tasks.verdict import Milestone, at_end

WAY = 3.0  # [m]
TURN = math.radians(80.0)
STANDS = 0.3  # [rad], lean of a cup that still stands; it tips over at 0.45


def held(record: TaskRecord) -> np.ndarray:
    """Return whether both hands hold the tray, shape (T,), bool."""
    return (record.held == record.scene.body_names.index("tray")).all(axis=1)


def carried(record: TaskRecord) -> slice:
    """Return the samples from the first one in which the tray is held; the last one if it never is."""
    return slice(next(iter(np.flatnonzero(held(record))), -1), None)


def way(record: TaskRecord) -> float:
    """Return the length of the tray's path from when it is held, in straight pieces of a second [m]."""
    path = record.poses["tray"][carried(record)][::50, :2]
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def turn(record: TaskRecord) -> float:
    """Return the largest change of the robot's heading from when the tray is held [rad]."""
    yaw = np.unwrap(np.asarray(rotations.yaw_of(record.pelvis[carried(record), 3:])))
    return float(np.abs(yaw - yaw[0]).max())


def cup_stands(record: TaskRecord) -> bool:
    """Return whether the cup never leaned far, nothing held it, and it is on the tray at the end."""
    above = record.poses["tray/cup"][:, :3] - record.poses["tray"][:, :3]
    on_tray = np.linalg.norm(above[-1, :2]) < 0.25 and 0.0 < above[-1, 2] < 0.15
    return bool(record.tilt("tray/cup").max() < STANDS and on_tray and "tray/cup" not in record.gripped)


MILESTONES = (
    happened(lambda record: bool(held(record).any()), "the hands did not get hold of the tray"),
    lifted("tray", "the tray was not lifted", 0.03),
    happened(cup_stands, "the cup fell over"),
    Milestone("the tray was not carried 3 m", lambda record: way(record) / WAY),
    Milestone("the robot did not turn the corner", lambda record: turn(record) / TURN),
    happened(lambda record: at_end(record.poses["tray"][:, 2]) > 0.6, "the tray was dropped"),
)


_DISTANCE = 0.40  # [m], from the pelvis to the middle of the tray
_BESIDE = 0.045  # [m], of a hand from the edge of the tray
_ABOVE = 0.05  # [m], of a hand above the plate
_LIFT = 0.08  # [m], by which the robot crouches deeper than its arms need when it grips the tray
_BACK, _AHEAD = 0.45, 2.5  # [m], before and after the corner


@step
def carry_tray(view: View, shapes: Shapes, *, timeout: Seconds = 80.0) -> Course:
    """Take the tray at its sides, step back from the table, turn left, and walk on."""
    half = shapes["tray"]["size"][1] / 2
    view = yield from doing("walk to the tray", _come(view, half))
    view = yield from doing("reach for the tray", _reach(view, half))
    view = yield from doing("grip the tray", grip(view, Grip("left", "tray"), Grip("right", "tray", hook=True)))
    ahead, points = np.array([1.0, 0.0, 0.0]), hands_in(view, "heading")
    lift = glide(view, points, together=True, directions=(ahead, ahead), posture=Command(), settle=1.5)
    view = yield from doing("lift the tray", lift)
    return (yield from doing("carry the tray", _carry(view)))


def _come(view: View, half: float) -> Course:
    y = half + _BESIDE + 0.08
    view = yield from glide(view, np.array([[0.22, y, 0.1], [0.22, -y, 0.1]]))
    return (yield from walk_to(view, before="tray", distance=_DISTANCE))


def _reach(view: View, half: float) -> Course:
    tray = seen(view, "tray")
    axes = rotations.rotation_z(tray.yaw)
    way = (axes[:, 0], axes[:, 0])
    # The legs lift the tray: an arm that rises turns its forearm, and the tray with it.
    posture = Command(h=crouch(float(tray.position[2]) + _ABOVE).h - _LIFT)
    for gap in (0.06, 0.0):
        y = half + _BESIDE + gap
        points = tray.position + np.array([[-0.02, y, _ABOVE], [-0.02, -y, _ABOVE]]) @ axes.T
        view = yield from glide(view, points, frame="world", speed=0.12, directions=way, posture=posture, settle=0.6)
    return view


def _carry(view: View) -> Course:
    yaw = view.state.yaw
    back = view.position - _BACK * rotations.rotation_z(yaw)[:, 0]
    view = yield from walk_to(view, (float(back[0]), float(back[1])), yaw, speed=0.25, tolerance=0.1)
    goal = view.position + _AHEAD * rotations.rotation_z(yaw)[:, 1]
    walk = walk_to(view, (float(goal[0]), float(goal[1])), yaw + math.pi / 2, speed=0.3, tolerance=0.1)
    return (yield from walk)


TASK = Task(
    name="carry_tray",
    about="Carry a tray with a cup that stands on it freely over 3 m and round a corner; the cup stays upright.",
    scene=scene_of("carry_tray"),
    behaviour=carry_tray,
    limit=90.0,
    milestones=MILESTONES,
    idealised=("attach",),
)

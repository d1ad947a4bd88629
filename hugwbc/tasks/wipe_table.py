"""Wipe a table with a hand along a path of 1 m, with a force of 15 N."""

import numpy as np

from hugwbc import rotations
from hugwbc.behaviours import Course, View, doing, glide, seen, step, walk_to, wipe
from hugwbc.behaviours.boxes import up
from hugwbc.behaviours.course import Seconds
from hugwbc.behaviours.hands import crouch, one_hand
from hugwbc.behaviours.hold import TOUCH
from hugwbc.commands import Command
from hugwbc.sim.scenes.varied import settled
from hugwbc.tasks.judges import touched
from hugwbc.tasks.record import TaskRecord
from hugwbc.tasks.task import Shapes, Task, scene_of
from hugwbc.tasks.verdict import Milestone

# Corners of the path on the table, in its axes from the middle of its edge on the robot's side [m]: 1 m in all.
CORNERS = np.array([[0.10, -0.05], [0.10, -0.35], [0.15, -0.35], [0.15, -0.05], [0.20, -0.05], [0.20, -0.35]])
FORCE = (5.0, 25.0)  # [N]
WIDTH = 0.04  # [m], half of what a hand wipes at once
COVERED = 0.9
_STEP = 0.01  # [m]


def path_points() -> np.ndarray:
    """Return points of the path at equal distances [m], shape (n, 2)."""
    legs = np.linalg.norm(np.diff(CORNERS, axis=0), axis=1)
    at = np.concatenate(([0.0], np.cumsum(legs)))
    along = np.arange(0.0, at[-1] + _STEP / 2, _STEP)
    return np.stack([np.interp(along, at, CORNERS[:, axis]) for axis in (0, 1)], axis=1)


def covered(record: TaskRecord) -> float:
    """Return the share of the path over which a hand pressed on the table with a mean force within `FORCE`.

    The mean at a point of the path is over the samples in which the hand touches the table within `WIDTH` of it.
    """
    table = record.thing("table")
    pose, turn = record.poses["table"][0], rotations.rotation_z(record.yaw("table")[0])[:2, :2]
    edge = np.array([settled(table.size[0]) / 2, 0.0])  # type: ignore[attr-defined]
    points = path_points()
    done = np.zeros(len(points), dtype=bool)
    for hand in range(2):
        force = record.hand_force[:, hand, 2]
        touching = (force > TOUCH) & record.hand_touches[:, hand]  # not on the robot's own arms, above the table
        at = (record.hands[touching, hand, :2] - pose[:2]) @ turn + edge
        near = np.linalg.norm(at[:, None] - points, axis=2) <= WIDTH
        mean = force[touching] @ near / np.maximum(near.sum(axis=0), 1)
        done |= (mean >= FORCE[0]) & (mean <= FORCE[1])
    return float(done.mean())


MILESTONES = (
    touched("table", "no hand touched the table"),
    Milestone("less than 90 % of the path was wiped with 5 to 25 N", lambda record: covered(record) / COVERED),
)


WIPING = 15.0  # [N]
_EDGE = 0.23  # [m], from the pelvis to the edge of the table: near, since some robots lean back while they press
_ON_TOP = 0.035  # [m], of the hand frame above the table when the hand lies on it
_SPEED = 0.08  # [m/s]
# Place of the left hand, in the axes of `CORNERS` and above the table [m]: at rest it would lie on the table and carry
# the trunk.
_ASIDE = np.array([-0.05, 0.35, 0.2])


@step
def wipe_table(view: View, shapes: Shapes, *, timeout: Seconds = 60.0) -> Course:
    """Lean over the table, press the right hand on it, and follow the path."""
    half = shapes["table"]["size"][0] / 2
    top = shapes["table"]["height"]
    walk = walk_to(view, before="table", distance=half + _EDGE)
    view = yield from doing("walk to the table", walk)
    table = seen(view, "table")
    axes = rotations.rotation_z(table.yaw)
    points = np.column_stack([path_points() - [half, 0.0], np.full(len(path_points()), 0.0)])
    path = table.position * [1.0, 1.0, 0.0] + up(top + _ON_TOP) + points @ axes.T
    aside = table.position * [1.0, 1.0, 0.0] + up(top) + axes @ (_ASIDE - [half, 0.0, 0.0])
    posture = crouch(top + 0.05)
    for height in (0.12, 0.03):
        at = np.stack([aside, path[0] + up(height)])
        lean = glide(view, at, frame="world", posture=posture, speed=0.2, settle=0.5)
        view = yield from doing("lean over the table", lean)
    at, force = np.stack([aside, path[0]]), one_hand(1, up(WIPING), np.zeros((2, 3)))
    press = glide(view, at, frame="world", speed=0.04, forces=force, posture=posture, settle=1.0)
    view = yield from doing("press on the table", press)
    view = yield from doing("wipe the table", wipe(view, path, force=WIPING, speed=_SPEED))
    at = np.stack([aside, path[-1] + up(0.12)])
    view = yield from doing("raise the hand", glide(view, at, frame="world", speed=0.15))
    return (yield from doing("raise the hand", glide(view, at, frame="world", posture=Command())))


TASK = Task(
    name="wipe_table",
    about="Wipe a table along a path of 1 m with 15 N (on average 5 to 25 N everywhere), and cover 90 % of it.",
    scene=scene_of("wipe_table"),
    behaviour=wipe_table,
    limit=70.0,
    milestones=MILESTONES,
)

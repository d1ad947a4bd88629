"""Milestones that several tasks share: arrivals, lifts, rests and grips."""

from collections.abc import Callable

import numpy as np

from hugwbc import rotations
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.numeric import number
from hugwbc.sim.scenes import Box, Cylinder, Step, Table, Thing, Tray
from hugwbc.sim.scenes.varied import settled
from hugwbc.tasks.record import HANDS, TRUNK, TaskRecord
from hugwbc.tasks.verdict import Milestone, at_end

UPRIGHT = 0.175  # [rad], 10 degrees
AT_REST = 0.03  # [m/s]
LIFTED = 0.05  # [m]
TIPPED = 0.4  # [rad], lean of what is tipped over, not lifted


def about(body: str, missed: str, progress: Callable[[TaskRecord], float]) -> Milestone:
    """Return a milestone about a body, which the scene must have."""
    if not isinstance(body, str):
        raise ConfigError(f"body is {body!r}; give the name of one in the scene, such as 'box', and what is missed")

    def known(record: TaskRecord) -> float:
        if body not in record.poses:
            raise UnknownNameError("body of the scene", body, record.poses)
        return progress(record)

    return Milestone(missed, known)


def touched(body: str, missed: str) -> Milestone:
    """Return the milestone that a hand touches or grips a body; its progress is the hand's approach."""

    def progress(record: TaskRecord) -> float:
        if record.touches(HANDS, body) or body in record.gripped:
            return 1.0
        away = np.linalg.norm(record.hands - record.poses[body][:, None, :3], axis=2)
        return 0.9 * float(np.clip(1.0 - away.min() / max(away[0].min(), 1e-6), 0.0, 1.0))

    return about(body, missed, progress)


def lifted(body: str, missed: str, height: float = LIFTED) -> Milestone:
    """Return the milestone that a body rises by a height [m] at some time, and not only as it is tipped over."""
    if not (number(height) or 0.0) > 0.0:
        raise ConfigError(f"height is {height!r}; give a number above 0 in metres, such as {LIFTED}")
    return about(body, missed, lambda record: rise(record, body)[~_tipped(record, body)].max() / height)


def _tipped(record: TaskRecord, body: str) -> np.ndarray:
    """Return whether a body leans so far that its middle rises over its edge, shape (T,), bool; not at the start."""
    tilt = record.tilt(body)
    return tilt > tilt[0] + TIPPED


def rise(record: TaskRecord, body: str) -> np.ndarray:
    """Return how far a body is above where it was at the start [m], shape (T,)."""
    return record.poses[body][:, 2] - record.poses[body][0, 2]


def at_rest(body: str, missed: str) -> Milestone:
    """Return the milestone that a body stands still at the end."""
    return about(body, missed, lambda record: 1.0 if at_end(record.speed(body)) <= AT_REST else 0.5)


def upright(body: str, missed: str) -> Milestone:
    """Return the milestone that a body is upright at the end."""
    return about(body, missed, lambda record: 1.0 if at_end(record.tilt(body)) <= UPRIGHT else 0.0)


def hands_off(missed: str) -> Milestone:
    """Return the milestone that no hand touches or holds anything at the end."""

    def progress(record: TaskRecord) -> float:
        force = np.linalg.norm(record.hand_force[-10:], axis=2)
        force = np.where(record.hand_touches[-10:], force, 0.0)  # not that of an arm on its own body
        return 1.0 if (record.held[-1] < 0).all() and force.max(initial=0.0) < 1.0 else 0.0

    return Milestone(missed, progress)


def trunk_clear(body: str, missed: str) -> Milestone:
    """Return the milestone that pelvis and torso never touch a body."""
    return about(body, missed, lambda record: 0.0 if record.touches(TRUNK, body) else 1.0)


def half_height(thing: Thing) -> float:
    """Return half the height of a box, a cylinder or a tray [m]."""
    if not isinstance(thing, Box | Cylinder | Tray):
        raise ConfigError(f"'{thing.name}' is a {thing.kind}; name a box, a cylinder or a tray")
    return settled(thing.height if isinstance(thing, Cylinder) else thing.size[2]) / 2  # type: ignore[attr-defined]


def stands_on(record: TaskRecord, body: str, support: str) -> bool:
    """Return whether a box, cylinder or tray stands at the end on the top of a table, step, box or tray, within 2 cm.

    Raises:
        ConfigError: if body or support is something else.
        UnknownNameError: if the scene has no such object.
    """
    below = record.thing(support)
    if not isinstance(below, Table | Step | Box | Tray):
        raise ConfigError(f"'{support}' is a {below.kind}; name a table, a step, a box or a tray")
    half = half_height(record.thing(body))  # asked even where it is elsewhere, so that a mistake shows at once
    ground, still = record.poses[support], isinstance(below, Table | Step)
    top = float(ground[0, 2]) + below.surface(None) if still else at_end(ground[:, 2]) + half_height(below)
    beside = (record.poses[body][-1] - ground[-1])[:2] @ rotations.rotation_z(record.yaw(support)[-1])[:2, :2]
    above = (np.abs(beside) <= [settled(side) / 2 for side in below.size[:2]]).all()
    return bool(above and abs(at_end(record.poses[body][:, 2]) - half - top) <= 0.02)


def apart(record: TaskRecord, body: str, goal: np.ndarray) -> float:
    """Return the horizontal distance of a body from a point at the end [m].

    Args:
        record: the episode.
        body: its name.
        goal: x and y in the world [m], shape (2,).
    """
    path = record.poses[body][:, :2]
    return float(np.hypot(at_end(path[:, 0]) - goal[0], at_end(path[:, 1]) - goal[1]))


def in_axes_of(record: TaskRecord, body: str, points: np.ndarray) -> np.ndarray:
    """Return points of the world in the axes that a body had at the start [m].

    Args:
        record: the episode.
        body: its name.
        points: shape (..., 3).
    """
    start = record.poses[body][0]
    return (points - start[:3]) @ rotations.to_matrix(start[3:])


def happened(check: Callable[[TaskRecord], bool], missed: str) -> Milestone:
    """Return the milestone that a check holds."""
    return Milestone(missed, lambda record: 1.0 if check(record) else 0.0)

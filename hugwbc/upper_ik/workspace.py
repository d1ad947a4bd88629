"""Share of the space around the robot within reach of its hands, with the arms alone and with the whole body."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from hugwbc.commands import command_ranges
from hugwbc.gait import Gait
from hugwbc.robot import Robot
from hugwbc.upper_ik.body_reach import BODY_NAMES, BodyReach
from hugwbc.upper_ik.detour import seeds

TOLERANCE = 0.03  # [m]
SIDE = 2.0  # [m], of a cube that stands on the ground with the robot in its middle
SHOULDER_SPREAD = 0.047  # [m], bound of the distance between the shoulder's axes, which do not intersect
_STEPS = 60  # steps of 20 ms from one start; a hand that is off its target by then stays off
_DT = 0.02


@dataclasses.dataclass(frozen=True)
class Workspace:
    """The share of a cube's grid points that at least one hand reaches within `TOLERANCE`.

    Attributes:
        arms: share with the arms alone, standing upright.
        whole_body: share with h, p and w in their ranges as well.
        points: number of grid points.
        spacing: distance between grid points [m].
        tolerance: distance within which a point counts as reached [m].
    """

    arms: float
    whole_body: float
    points: int
    spacing: float
    tolerance: float = TOLERANCE


def arm_length(robot: Robot) -> float:
    """Return the distance from the centre of the shoulder to the hand of a stretched arm [m]."""
    return robot.upper_arm + robot.forearm


def arm_reach(robot: Robot) -> float:
    """Return a bound of the distance from the centre of the shoulder to the hand [m]."""
    return arm_length(robot) + SHOULDER_SPREAD


def shoulder_shift(robot: Robot) -> float:
    """Return a bound of a shoulder's shift by the commanded pitch and waist angle [m]: the sum of both chords."""
    ranges = command_ranges(Gait.STANDING, robot)
    pitch, waist = (max(map(abs, ranges[name].finishing)) for name in ("p", "w"))
    radius = float(np.linalg.norm(robot.shoulder))
    across = float(np.linalg.norm(robot.shoulder[:2]))
    return 2.0 * (radius * math.sin(pitch / 2.0) + across * math.sin(waist / 2.0))


def measure_workspace(robot: Robot, spacing: float, on_progress: Callable[[float], None] | None = None) -> Workspace:
    """Try every grid point of a 2 m cube on the ground with the left hand; the right hand reaches the mirror image.

    Args:
        robot: robot with the hands.
        spacing: distance between grid points [m], at most `SIDE`.
        on_progress: called with the fraction done.
    """
    half = int(SIDE / 2.0 / spacing + 1e-9)
    ticks = spacing * np.arange(-half, half + 1)
    grid = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1)
    points = (grid + np.array([0.0, 0.0, SIDE / 2.0 - robot.nominal_height])).reshape(-1, 3)
    # Nothing moves that could lose its balance, so steps may be large.
    reach = BodyReach(robot, speed=(2.0, 3.0, 6.0))
    reached = {}
    for index, body in enumerate((False, True)):
        found = np.zeros(len(points), dtype=bool)
        for number, point in enumerate(points):
            found[number] = _reaches(reach, robot, point, body)
            if on_progress is not None:
                on_progress((index + number / len(points)) / 2.0)
        left = found.reshape(grid.shape[:3])
        reached[body] = float(np.mean(left | left[:, ::-1]))
    return Workspace(reached[False], reached[True], len(points), spacing)


def _reaches(reach: BodyReach, robot: Robot, point: np.ndarray, body: bool) -> bool:
    ranges = np.array([command_ranges(Gait.STANDING, robot)[name].finishing for name in BODY_NAMES])
    room = arm_reach(robot) + TOLERANCE + (np.abs(ranges[0]).max() + shoulder_shift(robot) if body else 0.0)
    if np.linalg.norm(point - robot.shoulder) > room:
        return False
    reach.allow(ranges if body else np.zeros((3, 2)))
    points, given = np.stack((point, point)), np.array([True, False])
    for postures in zip(*seeds(robot), strict=True):
        reach.start(np.concatenate(postures), np.zeros(3))
        last = np.inf
        for _ in range(_STEPS):
            residual = float(reach.solve(points, given, np.zeros(3), reach.values, _DT)[0])
            if residual <= TOLERANCE:
                return True
            if last - residual < 1e-4:
                break
            last = residual
    return False

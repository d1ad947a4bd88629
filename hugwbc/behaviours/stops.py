"""How stops move a robot."""

import math

import numpy as np

from hugwbc import rotations
from hugwbc.commands import default_command
from hugwbc.gait import Gait
from hugwbc.scripts.view import View
from hugwbc.stride import OverStride

SETTLED = 1.0  # [s] of standing after which a robot has come to rest
_NEWEST = 0.5  # share of the last stop in the mean of all


class Stops:
    """Watches by how much stops move the robot: from the mean of the last stride before a stop to where it rests.

    Attributes:
        moved: mean of the stops, of which the last counts half, heading frame [m, m, rad], shape (3,); the stop that
            the controller knows (`View.stop`) counts as one. None before the first.
    """

    def __init__(self) -> None:
        self.moved: np.ndarray | None = None
        self._mean = OverStride()
        self._before: np.ndarray | None = None  # mean x, y, and cosine and sine of the heading in the last stride
        self._walked = -math.inf  # [s] when it was told to walk last

    def note(self, view: View, told: Gait) -> None:
        """Take what is seen, and the gait that the robot is told."""
        stride, yaw = 1.0 / default_command(Gait.WALKING, view.robot).f, view.state.yaw
        mean = self._mean(view.time, np.array([*view.position[:2], math.cos(yaw), math.sin(yaw)]), stride)
        if told is not Gait.STANDING:
            self._walked, self._before = view.time, mean
        elif self._before is not None and view.time - self._walked >= SETTLED:
            before = math.atan2(self._before[3], self._before[2])
            way = rotations.rotation_z(-before)[:2, :2] @ (view.position[:2] - self._before[:2])
            moved = np.array([*way, rotations.wrap_angle(yaw - before)])
            known = view.stop if self.moved is None else self.moved
            self.moved = (1.0 - _NEWEST) * known + _NEWEST * moved if known.any() else moved
            self._before = None

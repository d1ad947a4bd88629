"""How stops move a robot."""

import math

import numpy as np

from hugwbc import rotations
from hugwbc.commands import default_command
from hugwbc.gait import Gait
from hugwbc.scripts.view import View
from hugwbc.stride import MidStance, OverStride

SETTLED = 1.0  # [s] of standing after which a robot has come to rest
_NEWEST = 0.5  # share of the last stop in the mean of all


class Stops:
    """Watches by how much a stop moves the robot: from the mean of the stride before it to where it comes to rest.

    Attributes:
        mid_stance: whether the robot is in the moment of its stride in which it should be told to stand.
        moved: mean of the stops, of which the last counts half, heading frame [m, m, rad], shape (3,); before the first
            one what the controller knows of them, zeros for nothing.
    """

    def __init__(self) -> None:
        self.mid_stance, self.moved = True, np.zeros(3)
        self._moment, self._first = MidStance(), True
        self._mean: OverStride | None = None
        self._before: np.ndarray | None = None  # mean x, y, and cosine and sine of the heading in the last stride
        self._walked = -math.inf  # [s] when it was told to walk last

    def note(self, view: View, told: Gait) -> None:
        """Take what is seen, and the gait that the robot is told."""
        stride, yaw = 1.0 / default_command(Gait.WALKING, view.robot).f, view.state.yaw
        self.mid_stance = self._moment(view.time, view.state.foot_force, stride)
        self.moved = view.stop if self._first else self.moved
        self._mean = OverStride(stride) if self._mean is None else self._mean
        mean = self._mean(view.time, np.array([*view.position[:2], math.cos(yaw), math.sin(yaw)]))
        if told is not Gait.STANDING:
            self._walked, self._before = view.time, mean
        elif self._before is not None and view.time - self._walked >= SETTLED:
            before = math.atan2(self._before[3], self._before[2])
            way = rotations.rotation_z(-before)[:2, :2] @ (view.position[:2] - self._before[:2])
            moved = np.array([*way, rotations.wrap_angle(yaw - before)])
            self.moved = (1.0 - _NEWEST) * self.moved + _NEWEST * moved if self.moved.any() else moved
            self._before, self._first = None, False

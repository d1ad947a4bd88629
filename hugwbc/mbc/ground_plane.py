"""The ground as the feet find it: who carries load, the slope under each sole, and a plane through the last stances."""

import collections
import math

import numpy as np

from hugwbc.mbc.dynamics import Dynamics
from hugwbc.robot import SIDES

_TOUCH_LOAD = 20.0  # [N], at which a foot has found the ground
_RESTING_LOAD, _RESTING_RATE = 100.0, 0.5  # [N], [rad/s], of a sole that lies on the ground with heel and toe
_SLOPE_TIME = 0.02  # [s], in which a resting sole's slope is taken for the ground's
_STANCES = 6  # through whose heels and toes the plane is laid
_STIFFNESS = 0.03  # [m^2], of the plane towards level: the variance of uneven ground over that of a gradient


class Ground:
    """What the feet tell of the ground; level where the state has no foot forces.

    Attributes:
        gradient: dz/dx and dz/dy of the plane, world axes, shape (2,).
        slopes: of the ground along the left and the right foot, toe down positive [rad], shape (2,).
        resting: whether the left and the right foot lie still under load: then heel and toe carry, whatever the slope.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Level ground."""
        self.gradient = np.zeros(2)
        self.slopes = np.zeros(2)
        self.resting = np.zeros(2, dtype=bool)
        self._stances: collections.deque[np.ndarray] = collections.deque(maxlen=_STANCES)

    def update(self, dynamics: Dynamics, contact: np.ndarray, yaw: float, dt: float) -> None:
        """Follow the soles for one tick.

        Args:
            dynamics: updated.
            contact: whether the left and the right foot are to stand, shape (2,), bool.
            yaw: heading of the robot [rad].
            dt: [s].
        """
        for foot, side in enumerate(SIDES):
            load = dynamics.load(foot)
            if load is None or not contact[foot]:
                self.resting[foot], self.slopes[foot] = False, self.slope_along(yaw)
                continue
            sole = dynamics.frame(f"{side}_sole")
            rate = float(sole.rotation[:, 1].dot(sole.velocity[3:]))
            rests = load > _RESTING_LOAD and abs(rate) < _RESTING_RATE
            self.resting[foot] = rests
            if rests:
                pitch = math.asin(min(max(-float(sole.rotation[2, 0]), -1.0), 1.0))
                self.slopes[foot] += (pitch - self.slopes[foot]) * min(dt / _SLOPE_TIME, 1.0)

    def touched(self, dynamics: Dynamics, foot: int) -> bool | None:
        """Whether a foot carries load; None where the state has no foot forces."""
        load = dynamics.load(foot)
        return None if load is None else load > _TOUCH_LOAD

    def note(self, dynamics: Dynamics, foot: int) -> None:
        """Enter a stance that is under way into the plane, if the foot rests.

        The gradient minimises the squared distances of all heels and toes from the plane through their centre, with a
        ridge towards level.
        """
        if not self.resting[foot]:
            return
        self._stances.append(np.array([dynamics.point(f"{SIDES[foot]}_{end}") for end in ("heel", "toe")]))
        points = np.concatenate(self._stances)
        points = points - points.mean(axis=0)
        across = points[:, :2]
        self.gradient = np.linalg.solve(across.T @ across + _STIFFNESS * np.eye(2), across.T @ points[:, 2])

    def shift(self, offset: np.ndarray) -> None:
        """Move the stances that the plane goes through, as the world's origin has moved [m], shape (3,)."""
        for points in self._stances:
            points += offset

    def rise(self, start: np.ndarray, end: np.ndarray) -> float:
        """By how much the plane rises from one point to another, world x and y first [m]."""
        return float(self.gradient.dot(end[:2] - start[:2]))

    def slope_along(self, yaw: float) -> float:
        """Slope of the plane along a heading, downhill positive [rad]."""
        x, y = self.gradient.tolist()
        return -math.atan(x * math.cos(yaw) + y * math.sin(yaw))

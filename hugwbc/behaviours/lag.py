"""How far a robot that walks stays behind what it is told, and whether something holds it."""

import math

import numpy as np

from hugwbc import rotations
from hugwbc.commands import Command, default_command
from hugwbc.gait import Gait
from hugwbc.scripts.view import View
from hugwbc.stride import OverStride

STUCK = 3.0  # [s], after which a robot that is held is stuck
START = 2.0  # [s], how much longer at the start of a walk or a push
_TIME = 3.5  # [s], over which the lag is learnt
_MOST = 0.2  # [m/s], [rad/s], largest lag that is learnt
_SLOWEST_HELD = 0.08, 0.15  # [m/s], [rad/s]; a robot that is told to walk slower may stay behind without being held
_PUSHES = 5.0  # [N] on both hands together against the way, from which on they push something
_HELD = 0.2  # share of the wanted velocity below which the mean of a stride is that of a robot which is held


class Lag:
    """Learns the difference of commanded and walked velocity over the walks of a run, as the estimate knows it.

    Controllers do not walk exactly as fast as they are told, with a load less than without. What is learnt does not
    grow while something holds the robot.

    Attributes:
        velocity: commanded minus walked velocity, heading frame [m/s, m/s, rad/s], shape (3,).
        stuck: whether the robot has not moved for `STUCK` although it is told to.
    """

    def __init__(self) -> None:
        self.velocity, self.stuck = np.zeros(3), False
        self._walks = False

    def note(self, view: View, told: Command) -> None:
        """Take what is seen, and what the robot was told in the last tick."""
        begins, self._walks = not self._walks, told.gait is Gait.WALKING and view.state.velocity is not None
        self.stuck = False
        if not self._walks:
            return
        if begins:
            self._pace, self._time = OverStride(), view.time
            self._free = np.full(2, view.time + START)  # when it last walked, and turned, as it was told
        share, self._time = min((view.time - self._time) / _TIME, 1.0), view.time
        asked, walked = told.array()[:3], view.state.heading_velocity
        felt = np.zeros(3) if view.hand_force is None else view.hand_force.sum(axis=0)
        felt = felt @ rotations.rotation_z(view.state.yaw)
        seen = np.array([asked - self.velocity, walked, felt])
        moves, held = _held(*self._pace(view.time, seen, 1.0 / default_command(Gait.WALKING, view.robot).f))
        self._free = np.where(held, self._free, np.maximum(self._free, view.time))
        most = np.where((view.time > self._free)[[0, 0, 1]], np.abs(self.velocity), _MOST)
        self.velocity = np.clip(self.velocity + share * (asked - walked - self.velocity), -most, most)
        self.stuck = bool(moves.any() and (view.time - self._free[moves] > STUCK).all())


def _held(wanted: np.ndarray, walked: np.ndarray, felt: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return whether the robot is told to walk and to turn, and whether it is held in either, shape (2,) each.

    A robot whose hands push something, such as a door, is not held: that gives way as the robot is told to walk faster.

    Args:
        wanted: velocity in the heading frame and yaw rate, mean of a stride, shape (3,).
        walked: the same of the motion, shape (3,).
        felt: sum of the forces on both hands in the heading frame, mean of a stride [N], shape (3,).
    """
    asked = np.array([math.hypot(wanted[0], wanted[1]), abs(wanted[2])])
    along = np.array([walked[:2] @ wanted[:2], walked[2] * wanted[2]])
    told = asked > _SLOWEST_HELD
    pushes = felt[:2] @ wanted[:2] < -_PUSHES * asked[0]
    return told, told & (along < _HELD * asked**2) & (not pushes)

"""Where the feet are: soles and their ends, and the point of a sole that the plan lets push."""

import math

import numpy as np

from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.qp import CONTACT_POINTS
from hugwbc.mbc.reach import toe_down
from hugwbc.robot import SIDES, load_robot

SOLES = tuple(f"{side}_sole" for side in SIDES)
"""Frames at the centres of the soles."""
_SHANKS = tuple(f"{side}_knee_link" for side in SIDES)
_ENDS = tuple(tuple(CONTACT_POINTS[2 * foot : 2 * foot + 2]) for foot in range(len(SIDES)))  # heel and toe of each foot
_SOLE_MIDDLE = sum(load_robot().sole_x) / 2.0  # [m], ahead of the ankle


def pivot(dynamics: Dynamics, foot: int, balance: float) -> np.ndarray:
    """Nominal centre of pressure of a foot that stands, in the world [m], shape (3,).

    Args:
        dynamics: updated.
        foot: 0 left or 1 right.
        balance: how far it is ahead of the ankle [m].
    """
    sole = dynamics.frame(SOLES[foot])
    x, y = sole.rotation[:2, 0].tolist()
    ahead = (balance - _SOLE_MIDDLE) / max(math.hypot(x, y), 1e-6)
    return sole.position + np.array([ahead * x, ahead * y, 0.0])


def sole_about(pivot: np.ndarray, yaw: float, balance: float) -> np.ndarray:
    """Centre of a sole that is to land with its nominal centre of pressure at a place, world x and y [m], shape (2,).

    Args:
        pivot: that place, world x and y [m], shape (2,).
        yaw: of the foot [rad].
        balance: how far the place is ahead of the ankle [m].
    """
    ahead = _SOLE_MIDDLE - balance
    return pivot + np.array([ahead * math.cos(yaw), ahead * math.sin(yaw)])


def end_heights(dynamics: Dynamics, foot: int) -> list[float]:
    """Heights of heel and toe, in the world [m]."""
    return [float(dynamics.point(end)[2]) for end in _ENDS[foot]]


def sole_height(dynamics: Dynamics, foot: int) -> float:
    """Height of the sole's centre, in the world [m]."""
    return float(dynamics.frame(SOLES[foot]).position[2])


def feet_yaw(dynamics: Dynamics) -> float:
    """Mean heading of the two feet [rad]."""
    left, right = (dynamics.frame(sole).rotation for sole in SOLES)
    return math.atan2(left[1, 0] + right[1, 0], left[0, 0] + right[0, 0])


def swing_pitch(dynamics: Dynamics, foot: int, to_heading: np.ndarray, slope: float = 0.0) -> float:
    """Pitch of a lifted sole [rad]: that of the ground, as far as the lean of the shank and the ankle allow it.

    Args:
        dynamics: updated.
        foot: 0 left or 1 right.
        to_heading: from world x and y into the heading frame, shape (2, 2).
        slope: of the ground along the foot, toe down positive [rad].
    """
    lean = math.asin(min(max(-float(dynamics.rotation(_SHANKS[foot])[2, 0]), -1.0), 1.0))
    return toe_down(lean, float(to_heading[1].dot(dynamics.velocity(_SHANKS[foot])[3:5])), slope)

"""Feed-forward of the legs: postures that lower and tilt the pelvis, and lift the feet, by commanded amounts.

Thigh and shank are equal links. A leg whose hip is above its ankle at a distance d has the knee at 2 acos(d / 2 L); hip
and ankle take half of it back, and the hip takes the pelvis's pitch, so that the sole stays level:

    d = d_0 + h - c,   knee = 2 acos(d / 2 L),   hip = -knee / 2 - p,   ankle = -knee / 2,

relative to the nominal posture, at h = p = 0, with c the clearance of the sole in its swing. It says nothing of
balance or of the length of a step, which are left to the policy.
"""

import numpy as np

from hugwbc import gait as gaits
from hugwbc.commands import COMMAND_NAMES
from hugwbc.robot import SIDES, Robot

HEIGHT_RATE, PITCH_RATE = 0.5, 1.0  # [m/s], [rad/s], at which the feed-forward follows the commands
_MARGIN = 0.98  # of a straight leg's length, and of the joints' ranges
_F, _L = COMMAND_NAMES.index("f"), COMMAND_NAMES.index("l")


class LegFeedForward:
    """Joint offsets of squats and swings."""

    def __init__(self, robot: Robot) -> None:
        """Take the lengths, the nominal posture and the ranges of a robot's legs."""
        parts = ("hip_pitch", "knee", "ankle")
        self._joints = np.array([robot.indices([f"{side}_{part}_joint" for side in SIDES]) for part in parts])
        knee = robot.nominal[self._joints[1, 0]]
        self._length, self._half = robot.leg_length, 0.5 * knee
        centre, half = 0.5 * (robot.upper + robot.lower), 0.5 * _MARGIN * (robot.upper - robot.lower)
        self._low, self._high = centre - half - robot.nominal, centre + half - robot.nominal

    def offsets(self, height: np.ndarray, pitch: np.ndarray, clearance: np.ndarray | float = 0.0) -> np.ndarray:
        """Return what to add to the nominal joint positions [rad], shape (n, 19).

        Args:
            height: of the pelvis minus the nominal one [m], shape (n,).
            pitch: of the pelvis [rad], shape (n,).
            clearance: of the left and the right sole [m], shape (n, 2), or one number for all.
        """
        share = np.clip(np.cos(self._half) + (height[:, None] - clearance) / self._length, 0.0, _MARGIN)
        bend = np.arccos(np.broadcast_to(share, (len(height), 2))) - self._half  # half of the knee's offset
        result = np.zeros((len(height), self._low.size))
        for joints, offset in zip(self._joints, (-bend - pitch[:, None], 2.0 * bend, -bend), strict=True):
            result[:, joints] = np.clip(offset, self._low[joints], self._high[joints])
        return result


def swing_clearance(phase: np.ndarray, gait: np.ndarray, command: np.ndarray, period: float) -> np.ndarray:
    """Return the clearance of both soles at the end of a control period [m], shape (n, 2).

    Args:
        phase: common phase at its begin, shape (n,).
        gait: values of `Gait`, shape (n,).
        command: commands, shape (n, 8).
        period: control period [s].
    """
    later = gaits.advance_phase(phase, command[:, _F], period)
    return gaits.swing_height(gaits.homogenised_phase(gaits.foot_phases(later, gait)), command[:, [_L]])


def follow(value: np.ndarray, target: np.ndarray, period: float) -> np.ndarray:
    """Return height [m] and pitch [rad] of the feed-forward after a control period, shape (n, 2).

    Args:
        value: before it, shape (n, 2).
        target: commanded height and pitch, shape (n, 2).
        period: control period [s].
    """
    reach = period * np.array([HEIGHT_RATE, PITCH_RATE])
    return value + np.clip(target - value, -reach, reach)

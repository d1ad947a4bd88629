"""Feed-forward of the legs: postures that lower and tilt the pelvis, and lift the feet, by commanded amounts.

Thigh and shank are equal links. A leg whose hip is above its ankle at a distance d leans each of them by acos(d / 2 L).
An ankle bends only so far. From there on the thigh alone leans, and the hip moves back:

    d = d_0 + h - c,   shank = min(acos(d / 2 L), ankle's limit),   thigh = acos(d / L - cos(shank)),
    knee = thigh + shank,   hip = -thigh - p,   ankle = -shank,

relative to the nominal posture, at h = p = 0, with c the clearance of the sole in its swing; the sole stays level. It
says nothing of balance or of the length of a step, which are left to the policy.
"""

import numpy as np

from hugwbc import gait as gaits
from hugwbc.commands import COMMAND_NAMES
from hugwbc.learned.policy.contract import Contract
from hugwbc.robot import SIDES, Robot, load_robot

HEIGHT_RATE, PITCH_RATE = 0.5, 1.0  # [m/s], [rad/s], at which the feed-forward follows the commands
_MARGIN = 0.98  # of a straight leg's length, and of the joints' ranges
_F, _L, _W = (COMMAND_NAMES.index(name) for name in ("f", "l", "w"))
_SQUAT = [COMMAND_NAMES.index("h"), COMMAND_NAMES.index("p")]


class LegFeedForward:
    """Joint offsets of squats and swings."""

    def __init__(self, robot: Robot) -> None:
        """Take the lengths, the nominal posture and the ranges of a robot's legs."""
        parts = ("hip_pitch", "knee", "ankle")
        self._joints = np.array([robot.indices([f"{side}_{part}_joint" for side in SIDES]) for part in parts])
        knee = robot.nominal[self._joints[1, 0]]
        self._length, self._half = robot.leg_length, 0.5 * knee
        centre, half = 0.5 * (robot.upper + robot.lower), 0.5 * _MARGIN * (robot.upper - robot.lower)
        self._count = centre.size
        self._low, self._high = (
            bound[self._joints] - robot.nominal[self._joints] for bound in (centre - half, centre + half)
        )
        self._shank = float(self._half - self._low[2].max())  # largest lean
        thigh = float(knee + self._high[1].min()) - self._shank
        self._lowest = 0.5 * (np.cos(self._shank) + np.cos(thigh))

    def offsets(self, height: np.ndarray, pitch: np.ndarray, clearance: np.ndarray | float = 0.0) -> np.ndarray:
        """Return what to add to the nominal joint positions [rad], shape (n, 19).

        Args:
            height: of the pelvis minus the nominal one [m], shape (n,).
            pitch: of the pelvis [rad], shape (n,).
            clearance: of the left and the right sole [m], shape (n, 2), or one number for all.
        """
        share = _clip(np.cos(self._half) + (height[:, None] - clearance) / self._length, self._lowest, _MARGIN)
        share = np.broadcast_to(share, (len(height), 2))
        shank = np.minimum(np.arccos(share), self._shank)
        thigh = np.arccos(2.0 * share - np.cos(shank))
        result = np.zeros((len(height), self._count))
        offsets = self._half - thigh - pitch[:, None], thigh + shank - 2.0 * self._half, self._half - shank
        for joints, offset, low, high in zip(self._joints, offsets, self._low, self._high, strict=True):
            result[:, joints] = _clip(offset, low, high)
        return result


def _clip(values: np.ndarray, low: np.ndarray | float, high: np.ndarray | float) -> np.ndarray:
    """Return the values within bounds; for one robot `np.clip` takes three times as long."""
    return np.minimum(np.maximum(values, low), high)


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


class CommandFeedForward:
    """What the joint targets take from the commands alone, besides the policy's actions: waist, squat and swing."""

    def __init__(self, contract: Contract) -> None:
        """Take robot, period, rate and gains of a contract."""
        robot, period = load_robot(contract.robot), contract.period
        self._legs, self._waist, self._period = LegFeedForward(robot), robot.waist, period
        self._joints, self._waist_reach = len(robot.joint_names), contract.waist_rate * period
        self._squat_reach = period * np.array([HEIGHT_RATE, PITCH_RATE])
        self._squat, self._swing = contract.squat_gain, contract.swing_gain

    def follow(self, waist: np.ndarray, posture: np.ndarray, command: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the angle of the waist [rad], height [m] and pitch [rad] after a control period.

        Args:
            waist: angle before it, shape (n,).
            posture: height and pitch before it, shape (n, 2).
            command: commands, shape (n, 8).
        """
        waist = waist + _clip(command[:, _W] - waist, -self._waist_reach, self._waist_reach)
        return waist, posture + _clip(command[:, _SQUAT] - posture, -self._squat_reach, self._squat_reach)

    def offsets(
        self, waist: np.ndarray, posture: np.ndarray, phase: np.ndarray, gait: np.ndarray, command: np.ndarray
    ) -> np.ndarray:
        """Return what to add to pose and action [rad], shape (n, 19).

        Args:
            waist: what `follow` returned.
            posture: likewise.
            phase: common phase, shape (n,).
            gait: values of `Gait`, shape (n,).
            command: commands, shape (n, 8).
        """
        if self._squat > 0.0 or self._swing > 0.0:
            height, pitch = self._squat * posture.T
            lifted = self._swing * swing_clearance(phase, gait, command, self._period)
            result = self._legs.offsets(height, pitch, lifted)
        else:
            result = np.zeros((len(waist), self._joints))
        result[:, self._waist] += waist
        return result

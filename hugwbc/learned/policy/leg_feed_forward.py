"""Feed-forward of the legs: postures that lower and tilt the pelvis, and lift the feet, by commanded amounts.

Hip, knee and ankle are the corners of a triangle with the lengths of thigh T and shank S. If the hip is at a distance d
straight above the ankle, the law of cosines gives the lean of the shank; for equal links it is acos(d / 2 S). At the
limit of the ankle the shank stops, the thigh alone leans further, and the hip moves back:

    d = d_0 + h - c,   shank = min(acos((d^2 + S^2 - T^2) / 2 d S), ankle's limit),
    thigh = acos((d - S cos(shank)) / T),   knee = thigh + shank,   hip = -thigh - p,   ankle = -shank,

relative to the nominal posture at h = p = 0, with d_0 the distance d there, h and p the height and the pitch of the
pelvis, and c the clearance of the sole in its swing; the sole stays level. Balance and the length of a step are left to
the policy.

The joint limits of an H1 end the lift of a level sole at 0.32 m, and drives follow late, so that a command of 0.35 m
lifts it by 0.23 m. A policy's curves (`Contract.feed_forward`) may ask for more than any command. Above the highest
command the limits of shank and knee widen: the toes sink, and the knee's target goes beyond the joint's range.
"""

import math

import numpy as np

from hugwbc import gait as gaits
from hugwbc.commands import COMMAND_NAMES, highest_swing
from hugwbc.learned.policy.contract import Contract
from hugwbc.numeric import Array, Place, double, namespace
from hugwbc.robot import Robot

HEIGHT_RATE, PITCH_RATE = 0.5, 1.0  # [m/s], [rad/s], at which the feed-forward follows the commands
_MARGIN = 0.98  # of a straight leg's length, and of the joints' ranges
# [rad], [rad]: how far the limits of shank and knee widen, in full from a swing that exceeds the highest command by the
# third number, a share of the leg's length.
_LEAN, _BEND, _HIGHER = 0.5, 0.75, 0.375
_F, _L, _W = (COMMAND_NAMES.index(name) for name in ("f", "l", "w"))
_SQUAT = slice(COMMAND_NAMES.index("h"), COMMAND_NAMES.index("p") + 1)


class LegFeedForward:
    """Joint offsets of squats and swings."""

    def __init__(self, robot: Robot, place: Place = np.asarray) -> None:
        """Take the lengths, the nominal posture and the ranges of a robot's legs."""
        joints = np.array([robot.pair(part) for part in ("hip_pitch", "knee", "ankle_pitch")])
        knee = robot.nominal[joints[1, 0]]
        thigh, shank, self._length = robot.thigh, robot.shank, robot.leg_length
        # By the law of tangents: half of the difference between the leans of the nominal posture.
        apart = math.atan((shank - thigh) / self._length * math.tan(0.5 * knee))
        self._nominal = float(0.5 * knee) + apart, float(0.5 * knee) - apart  # of thigh and shank
        # Factors of the law of cosines, for a distance as a share of the leg's length.
        self._by_shank = self._length / (2.0 * shank), (shank - thigh) / (2.0 * shank)
        self._by_thigh = self._length / thigh, shank / thigh
        self._upright = math.cos(self._nominal[1]) + thigh / self._length * (
            math.cos(self._nominal[0]) - math.cos(self._nominal[1])
        )
        centre, half = 0.5 * (robot.upper + robot.lower), 0.5 * _MARGIN * (robot.upper - robot.lower)
        low, high = ((bound - robot.nominal)[joints] for bound in (centre - half, centre + half))
        self._shank = float(self._nominal[1] - low[2].max())  # largest lean that the ankle allows
        self._lean = float(knee + high[1].min()) - self._shank  # of the thigh, at the limits of shank and knee
        self._links = shank / self._length, thigh / self._length
        self._highest = highest_swing(robot)
        self._low, self._high = place(low), place(high)
        # Place of each joint among the offsets of these joints; the others take the zero behind them.
        column = np.full(centre.size, joints.size)
        column[joints.ravel()] = np.arange(joints.size)
        self._column = place(column)

    def offsets(self, height: Array, pitch: Array, clearance: Array | float = 0.0) -> Array:
        """Return what to add to the nominal joint positions [rad], shape (n, joints), in double precision.

        Args:
            height: of the pelvis minus the nominal one [m], shape (n,).
            pitch: of the pelvis [rad], shape (n,).
            clearance: of the left and the right sole [m], shape (n, 2), or one number for all.
        """
        xp, height, pitch = namespace(height), double(height)[:, None], double(pitch)[:, None]
        share = self._upright + (height - clearance) / self._length
        # 0 up to the highest command, 1 for a swing that is higher by `_HIGHER` of the leg's length.
        wide = _clip((clearance - self._highest + xp.zeros_like(share)) / (_HIGHER * self._length), 0.0, 1.0)
        limit, lean = self._shank + _LEAN * wide, self._lean + (_BEND - _LEAN) * wide
        lowest = self._links[0] * xp.cos(limit) + self._links[1] * xp.cos(lean)
        share = xp.broadcast_to(_clip(xp.maximum(share, lowest), -math.inf, _MARGIN), (len(height), 2))
        shank = xp.minimum(_lean(self._by_shank[0] * share + self._by_shank[1] / share), limit)
        thigh = _lean(self._by_thigh[0] * share - self._by_thigh[1] * xp.cos(shank))
        nominal_thigh, nominal_shank = self._nominal
        bend = nominal_thigh + nominal_shank
        offsets = nominal_thigh - thigh - pitch, thigh + shank - bend, nominal_shank - shank
        more = 0.0, _BEND * wide, 0.0
        bounded = [
            xp.minimum(xp.maximum(one, low), high + above)
            for one, low, high, above in zip(offsets, self._low, self._high, more, strict=True)
        ]
        return xp.concatenate((*bounded, xp.zeros_like(pitch)), 1)[:, self._column]


def _clip(values: Array, low: Array | float, high: Array | float) -> Array:
    """Return the values within bounds; for one robot `np.clip` takes three times as long."""
    if namespace(values) is np:
        return np.minimum(np.maximum(values, low), high)
    return values.clip(low, high)


def _lean(cosines: Array) -> Array:
    """Return the angles of cosines [rad]; cosines beyond -1 or 1 count as -1 or 1."""
    return namespace(cosines).arccos(_clip(cosines, -1.0, 1.0))


def swing_clearance(phase: Array, gait: Array, command: Array, period: float) -> Array:
    """Return the clearance of both soles [m], shape (n, 2), at the end of a period [s] that begins at a phase."""
    later = gaits.advance_phase(phase, command[:, _F], period)
    return gaits.swing_height(gaits.foot_phases(double(later), gait), command[:, _L : _L + 1])


class CommandFeedForward:
    """What the joint targets take from the commands alone, besides the policy's actions: waist, squat and swing.

    Arguments are of n robots: angle of the waist, shape (n,), height and pitch of the posture, (n, 2), common phase and
    `Gait`, (n,), and commands, (n, 8).
    """

    def __init__(self, contract: Contract, place: Place = np.asarray) -> None:
        """Take robot, period, rate and gains of a contract."""
        robot, period = contract.described, contract.period
        self._legs, self._period = LegFeedForward(robot, place), period
        self._waist = place(np.eye(len(robot.joint_names))[robot.waist])
        self._waist_reach = contract.waist_rate * period
        self._squat_reach = place(period * np.array([HEIGHT_RATE, PITCH_RATE]))
        self._squat, self._swing = contract.squat_gain, contract.swing_gain

    def follow(self, waist: Array, posture: Array, command: Array) -> tuple[Array, Array]:
        """Return the angle of the waist [rad], height [m] and pitch [rad] after a control period."""
        waist = waist + _clip(command[:, _W] - waist, -self._waist_reach, self._waist_reach)
        return waist, posture + _clip(command[:, _SQUAT] - posture, -self._squat_reach, self._squat_reach)

    def offsets(self, waist: Array, posture: Array, phase: Array, gait: Array, command: Array) -> Array:
        """Return what to add to pose and action [rad], shape (n, joints)."""
        turn = double(waist)[:, None] * self._waist
        if self._squat == 0.0 and self._swing == 0.0:
            return turn
        height, pitch = self._squat * posture.T
        lifted = self._swing * swing_clearance(phase, gait, command, self._period)
        return self._legs.offsets(height, pitch, lifted) + turn

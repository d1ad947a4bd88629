"""Hand forces for the QP: those that the targets give, and estimated pulls that made the robot step."""

import math

import numpy as np

from hugwbc.controller import UpperBody
from hugwbc.state import RobotState

_STRONGEST = 250.0  # [N] along each axis, bound on what is felt besides what is told: more is a fault of the sensors
# What moves the robot is a pull if it is still there after a step or two; a touch has ended by then.
_WAIT, _RISE = 0.4, 0.2  # [s] of stepping before a felt force begins to count, and from then until it counts in full
_LASTING = 2.0  # [1/s], bandwidth of the mean that a felt force does not exceed
_NONE = np.zeros((2, 3))


class HandLoad:
    """The force on each hand from outside, smooth enough for the balance.

    What the targets tell counts at once; it comes within its ranges and without jumps (`HandWrench.towards`). What is
    felt besides is cut at 250 N along each axis, and nothing of it counts in a stand: a robot that leans against a
    force holds a pull, but it presses harder on a post that it touches, which pushes back harder, until it falls. A
    robot that does not lean gives way to both, and the push of a post vanishes. A force that has made the robot step
    and is still there thereafter is a pull; it counts until it ends, in the stand that follows as well. What a hand
    meets in that stand besides, such as the table on which it sets down what it has carried, does not count.

    Of all forces, told or felt, those that are as small as the friction of the arms' drives do not count.

    Attributes:
        force: on the left and the right hand, world frame [N], shape (2, 3).
    """

    def __init__(self, rate: float, least: float) -> None:
        """Set up the filter.

        Args:
            rate: bandwidth of what is felt [1/s].
            least: force on a hand up to which nothing of it counts [N]; from twice as much on, all of it does.
        """
        self._rate, self._least = rate, least
        self.reset()

    def reset(self) -> None:
        """Start with free hands."""
        self.force = _NONE
        self._felt, self._mean = np.zeros((2, 2, 3))
        self._stepped, self._pull = 0.0, _NONE

    def update(self, state: RobotState, upper_body: UpperBody, dt: float, *, stepping: bool) -> None:
        """Take in one state.

        Args:
            state: the robot now; without forces on the hands, only those that `upper_body` tells count.
            upper_body: targets of the arms, with the wrench that the hands should meet.
            dt: time since the last call [s].
            stepping: whether the robot walks, or steps to catch itself.
        """
        told, seen = upper_body.wrench.total, state.hand_force
        self.force = _without_small(told, self._least)
        if seen is None:
            return
        besides = np.minimum(np.maximum(seen - told, -_STRONGEST), _STRONGEST)
        self._felt = self._felt + (1.0 - math.exp(-self._rate * dt)) * (besides - self._felt)
        self._mean = self._mean + (1.0 - math.exp(-_LASTING * dt)) * (self._felt - self._mean)
        felt = _length(self._felt)
        if not np.count_nonzero(felt > self._least):  # nor is the lasting part of it larger
            self._stepped = 0.0
            return
        lasting = np.minimum(_length(self._mean) / np.maximum(felt, self._least), 1.0)
        pull = _without_small(lasting * self._felt, self._least)
        if not np.count_nonzero(pull):
            self._stepped = 0.0
            return
        if stepping:
            self._stepped, self._pull = min(self._stepped + dt, _WAIT + _RISE), pull
        else:
            along = (pull * self._pull).sum(axis=1, keepdims=True) / np.maximum(_length(self._pull) ** 2, 1e-9)
            pull = np.minimum(np.maximum(along, 0.0), 1.0) * self._pull
        self.force = self.force + max(self._stepped - _WAIT, 0.0) / _RISE * pull


def _length(force: np.ndarray) -> np.ndarray:
    return np.sqrt(np.add.reduce(force * force, 1, keepdims=True))


def _without_small(force: np.ndarray, least: float) -> np.ndarray:
    """Return forces without those of at most `least` [N]; from twice as much on they count in full."""
    if not np.count_nonzero(force):
        return _NONE
    counts = np.minimum(np.maximum(_length(force) / least - 1.0, 0.0), 1.0)
    return force * counts if np.count_nonzero(counts) else _NONE

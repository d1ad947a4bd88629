"""Strides of a walk: means over one, and the moment to stop in."""

import collections
import math

import numpy as np

_MIDDLE = 0.2  # [strides], from when a foot has taken over the weight to the middle of its stance


class OverStride:
    """Mean of a vector over the last stride: a pelvis that sways from foot to foot has no other resting value."""

    def __init__(self) -> None:
        self._values: collections.deque[tuple[float, np.ndarray]] = collections.deque()
        self._sum: np.ndarray | float = 0.0

    def __call__(self, time: float, value: np.ndarray, stride: float) -> np.ndarray:
        """Add the value of a time [s] and return the mean over a stride [s] until then."""
        self._values.append((time, value))
        self._sum = self._sum + value
        while self._values[0][0] < time - stride + 1e-9:
            self._sum = self._sum - self._values.popleft()[1]
        return self._sum / len(self._values)


class MidStance:
    """Tells in which tick of each stride the left foot is in the middle of its stance.

    A learned policy that is told to stand puts a foot ahead or aside first, and turns by up to 0.2 rad. If it is always
    told in the same moment of a stride, it always moves the same way, and it hardly turns if a foot is in the middle
    of its swing.
    """

    def __init__(self) -> None:
        self._left, self._since = True, math.inf  # whether the left foot carries more, and since when one does [s]
        self._told = False  # whether this stance has been told

    def __call__(self, time: float, force: np.ndarray | None, stride: float) -> bool:
        """Return whether this tick of a walk is that moment.

        Where the forces on the feet are not known, or the feet have not taken turns for a stride, any moment is right.

        Args:
            time: of the tick [s].
            force: on the left and right foot, in the world frame [N], shape (2, 3), or None.
            stride: [s].
        """
        if force is None:
            return True
        left = bool(force[0, 2] > force[1, 2])
        if left != self._left or time < self._since:
            self._left, self._since, self._told = left, time, False
        stood = time - self._since
        now = left and not self._told and stood >= _MIDDLE * stride - 1e-9
        self._told = self._told or now
        return now or stood > stride

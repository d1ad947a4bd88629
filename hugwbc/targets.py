"""Where the hands should be: the input of hand IK, and what a script, a teleoperator or a planner produces."""

import dataclasses
from typing import Literal, get_args

import numpy as np

from hugwbc.errors import TargetError, UnknownNameError

HandFrame = Literal["pelvis", "world"]
HAND_FRAMES: tuple[HandFrame, ...] = get_args(HandFrame)


@dataclasses.dataclass(frozen=True, eq=False)
class HandTargets:
    """Target positions of both hand frames (the tips of the forearms).

    The plain constructor checks nothing, so that a control loop can carry whatever arrives; `HandTargets.of` is the
    checked one for users.

    Attributes:
        left, right: positions [m], shape (3,).
        frame: "pelvis" for the pelvis frame (it moves, pitches and turns with the pelvis, not with the waist), "world"
            for the world frame.
    """

    left: np.ndarray
    right: np.ndarray
    frame: HandFrame = "pelvis"

    @classmethod
    def of(cls, left: object, right: object, frame: str = "pelvis") -> "HandTargets":
        """Targets from any two sequences of three finite numbers.

        Raises:
            TargetError: if a position is not three finite numbers.
            UnknownNameError: if the frame is neither "pelvis" nor "world".
        """
        if frame not in HAND_FRAMES:
            raise UnknownNameError("hand frame", frame, HAND_FRAMES)
        return cls(position("left hand target", left), position("right hand target", right), frame)  # type: ignore[arg-type]

    def array(self) -> np.ndarray:
        """Left, then right position [m], shape (2, 3)."""
        return np.stack((self.left, self.right))

    @property
    def is_finite(self) -> bool:
        """Whether both positions hold finite numbers only."""
        return bool(np.all(np.isfinite(self.left)) and np.all(np.isfinite(self.right)))


def position(name: str, value: object) -> np.ndarray:
    """The value as a read-only point, shape (3,).

    Raises:
        TargetError: naming `name`, if the value is not three finite numbers.
    """
    try:
        point = np.array(value, dtype=float)
    except (TypeError, ValueError):
        point = np.empty(0)
    if point.shape != (3,) or not np.all(np.isfinite(point)):
        raise TargetError(f"{name} is {value}; give three finite numbers x, y, z in metres, such as (0.3, 0.2, 0.1)")
    point.setflags(write=False)
    return point

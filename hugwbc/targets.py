"""Where the hands should be: the input of hand IK, and what a script, a teleoperator or a planner produces."""

import dataclasses
from typing import Literal, get_args

import numpy as np

from hugwbc.errors import TargetError, UnknownNameError

HandFrame = Literal["pelvis", "heading", "world"]
HAND_FRAMES: tuple[HandFrame, ...] = get_args(HandFrame)


@dataclasses.dataclass(frozen=True, eq=False)
class HandTargets:
    """Target positions of both hand frames (the tips of the forearms).

    The plain constructor checks nothing, so that a control loop can carry whatever arrives; `HandTargets.of` is the
    checked one for users.

    Attributes:
        left, right: positions [m], shape (3,); None for a hand without a target, which rests beside the body.
        frame: "pelvis" for the pelvis frame (it moves, pitches and turns with the pelvis, not with the waist),
            "heading" for one at the pelvis that turns with its yaw only and stays level, "world" for the world frame.
        stamp: when the targets were made, on the clock of `RobotState.time` [s]; None for targets that are new whenever
            they arrive, as a script's are.
        sequence: number of the message that brought them, rising by one; None where nobody counts.
    """

    left: np.ndarray | None
    right: np.ndarray | None
    frame: HandFrame = "pelvis"
    stamp: float | None = None
    sequence: int | None = None

    @classmethod
    def of(cls, left: object, right: object, frame: str = "pelvis") -> "HandTargets":
        """Targets from any two sequences of three finite numbers; None for a hand without a target.

        Raises:
            TargetError: if a position is not three finite numbers, or neither hand has a target.
            UnknownNameError: if the frame is none of `HAND_FRAMES`.
        """
        if frame not in HAND_FRAMES:
            raise UnknownNameError("hand frame", frame, HAND_FRAMES)
        if left is None and right is None:
            raise TargetError("neither hand has a target; give at least one position x, y, z")
        points = [
            None if value is None else position(f"{side} hand target", value)
            for side, value in (("left", left), ("right", right))
        ]
        return cls(*points, frame)  # type: ignore[arg-type]

    def array(self) -> np.ndarray:
        """Left, then right position [m], shape (2, 3); NaN for a hand without a target."""
        return np.stack([np.full(3, np.nan) if p is None else p for p in (self.left, self.right)])

    @property
    def given(self) -> np.ndarray:
        """Whether the left and the right hand have a target, shape (2,), bool."""
        return np.array([self.left is not None, self.right is not None])

    @property
    def is_usable(self) -> bool:
        """Whether every position that is given is three finite numbers."""
        points = [point for point in (self.left, self.right) if point is not None]
        return all(np.shape(point) == (3,) and bool(np.all(np.isfinite(point))) for point in points)


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

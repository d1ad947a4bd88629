"""Where the hands should be: the input of hand IK, and what a script, a teleoperator or a planner produces."""

import dataclasses
from typing import Literal, get_args

import numpy as np

from hugwbc.errors import TargetError, UnknownNameError

HandFrame = Literal["pelvis", "heading", "world"]
HAND_FRAMES: tuple[HandFrame, ...] = get_args(HandFrame)
FARTHEST = 1e4  # [m] of a coordinate: no robot walks as far, and squares of errors stay finite


@dataclasses.dataclass(frozen=True, eq=False)
class HandTargets:
    """Target positions of both hand frames (the tips of the forearms), or of the arm joints in their place.

    The plain constructor checks nothing, so that a control loop can carry whatever arrives; `HandTargets.of` is the
    checked one for users.

    Attributes:
        left, right: positions [m], shape (3,); None for a hand without a target, which rests beside the body.
        frame: "pelvis" for the pelvis frame (it moves, pitches and turns with the pelvis, not with the waist),
            "heading" for one at the pelvis that turns with its yaw only and stays level, "world" for the world frame.
        left_direction, right_direction: unit vectors along which the forearms should point, shape (3,); None where it
            does not matter. With four joints an arm has one left to turn towards it, once its hand is in place.
        together: whether the hands hold one thing: their relative position then goes before where they are.
        whole_body: whether h, p and w may leave the command to bring the hands nearer.
        stamp: when the targets were made, on the clock of `RobotState.time` [s]; None for targets that are new whenever
            they arrive, as a script's are.
        sequence: number of the message that brought them, rising by one; None where nobody counts.
        joints: of both arms, order of `Robot.arm_names` [rad], shape (8,), as a motion file has them: no inverse
            kinematics then, and no positions of the hands. None for targets of the hands.
        joint_velocity: at which the joints move [rad/s], shape (8,); None for 0.
    """

    left: np.ndarray | None
    right: np.ndarray | None
    frame: HandFrame = "pelvis"
    left_direction: np.ndarray | None = None
    right_direction: np.ndarray | None = None
    together: bool = False
    whole_body: bool = False
    stamp: float | None = None
    sequence: int | None = None
    joints: np.ndarray | None = None
    joint_velocity: np.ndarray | None = None

    @classmethod
    def of(
        cls,
        left: object,
        right: object,
        frame: str = "pelvis",
        *,
        left_direction: object = None,
        right_direction: object = None,
        together: bool = False,
        whole_body: bool = False,
    ) -> "HandTargets":
        """Targets from any two sequences of three finite numbers; None for a hand without a target.

        Raises:
            TargetError: if a position or direction is not three finite numbers, or a target is missing: of both hands,
                or of one where they hold one thing.
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
        if together and (left is None or right is None):
            raise TargetError("hands that hold one thing both need a target; give left and right, or together=False")
        directions = [
            None if value is None else direction(f"{side} pointing direction", value)
            for side, value in (("left", left_direction), ("right", right_direction))
        ]
        return cls(*points, frame, *directions, together, whole_body)  # type: ignore[arg-type]

    def array(self) -> np.ndarray:
        """Left, then right position [m], shape (2, 3); NaN for a hand without a target."""
        return np.stack([np.full(3, np.nan) if p is None else p for p in (self.left, self.right)])

    @property
    def given(self) -> np.ndarray:
        """Whether the left and the right hand have a target, shape (2,), bool."""
        return np.array([self.left is not None, self.right is not None])

    @property
    def is_usable(self) -> bool:
        """Whether the frame is known, what is given of positions and directions three finite numbers, joints eight."""
        if self.frame not in HAND_FRAMES:
            return False
        vectors = (self.left, self.right, self.left_direction, self.right_direction)
        return all(vector is None or _is_finite(vector, 3) for vector in vectors) and all(
            vector is None or _is_finite(vector, 8) for vector in (self.joints, self.joint_velocity)
        )


def _is_finite(vector: np.ndarray, size: int) -> bool:
    try:
        return np.shape(vector) == (size,) and bool(np.isfinite(vector).all())
    except (TypeError, ValueError):  # no numbers, or rows of several lengths
        return False


def position(name: str, value: object) -> np.ndarray:
    """The value as a read-only point, shape (3,).

    Raises:
        TargetError: naming `name`, if the value is not three finite numbers, or one is beyond `FARTHEST`.
    """
    try:
        point = np.array(value, dtype=float)
    except (TypeError, ValueError):
        point = np.empty(0)
    # A NaN fails the comparison.
    if point.shape != (3,) or not np.all(np.abs(point) <= FARTHEST):
        raise TargetError(
            f"{name} is {value}; give three finite numbers x, y, z in metres, such as (0.3, 0.2, 0.1), "
            f"from -{FARTHEST:g} to {FARTHEST:g}"
        )
    point.setflags(write=False)
    return point


def direction(name: str, value: object) -> np.ndarray:
    """The value as a read-only unit vector, shape (3,).

    Raises:
        TargetError: naming `name`, if the value is not three finite numbers, or has no length.
    """
    vector = position(name, value)
    length = float(np.linalg.norm(vector))
    if length < 1e-6:
        raise TargetError(f"{name} is {value}; give a vector that points somewhere, such as (1, 0, 0)")
    unit = vector / length
    unit.setflags(write=False)
    return unit

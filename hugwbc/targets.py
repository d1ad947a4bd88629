"""Hand targets: the input of hand IK, produced by a script, a teleoperator or a planner."""

import dataclasses
from typing import Literal, get_args

import numpy as np

from hugwbc.errors import TargetError, UnknownNameError

HandFrame = Literal["pelvis", "heading", "world"]
HAND_FRAMES: tuple[HandFrame, ...] = get_args(HandFrame)
FARTHEST = 1e4  # [m], the largest coordinate: no robot walks that far, and squares of errors stay finite


@dataclasses.dataclass(frozen=True, eq=False)
class HandTargets:
    """Target positions of both hands (the tips of the forearms), or of the arm joints instead.

    The constructor checks nothing, so that a control loop can carry whatever arrives. Users call `HandTargets.of`,
    which checks.

    Attributes:
        left, right: positions [m], shape (3,); None for a hand that rests next to the body.
        frame: "pelvis" for the pelvis frame, which moves and turns with the pelvis but not with the waist; "heading"
            for a level frame at the pelvis that turns with its yaw only; "world" for the world frame.
        left_direction, right_direction: unit vectors along which the forearms should point, shape (3,); None where it
            does not matter. An arm has four joints; one is left to point the forearm once the hand is in place.
        together: whether the hands hold one object; their relative position then has priority over their positions.
        whole_body: whether h, p and w may differ from the command to bring the hands nearer.
        stamp: time at which the targets were made, on the clock of `RobotState.time` [s]; None for targets that are new
            whenever they arrive, such as a script's.
        sequence: number of the message, rising by one; None if messages are not counted.
        joints: positions of the arm joints in the order of `Robot.arm_names` [rad], shape (8,), such as those of a
            motion file; they replace hand positions and inverse kinematics. None for targets of the hands.
        joint_velocity: velocities of those joints [rad/s], shape (8,); None for 0.
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
        """Build checked targets from sequences of three finite numbers; None for a hand without a target.

        Raises:
            TargetError: if a position or direction is not three finite numbers, if both hands lack a target, or if one
                of two hands that hold one object lacks it.
            UnknownNameError: if the frame is not one of `HAND_FRAMES`.
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
            raise TargetError("hands that hold one object both need a target; give left and right, or together=False")
        directions = [
            None if value is None else direction(f"{side} pointing direction", value)
            for side, value in (("left", left_direction), ("right", right_direction))
        ]
        return cls(*points, frame, *directions, together, whole_body)  # type: ignore[arg-type]

    def array(self) -> np.ndarray:
        """Return the left, then the right position [m], shape (2, 3); NaN for a hand without a target."""
        return np.stack([np.full(3, np.nan) if p is None else p for p in (self.left, self.right)])

    @property
    def given(self) -> np.ndarray:
        """Whether the left and the right hand have a target, shape (2,), bool."""
        return np.array([self.left is not None, self.right is not None])

    @property
    def is_usable(self) -> bool:
        """Whether the frame is known, and all given vectors hold finite numbers: three for hands, eight for joints."""
        if self.frame not in HAND_FRAMES:
            return False
        vectors = (self.left, self.right, self.left_direction, self.right_direction)
        return all(vector is None or _is_finite(vector, 3) for vector in vectors) and all(
            vector is None or _is_finite(vector, 8) for vector in (self.joints, self.joint_velocity)
        )


def _is_finite(vector: np.ndarray, size: int) -> bool:
    try:
        return np.shape(vector) == (size,) and bool(np.isfinite(vector).all())
    except (TypeError, ValueError):  # not numbers, or rows of different lengths
        return False


def position(name: str, value: object) -> np.ndarray:
    """Return the value as a read-only point, shape (3,).

    Args:
        name: what the point is, for the message.
        value: any sequence of three numbers [m].

    Raises:
        TargetError: if the value is not three finite numbers up to `FARTHEST`.
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
    """Return the value as a read-only unit vector, shape (3,).

    Args:
        name: what the vector is, for the message.
        value: any sequence of three numbers.

    Raises:
        TargetError: if the value is not three finite numbers, or is zero.
    """
    vector = position(name, value)
    length = float(np.linalg.norm(vector))
    if length < 1e-6:
        raise TargetError(f"{name} is {value}; give a vector that is not zero, such as (1, 0, 0)")
    unit = vector / length
    unit.setflags(write=False)
    return unit

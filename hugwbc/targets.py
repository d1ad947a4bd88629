"""Hand targets: the input of hand IK, produced by a script, a teleoperator or a planner."""

import dataclasses
import math
import reprlib
from collections.abc import Callable
from typing import Literal, get_args

import numpy as np

from hugwbc import rotations
from hugwbc.errors import TargetError, UnknownNameError
from hugwbc.hand_wrench import FREE, STRONGEST, HandWrench
from hugwbc.numeric import JOINTS, Shape, floats, frozen, keep_floats, number
from hugwbc.robot import SIDES, Robot

HandFrame = Literal["pelvis", "heading", "steady", "world"]
Orientation = Literal["level"] | tuple[float, float, float, float]  # (w, x, y, z)
HAND_FRAMES: tuple[HandFrame, ...] = get_args(HandFrame)
_cut = reprlib.repr  # of a wrong value in a message: not all of it, and quick
FARTHEST = 1e4  # [m], the largest coordinate: no robot walks that far, and squares of errors stay finite
FARTHEST_HAND = 1.5  # [m], from the pelvis: a target farther away is a mistake, such as a wrong frame or unit
_DIRECTIONS = ("left_direction", "right_direction")
ORIENTATIONS = ("left_orientation", "right_orientation")
HEAVY_TURN = 1.0  # [m^2/rad^2], the largest weight of an orientation: a radian then counts like a metre


@dataclasses.dataclass(frozen=True, eq=False)
class HandTargets:
    """Target positions of both hands, or of the arm joints instead.

    The hands are the frames of `Robot.hands`; an H1's are in the ends of its forearms, 4 cm before the tips.

    The constructor refuses nothing, so that a control loop can carry whatever arrives: what other libraries call
    numbers is converted, and what is none, or has another shape, becomes NaN (`is_usable`). Users call
    `HandTargets.of`, which checks.

    Attributes:
        left, right: positions [m], shape (3,); None for a hand that rests next to the body.
        frame: "pelvis" for the pelvis frame, which moves and turns with the pelvis but not with the waist; "heading"
            for a level frame at the pelvis that turns with its yaw only; "steady" for that frame without the sway of
            the steps; "world" for the world frame.
        left_direction, right_direction: unit vectors along which the forearms should point, shape (3,); None where it
            does not matter. Of four joints, one is left to point the forearm once the hand is in place.
        together: whether the hands hold one object; their relative position then has priority over their positions.
        whole_body: whether h, p and w may differ from the command to bring the hands nearer.
        stamp: time at which the targets were made, on the clock of `RobotState.time` [s]; None for targets that are new
            whenever they arrive, such as a script's.
        sequence: number of the message, rising by one; None if messages are not counted.
        joints: positions of the arm joints in the order of `Robot.arm_names` [rad], shape (k,), such as those of a
            motion file; they replace hand positions and inverse kinematics. None for targets of the hands.
        joint_velocity: velocities of those joints [rad/s], shape (k,); None for 0.
        wrench: forces that the hands should meet, in the axes of `frame`, what they carry, and their stiffness.
        left_orientation, right_orientation: axes of the hand frame in those of `frame`, as a unit quaternion
            (w, x, y, z), shape (4,); zeros for a hand that is level, with its z axis up, whatever its heading; None
            where it does not matter. An orientation needs an arm with wrists (`check`).
        orientation_weight: weight of an error of the orientation, relative to 1 for one of the position [m^2/rad^2];
            None for the default of the inverse kinematics (`ArmIKConfig`).
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
    wrench: HandWrench = FREE
    left_orientation: np.ndarray | None = None
    right_orientation: np.ndarray | None = None
    orientation_weight: float | None = None

    def __post_init__(self) -> None:
        keep_floats(self, _SHAPES, _SHAPES)
        if self.sequence is not None and type(self.sequence) is not int:  # the difference of unsigned ones wraps around
            count = number(self.sequence)
            whole = math.nan if count is None or not math.isfinite(count) else int(count)
            object.__setattr__(self, "sequence", whole)

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
        left_force: object = None,
        right_force: object = None,
        payload: object = None,
        stiffness: float | None = None,
        left_orientation: object = None,
        right_orientation: object = None,
        orientation_weight: float | None = None,
    ) -> "HandTargets":
        """Build checked targets from sequences of three finite numbers; None for a hand without a target.

        Orientations are quaternions or "level". Forces act on the hands: see `HandWrench.of`. What is not valid raises
        a `TargetError` or, for an unknown frame, an `UnknownNameError`.
        """
        if frame not in HAND_FRAMES:
            raise UnknownNameError("hand frame", frame, HAND_FRAMES)
        if left is None and right is None:
            raise TargetError("neither hand has a target; give at least one position x, y, z")
        points = _both(position, "hand target", left, right)
        for side, point in zip(SIDES, points, strict=True):
            if frame != "world" and point is not None and (away := float(np.linalg.norm(point))) > FARTHEST_HAND:
                raise TargetError(
                    f"the {side} hand target is {away:.1f} m from the pelvis; give metres, up to {FARTHEST_HAND:g} m"
                )
        if together and (left is None or right is None):
            raise TargetError("hands that hold one object both need a target; give left and right, or together=False")
        directions = _both(direction, "direction", left_direction, right_direction)
        wrench = HandWrench.of(left_force, right_force, payload, stiffness)
        turns = _both(orientation, "orientation", left_orientation, right_orientation)
        for what, both in (("force", (left_force, right_force)), ("direction", directions), ("orientation", turns)):
            for side, point, given in zip(SIDES, points, both, strict=True):
                if given is not None and point is None:
                    raise TargetError(f"the {side} hand has no target, but its {what} is given; give a position too")
        weight = None if orientation_weight is None else number(orientation_weight)
        if orientation_weight is not None and (weight is None or not 0.0 < weight <= HEAVY_TURN):
            raise TargetError(
                f"orientation_weight is {_cut(orientation_weight)}; give a number above 0, up to {HEAVY_TURN:g} m²/rad²"
            )
        given = dict(zip(("left", "right", *_DIRECTIONS, *ORIENTATIONS), (*points, *directions, *turns), strict=True))
        return cls(
            **given, frame=frame, together=together, whole_body=whole_body, wrench=wrench, orientation_weight=weight
        )

    def check(self, robot: Robot) -> None:
        """Refuse targets that are not usable, or that the arms of a robot cannot follow.

        Raises:
            TargetError: with the reason.
        """
        joints = robot.arms.size
        if not self.is_usable or (self.joints is not None and self.joints.size != joints):
            raise TargetError(
                f"numbers that are not finite, or not three for a hand, {joints} for the joints, one for the sequence, "
                f"a weight not above 0, or a frame other than {', '.join(HAND_FRAMES)}"
            )
        arm = robot.arm_names[: joints // 2]
        for name in ORIENTATIONS:
            if (turn := getattr(self, name)) is not None and len(arm) < (needed := 6 if turn.any() else 5):
                raise TargetError(
                    f"{name} takes an arm of {needed} joints or more; an arm of {robot.name} has {len(arm)}: "
                    f"{', '.join(arm)}; leave the orientation out, or point the forearm by a direction"
                )

    def array(self) -> np.ndarray:
        """Return the left, then the right position [m], shape (2, 3); NaN for a hand without a target."""
        return np.stack([np.full(3, np.nan) if p is None else p for p in (self.left, self.right)])

    def turned(self, turn: np.ndarray, points: np.ndarray, frame: HandFrame) -> "HandTargets":
        """Return the same targets in another frame.

        Args:
            turn: the other frame's axes in those of this one, as columns, shape (3, 3).
            points: the targets' places in the other frame [m], shape (2, 3); read for hands with a target.
            frame: its name.
        """
        places = {side: point if given else None for side, point, given in zip(SIDES, points, self.given, strict=True)}
        vectors = {name: None if (v := getattr(self, name)) is None else v @ turn for name in _DIRECTIONS}
        axes = dict(zip(ORIENTATIONS, self.orientations, strict=True))
        if any(given is not None for given in axes.values()):  # those of a level hand stay zero
            back = rotations.conjugate(rotations.from_matrix(turn))
            axes = {name: None if q is None else rotations.multiply(back, q) for name, q in axes.items()}
        wrench = self.wrench
        if wrench is not FREE:
            wrench = dataclasses.replace(wrench, force=np.array([force @ turn for force in wrench.force]))
        return dataclasses.replace(self, frame=frame, wrench=wrench, **places, **vectors, **axes)

    @property
    def orientations(self) -> tuple[np.ndarray | None, np.ndarray | None]:
        """The orientations of the left and the right hand."""
        return self.left_orientation, self.right_orientation

    @property
    def given(self) -> np.ndarray:
        """Whether the left and the right hand have a target, shape (2,), bool."""
        return np.array([self.left is not None, self.right is not None])

    @property
    def is_usable(self) -> bool:
        """Whether the frame is known, all numbers that are given are finite, a weight is above 0, a sequence whole."""
        fields = vars(self)
        given = [value for name in _SHAPES if (value := fields[name]) is not None]
        finite = all(np.isfinite(value).all() for value in given)
        finite = finite and (self.wrench is FREE or (isinstance(self.wrench, HandWrench) and self.wrench.is_finite))
        weighed = self.orientation_weight is None or self.orientation_weight > 0.0
        counted = self.sequence is None or type(self.sequence) is int
        return finite and weighed and counted and isinstance(self.frame, str) and self.frame in HAND_FRAMES


_SHAPES: dict[str, Shape] = {
    **dict.fromkeys(("left", "right", *_DIRECTIONS), (3,)),
    **dict.fromkeys(("joints", "joint_velocity"), JOINTS),
    **dict.fromkeys(ORIENTATIONS, (4,)),
    **{"orientation_weight": (), "stamp": ()},
}


def frame_axes(frame: str, orientation: np.ndarray) -> np.ndarray:
    """Return the axes of a frame in the world as columns, shape (3, 3), of a robot with this orientation, shape (4,).

    The steady frame is the heading frame but for the sway of the steps.
    """
    if frame == "world":
        return np.eye(3)
    if frame == "pelvis":
        return rotations.to_matrix(orientation)
    return rotations.rotation_z(float(rotations.yaw_of(orientation)))


def _both(check: Callable[[str, object], np.ndarray], what: str, *values: object) -> list[np.ndarray | None]:
    """Return what is given for the left and the right hand after a check, which also gets a name for its message."""
    pairs = zip(SIDES, values, strict=True)
    return [None if value is None else check(f"{side} {what}", value) for side, value in pairs]


def position(name: str, value: object) -> np.ndarray:
    """Return any sequence of three numbers [m] as a read-only point, shape (3,); its name is for the message."""
    point = floats(value, (3,))
    # A NaN fails the comparison.
    if point is None or not np.all(np.abs(point) <= FARTHEST):
        raise TargetError(
            f"{name} is {_cut(value)}; give three finite numbers x, y, z in metres, such as (0.3, 0.2, 0.1), "
            f"from -{FARTHEST:g} to {FARTHEST:g}"
        )
    return frozen(point)


def direction(name: str, value: object) -> np.ndarray:
    """Return any sequence of three numbers as a read-only unit vector, shape (3,); its name is for the message."""
    vector = position(name, value)
    length = float(np.linalg.norm(vector))
    if length < 1e-6:
        raise TargetError(f"{name} is {_cut(value)}; give a vector that is not zero, such as (1, 0, 0)")
    return frozen(vector / length)


def orientation(name: str, value: object) -> np.ndarray:
    """Return any sequence of numbers (w, x, y, z) as a read-only unit quaternion, shape (4,); zeros for "level"."""
    if isinstance(value, str) and value == "level":
        return frozen(np.zeros(4))
    quaternion = floats(value, (4,))
    length = 0.0 if quaternion is None else float(np.linalg.norm(quaternion))
    if quaternion is None or not 1e-6 < length < FARTHEST:  # a NaN fails the comparison
        raise TargetError(
            f"{name} is {_cut(value)}; give a quaternion of four finite numbers w, x, y, z, such as (1, 0, 0, 0) for "
            "the axes of the frame, or 'level'"
        )
    return frozen(quaternion / length)


def squeeze(left: object, right: object, newtons: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the forces on two hands that squeeze what is between them: along the line between their targets.

    Args:
        left: target of the left hand [m], shape (3,).
        right: target of the right hand in the same frame [m], shape (3,).
        newtons: internal force [N].

    Returns:
        Force on the left and on the right hand in that frame [N], shape (3,) each; their sum is zero.
    """
    force = number(newtons)
    if force is None or not 0.0 <= force <= STRONGEST:
        raise TargetError(f"squeezing force is {_cut(newtons)}; give a number from 0 to {STRONGEST:g} N")
    between = position("right hand target", right) - position("left hand target", left)
    inwards = force * direction("line between the hand targets", between)
    return -inwards, inwards

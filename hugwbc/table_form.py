"""What the file of a robot's table may say, field by field; docs/how-to/add-a-robot.md explains the fields.

Units: m, kg, rad, N*m, s. Places and axes are in the frame of the link that they belong to. `hugwbc.robot_check` judges
whether what a table says is plausible.
"""

import dataclasses
from collections.abc import Iterable
from typing import Annotated, Any, Literal

from pydantic import Field

from hugwbc.errors import ConfigError
from hugwbc.settings import NotNegative, settings

Point = Annotated[list[float], Field(min_length=3, max_length=3)]
Span = Annotated[list[float], Field(min_length=2, max_length=2)]
Pair = Annotated[list[str], Field(min_length=2, max_length=2)]

_OUT: Any = None
"""Of a field that may be left out. None is not of its type, so that a field without a value is refused."""


def _left_out(form: Any, names: Iterable[str]) -> list[str]:  # noqa: ANN401  any of these models
    """Return which fields a file leaves out."""
    return [name for name in names if getattr(form, name) is None]


def _check_whole(row: Any, label: str, kind: Any, optional: Any) -> None:  # noqa: ANN401
    """Refuse a row that leaves out a field of the class `kind`, except those of the class `optional`."""
    fields, spared = ([field.name for field in dataclasses.fields(one)] for one in (kind, optional))
    needed = [name for name in fields if name not in spared]
    if lacking := _left_out(row, needed):
        raise ConfigError(f"{label} lacks {', '.join(lacking)}; give it")


@settings(kw_only=True)
class Roles:
    """Links and joints by the parts that they play; names on the right side follow from those on the left."""

    base: str = _OUT
    trunk: str = _OUT
    foot: str = _OUT
    hand: str = _OUT
    leg: dict[str, str] = _OUT
    arm: dict[str, str] = _OUT
    waist: dict[str, str] = _OUT


@settings(kw_only=True)
class Place:
    """A place on a link."""

    parent: str = _OUT
    xyz: Point


@settings(kw_only=True)
class Sole:
    """The flat bottom of a foot."""

    x: Span
    y: Span
    z: float


@settings(kw_only=True)
class Figures:
    """Limits, rotor inertia, friction and gains of a drive."""

    effort: float = _OUT
    velocity: float = _OUT
    policy_torque_limit: float = _OUT
    armature: float = _OUT
    friction: NotNegative = _OUT
    viscous: NotNegative = _OUT
    corner_speed: float = _OUT
    kp: float = _OUT
    kd: float = _OUT


@settings(kw_only=True)
class Drive(Figures):
    """Figures of some joints, and of those on the other side."""

    joints: list[str]


@settings(kw_only=True)
class JointChange(Figures):
    """Corrections of a joint of a description."""

    xyz: Point = _OUT
    rpy: Point = _OUT
    axis: Point = _OUT
    range: Span = _OUT
    nominal: float = _OUT


@settings(kw_only=True)
class Joint(JointChange):
    """A hinge and the link that it moves, whose frame is the joint's."""

    name: str
    parent: str
    child: str

    def __post_init__(self) -> None:
        """Check that no field is missing except those that its drive may give."""
        _check_whole(self, self.name, JointChange, Figures)


@settings(kw_only=True)
class Box:
    """A box along the axes of a link."""

    center: Point
    size: Point  # full lengths


@settings(kw_only=True)
class Bounds:
    """Corners of a box."""

    min: Point
    max: Point


@settings(kw_only=True)
class Shapes:
    """Extent of a link."""

    collision_box: Box = _OUT
    bbox: Bounds = _OUT  # of the outer shell, for drawing


@settings(kw_only=True)
class LinkChange(Shapes):
    """Corrections of a link of a description; its inertia is about the centre of mass, along the axes of the link."""

    mass: float = _OUT
    com: Point = _OUT
    ixx: float = _OUT
    iyy: float = _OUT
    izz: float = _OUT
    ixy: float = _OUT
    ixz: float = _OUT
    iyz: float = _OUT


@settings(kw_only=True)
class Link(LinkChange):
    """A link."""

    name: str

    def __post_init__(self) -> None:
        """Check that no field is missing except its shapes."""
        _check_whole(self, self.name, LinkChange, Shapes)


@settings(kw_only=True)
class Limits:
    """Ranges of a command."""

    initial: Span = _OUT
    finishing: Span = _OUT


@settings(kw_only=True)
class Commands:
    """Commands with ranges of their own instead of those scaled to the robot's size."""

    v_x: Limits = _OUT
    v_y: Limits = _OUT
    omega: Limits = _OUT
    f: Limits = _OUT
    l: Limits = _OUT  # noqa: E741  the paper's name
    h: Limits = _OUT
    p: Limits = _OUT
    w: Limits = _OUT


@settings(kw_only=True)
class ArmServo:
    """Gains of the joints of an arm under external control."""

    kp: list[float]
    kd: list[float]


@settings(kw_only=True)
class Squat:
    """How far ahead of its ankles a robot squats."""

    heights: list[float]
    reach: list[float]
    reach_per_pitch: float
    level_shank: float

    def __post_init__(self) -> None:
        """Check that there is a reach for each height, and that both ascend."""
        heights, reach = self.heights, self.reach
        if not 1 < len(heights) == len(reach) or sorted(set(heights)) != heights or sorted(reach) != reach:
            raise ConfigError(
                f"squat has heights {heights} and reach {reach}; give both ascending, a reach for each height"
            )


@settings(kw_only=True)
class CapsuleShape:
    """A cylinder with round ends along z."""

    pos: Point
    radius: float
    length: float


@settings(kw_only=True)
class Shape:
    """A shape to draw."""

    type: Literal["box", "capsule", "cylinder", "ellipsoid", "ring", "sphere"]
    size: float | list[float]
    pos: Point
    rpy: Point = _OUT
    colour: str


@settings(kw_only=True)
class Interface:
    """Messages and motor slots of the robot itself."""

    messages: str = _OUT
    machines: list[int] = _OUT
    motors: list[str | None]
    modes: list[int]


@settings(kw_only=True)
class Difference:
    """What differs in another description of the same machine."""

    armature: float = _OUT
    joints: dict[str, JointChange] = _OUT
    links: dict[str, LinkChange] = _OUT


@settings(kw_only=True)
class Table:
    """All that a table may say: of a robot with a description (URDF or MJCF), corrections of it, else everything."""

    name: str = _OUT  # which `robot_table` gives
    description: str = _OUT
    roles: Roles
    joints: list[Joint] | dict[str, JointChange] = _OUT
    links: list[Link] | dict[str, LinkChange] = _OUT
    nominal: dict[str, float] = _OUT
    imu: Place | str = _OUT
    camera: Place | str = _OUT
    hand: Place | str = _OUT
    sole: Sole = _OUT
    drives: list[Drive] = dataclasses.field(default_factory=list)
    commands: Commands = _OUT
    qp: dict[str, Any] = _OUT
    damping: NotNegative = _OUT
    command_delay: NotNegative = _OUT
    nominal_height: float = _OUT
    leg_postures: dict[str, list[float]] = _OUT
    arm_postures: dict[str, list[float]] = _OUT
    arm_servo: ArmServo = _OUT
    squat: Squat = _OUT
    capsules: dict[str, list[CapsuleShape]] = _OUT
    collision_pairs: list[Pair] = _OUT
    contact_links: list[str] = _OUT
    visuals: dict[str, list[Shape]] = _OUT
    colours: dict[str, list[float]] = _OUT
    interface: Interface = _OUT
    robots: dict[str, Difference] = _OUT

    def __post_init__(self) -> None:
        """Check what depends on whether there is a description."""
        described = self.description is not None
        for section in ("joints", "links"):
            if isinstance(getattr(self, section), list if described else dict):
                raise ConfigError(
                    f"with a description, `{section}` are corrections of it, {section}: {{NAME: ...}}"
                    if described
                    else f"without a description, `{section}` have a row each, {section}: [{{name: NAME, ...}}]",
                    at=(section,),
                )
        lacking = [] if described else _left_out(self, _OF_A_WHOLE_TABLE)
        if lacking:
            raise ConfigError(f"there is neither a `description` nor {', '.join(lacking)}; give one or the other")
        for section in () if described else ("imu", "camera", "hand"):
            if isinstance(frame := getattr(self, section), str):
                raise ConfigError(f"{section} is {frame}; without a description, give its xyz", at=(section,))


_OF_A_WHOLE_TABLE = (
    *("joints", "links", "imu", "camera", "hand", "sole"),
    *("capsules", "collision_pairs", "contact_links", "visuals", "colours"),
)

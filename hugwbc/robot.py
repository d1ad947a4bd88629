"""Robots as data: names, groups, limits, gains, drives and dimensions, read from the table `models/h1/h1.yaml`."""

import copy
import dataclasses
import functools
import math
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import yaml

from hugwbc.errors import ModelError, UnknownNameError

SIDES = ("left", "right")
DEFAULT_ROBOT = "h1"  # the one that the table describes in full; others are lists of differences
_LEG_PARTS = ("hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle")
_ARM_PARTS = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")


def model_dir() -> pathlib.Path:
    """Return the folder of the robot description: inside an installed package, or next to it in a source checkout.

    Raises:
        ModelError: if neither exists.
    """
    package = pathlib.Path(__file__).parent
    for candidate in (package / "models" / "h1", package.parent / "models" / "h1"):
        if (candidate / "h1.yaml").is_file():
            return candidate
    raise ModelError(f"models/h1 was found neither in {package} nor next to it; reinstall hugwbc with its models")


FRICTION_SPEED = 0.2  # [rad/s] at which three quarters of the Coulomb friction act


@dataclasses.dataclass(frozen=True)
class Capsule:
    """A cylinder with round ends along the z axis of a link's frame.

    Attributes:
        pos: centre [m].
        radius: radius of the cylinder and its ends [m].
        length: length of the cylinder without its ends [m].
    """

    pos: tuple[float, float, float]
    radius: float
    length: float


@dataclasses.dataclass(frozen=True, eq=False)
class Robot:
    """Names, limits, gains, drives and dimensions of a robot. Arrays follow `joint_names` and are read-only.

    Attributes:
        name: name of the description, "h1" or "h1-2023".
        mass: mass of all links [kg].
        joint_names: names of the 19 joints, in the order of every joint vector.
        lower, upper: joint position limits [rad], shape (19,).
        velocity_limit: joint speed limits [rad/s], shape (19,).
        torque_limit: smaller of the maker's effort limit and the policy's torque clip [N*m], shape (19,).
        kp, kd: PD gains of the paper [N*m/rad], [N*m*s/rad], shape (19,).
        nominal: default joint positions [rad], shape (19,).
        axes: joint axes in the joint's own frame, shape (19, 3).
        armature: inertia of rotors and gears, reflected to the joints [kg*m^2], shape (19,).
        damping: viscous friction of the joints with ideal drives [N*m*s/rad], shape (19,).
        friction: Coulomb friction of the real drives [N*m], shape (19,).
        viscous: viscous friction of the real drives [N*m*s/rad], shape (19,).
        corner_speed: highest speed at which the real drives give their full torque [rad/s], shape (19,).
        command_delay: time from a joint command to the torque of the real drives [s].
        nominal_height: height of the pelvis origin above flat ground at h = 0 [m].
        sole_x, sole_y: extent of the flat sole in the ankle link's frame [m].
        sole_depth: distance of the sole below the ankle axis [m].
        leg_length: distance from the hip pitch axis to the ankle axis of a straight leg [m].
        shoulder: origin of the left shoulder roll joint in the pelvis frame with the waist at 0 [m], shape (3,).
        upper_arm: distance from the shoulder roll joint to the elbow [m].
        hand: origin of the hand frame in the elbow link's frame [m], shape (3,).
        leg_postures: named postures of a leg [rad], shape (5,) each.
        arm_postures: named postures of the left arm [rad], shape (4,) each.
        squat_heights: heights of the pelvis above the nominal one, ascending [m].
        squat_reach: foremost centre of mass ahead of the ankles that the ankles' range allows at these heights, with
            level soles and an upright pelvis [m].
        squat_reach_per_pitch: forward shift of that point per pelvis pitch [m/rad].
        level_shank: lean of the shank up to which the ankle keeps the sole level [rad].
        collision_pairs: pairs of links that can touch each other.
        capsules: shapes that the arms avoid besides the links' collision shapes, by link.
        contact_links: links whose contacts the privileged observation flags.
        inertias: mass [kg], centre [m] and inertia about it [kg*m^2] of what a joint moves rigidly, in the frame of its
            link, where they are others than in the URDF, by joint; "root_joint" for the base.
    """

    name: str
    mass: float
    joint_names: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    velocity_limit: np.ndarray
    torque_limit: np.ndarray
    kp: np.ndarray
    kd: np.ndarray
    nominal: np.ndarray
    axes: np.ndarray
    armature: np.ndarray
    damping: np.ndarray
    friction: np.ndarray
    viscous: np.ndarray
    corner_speed: np.ndarray
    command_delay: float
    nominal_height: float
    sole_x: tuple[float, float]
    sole_y: tuple[float, float]
    sole_depth: float
    leg_length: float
    shoulder: np.ndarray
    upper_arm: float
    hand: np.ndarray
    leg_postures: Mapping[str, np.ndarray]
    arm_postures: Mapping[str, np.ndarray]
    squat_heights: tuple[float, ...]
    squat_reach: tuple[float, ...]
    squat_reach_per_pitch: float
    level_shank: float
    collision_pairs: frozenset[frozenset[str]]
    capsules: Mapping[str, tuple["Capsule", ...]]
    contact_links: tuple[str, ...]
    inertias: Mapping[str, tuple[float, np.ndarray, np.ndarray]] = dataclasses.field(default_factory=dict)

    def friction_torque(self, velocity: np.ndarray) -> np.ndarray:
        """Return the torque that the real drives lose to friction at joint speeds [N*m].

        Coulomb friction changes its sign over a few tenths of a radian per second (`FRICTION_SPEED`) instead of at
        once, so that noise of a speed around zero does not become chatter of the torque.

        Args:
            velocity: joint speeds [rad/s], shape (19,).
        """
        return self.friction * np.tanh(velocity / FRICTION_SPEED) + self.viscous * velocity

    def with_ideal_drives(self) -> "Robot":
        """Return the robot with ideal drives, without friction and delay, as controllers are told it."""
        return self._with_ideal_drives

    @functools.cached_property
    def _with_ideal_drives(self) -> "Robot":
        none = _frozen(np.zeros_like(self.friction))
        return dataclasses.replace(self, friction=none, viscous=none, command_delay=0.0)

    def index(self, name: str) -> int:
        """Return the position of a joint in every joint vector."""
        try:
            return self.joint_names.index(name)
        except ValueError:
            raise UnknownNameError("joint", name, self.joint_names) from None

    def indices(self, names: Sequence[str]) -> np.ndarray:
        """Return the positions of several joints in every joint vector, shape (n,)."""
        return np.array([self.index(name) for name in names])

    @functools.cached_property
    def legs(self) -> np.ndarray:
        """Indices of the ten leg joints, left leg first."""
        return self.indices([f"{side}_{part}_joint" for side in SIDES for part in _LEG_PARTS])

    @functools.cached_property
    def arms(self) -> np.ndarray:
        """Indices of the eight arm joints, left arm first: the upper body that external control may take over."""
        return self.indices([f"{side}_{part}_joint" for side in SIDES for part in _ARM_PARTS])

    @functools.cached_property
    def arm_names(self) -> tuple[str, ...]:
        """Names of the eight arm joints in the order of `arms`."""
        return tuple(self.joint_names[i] for i in self.arms)

    @functools.cached_property
    def waist(self) -> int:
        """Index of the waist yaw joint."""
        return self.index("torso_joint")

    @functools.cached_property
    def yaw_joints(self) -> np.ndarray:
        """Indices of the joints that turn the body about its vertical axis: hip yaw and waist."""
        waist = self.joint_names[self.waist]
        return self.indices([n for n in self.joint_names if n.endswith("hip_yaw_joint") or n == waist])

    @functools.cached_property
    def hip_yaw_roll(self) -> np.ndarray:
        """Indices of the four hip yaw and hip roll joints (the paper's hip x and z)."""
        return self.indices([f"{side}_{part}_joint" for side in SIDES for part in ("hip_yaw", "hip_roll")])

    @property
    def sole_middle(self) -> float:
        """Distance of the sole's centre ahead of the ankle [m]."""
        return sum(self.sole_x) / 2.0

    @functools.cached_property
    def forearm(self) -> float:
        """Distance from the elbow to the hand [m]."""
        return math.hypot(*self.hand.tolist())

    @property
    def xml_path(self) -> pathlib.Path:
        """The MuJoCo description."""
        return model_dir() / f"{self.name}.xml"

    @property
    def urdf_path(self) -> pathlib.Path:
        """The URDF description."""
        return model_dir() / f"{self.name}.urdf"


def _frozen(values: Sequence[Any] | np.ndarray) -> np.ndarray:
    array = np.asarray(values, dtype=float)
    array.setflags(write=False)
    return array


def robot_names() -> tuple[str, ...]:
    """Return the names of all robots of the table, the default first."""
    return (DEFAULT_ROBOT, *_raw_table().get("robots", ()))


def robot_table(name: str = DEFAULT_ROBOT) -> dict[str, Any]:
    """Return the table of a robot: that of h1.yaml with the robot's differences applied.

    Raises:
        ModelError: if the table or one of its fields is missing.
    """
    table = copy.deepcopy(_raw_table())
    variants = table.pop("robots", {})
    if name != DEFAULT_ROBOT and name not in variants:
        raise UnknownNameError("robot", name, robot_names())
    difference = variants.get(name, {})
    try:
        _assign_drives(table)
        for joint in table["joints"]:
            joint.update({"armature": difference["armature"]} if "armature" in difference else {})
            joint.update(difference.get("joints", {}).get(joint["name"], {}))
        for link in table["links"]:
            link.update(difference.get("links", {}).get(link["name"], {}))
    except (KeyError, TypeError) as error:
        raise _missing(error) from error
    return {"name": name, **table}


def _raw_table() -> dict[str, Any]:
    return _read_table(model_dir() / "h1.yaml")


@functools.cache
def _read_table(path: pathlib.Path) -> dict[str, Any]:
    return yaml.safe_load(path.read_text())


def _missing(error: Exception) -> ModelError:
    return ModelError(f"{model_dir() / 'h1.yaml'} lacks the field {error}; restore it from the repository")


def _assign_drives(table: dict[str, Any]) -> None:
    """Copy the figures of the drives to their joints."""
    drives = {part: drive for drive in table["drives"] for part in drive["joints"]}
    for joint in table["joints"]:
        part = joint["name"].removesuffix("_joint").removeprefix("left_").removeprefix("right_")
        joint.update({key: value for key, value in drives[part].items() if key != "joints"})


def load_robot(name: str = DEFAULT_ROBOT) -> Robot:
    """Load a robot of `models/h1/h1.yaml`.

    Args:
        name: "h1", the robot with the maker's corrected masses, or "h1-2023", the earlier description.

    Raises:
        ModelError: if the table or one of its fields is missing.
    """
    return _load_robot(name)


@functools.cache
def _load_robot(name: str) -> Robot:
    table = robot_table(name)
    try:
        joints, by_name = table["joints"], {joint["name"]: joint for joint in table["joints"]}

        def column(key: str) -> np.ndarray:
            return _frozen([joint[key] for joint in joints])

        ranges = column("range")
        return Robot(
            name=name,
            mass=math.fsum(link["mass"] for link in table["links"]),
            joint_names=tuple(by_name),
            lower=_frozen(ranges[:, 0]),
            upper=_frozen(ranges[:, 1]),
            velocity_limit=column("velocity"),
            torque_limit=_frozen(np.minimum(column("effort"), column("policy_torque_limit"))),
            kp=column("kp"),
            kd=column("kd"),
            nominal=column("nominal"),
            axes=column("axis"),
            armature=column("armature"),
            damping=_frozen([table["damping"]] * len(joints)),
            friction=column("friction"),
            viscous=column("viscous"),
            corner_speed=column("corner_speed"),
            command_delay=float(table["command_delay"]),
            nominal_height=float(table["nominal_height"]),
            sole_x=tuple(table["sole"]["x"]),
            sole_y=tuple(table["sole"]["y"]),
            sole_depth=-float(table["sole"]["z"]),
            leg_length=_distance(by_name, ("left_knee_joint", "left_ankle_joint")),
            shoulder=_frozen(_shoulder(by_name)),
            upper_arm=float(np.linalg.norm(_sum_of_origins(by_name, ("left_shoulder_yaw_joint", "left_elbow_joint")))),
            hand=_frozen(table["hand"]["xyz"]),
            leg_postures={key: _frozen(value) for key, value in table["leg_postures"].items()},
            arm_postures={key: _frozen(value) for key, value in table["arm_postures"].items()},
            squat_heights=tuple(table["squat"]["heights"]),
            squat_reach=tuple(table["squat"]["reach"]),
            squat_reach_per_pitch=float(table["squat"]["reach_per_pitch"]),
            level_shank=float(table["squat"]["level_shank"]),
            collision_pairs=frozenset(map(frozenset, table["collision_pairs"])),
            capsules={link: tuple(Capsule(**shape) for shape in shapes) for link, shapes in table["capsules"].items()},
            contact_links=tuple(table["contact_links"]),
        )
    except (IndexError, KeyError, TypeError) as error:
        raise _missing(error) from error


def _sum_of_origins(joints: Mapping[str, Any], names: Sequence[str]) -> np.ndarray:
    return np.sum([joints[name]["xyz"] for name in names], axis=0)


def _distance(joints: Mapping[str, Any], names: Sequence[str]) -> float:
    """Sum of the distances of some joints from their parents [m]."""
    return math.fsum(float(np.linalg.norm(joints[name]["xyz"])) for name in names)


def _shoulder(joints: Mapping[str, Any]) -> np.ndarray:
    """Origin of the left shoulder roll joint in the pelvis frame, for a shoulder that is mounted with a roll [m]."""
    pitch, roll = joints["left_shoulder_pitch_joint"], joints["left_shoulder_roll_joint"]
    angle = pitch["rpy"][0]
    turn = np.array([[1, 0, 0], [0, math.cos(angle), -math.sin(angle)], [0, math.sin(angle), math.cos(angle)]])
    return np.array(joints["torso_joint"]["xyz"]) + pitch["xyz"] + turn @ roll["xyz"]

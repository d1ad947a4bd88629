"""Robots as data: names, parts, limits, gains, drives and dimensions, read from tables `models/NAME/NAME.yaml`."""

import dataclasses
import functools
import math
import pathlib
import runpy
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator

from hugwbc.errors import ModelError, UnknownNameError
from hugwbc.numeric import frozen
from hugwbc.robot_check import table_problems
from hugwbc.robot_tables import DEFAULT_ROBOT, SHIPPED, models_dir, robot_names, robot_table, table_file
from hugwbc.rotations import AXIAL_SIGNS
from hugwbc.settings import refusing
from hugwbc.state import GRAVITY
from hugwbc.table_defaults import SIDES as SIDES, Joints, other_side, placement

FRICTION_SPEED = 0.2  # [rad/s] at which three quarters of the Coulomb friction act


@dataclasses.dataclass(frozen=True)
class Capsule:
    """A cylinder with round ends along the z axis of a link's frame."""

    pos: tuple[float, float, float]  # centre [m]
    radius: float  # of the cylinder and its ends [m]
    length: float  # of the cylinder without its ends [m]


@dataclasses.dataclass(frozen=True, eq=False)
class Robot:
    """Names, limits, gains, drives and dimensions of a robot. Arrays follow `joint_names` and are read-only.

    Attributes:
        name: by which `load_robot` finds it: "h1", or the path of a table.
        xml_path, urdf_path: the descriptions for MuJoCo and Pinocchio.
        mass: mass of all links [kg].
        joint_names: names of the n joints, in the order of every joint vector.
        lower, upper: joint position limits [rad], shape (n,).
        velocity_limit: joint speed limits [rad/s], shape (n,).
        torque_limit: smaller of the maker's effort limit and the policy's torque clip [N*m], shape (n,).
        kp, kd: PD gains of the drives, as the table has them [N*m/rad], [N*m*s/rad], shape (n,).
        nominal: default joint positions [rad], shape (n,).
        axes: joint axes in the joint's own frame, shape (n, 3).
        base_axes: the same in the base's frame, with all joints at 0.
        armature: inertia of rotors and gears, reflected to the joints [kg*m^2], shape (n,).
        damping: viscous friction of the joints with ideal drives [N*m*s/rad], shape (n,).
        friction: Coulomb friction of the real drives [N*m], shape (n,).
        viscous: viscous friction of the real drives [N*m*s/rad], shape (n,).
        corner_speed: highest speed at which the real drives give their full torque [rad/s], shape (n,).
        command_delay: time from a joint command to the torque of the real drives [s].
        nominal_height: height of the pelvis origin above flat ground at h = 0 [m].
        base: link of the floating base, the pelvis.
        trunk: link that carries the arms.
        imu_link: link that carries the IMU: base or trunk.
        camera: place of the head's camera in the trunk's frame [m], shape (3,).
        foot_links: links with the soles, left first.
        hand_links: links that carry the hand frames, left first.
        legs: indices of the leg joints, left leg first, each from the hip down.
        arms: indices of the arm joints, left arm first: the upper body that external control may take over.
        waist: index of the waist yaw joint.
        pairs: indices of the left and the right joint that play a part, such as "knee"; `pair` looks one up.
        moved: the links that these joints move, left first, by part.
        sole_x, sole_y, sole_z: extent and height of the flat sole in the foot link's frame [m].
        sole_depth: distance of the sole below the ankle pitch axis [m].
        ankle_x: place of that axis along the foot link's frame [m].
        thigh, shank: distances from the hip pitch axis to the knee and on to the ankle pitch axis, from the side [m].
        shoulder: origin of the left shoulder roll joint in the pelvis frame with the waist at 0 [m], shape (3,).
        upper_arm: distance from the shoulder roll joint to the elbow [m].
        forearm: distance from the elbow to the hand [m].
        hands: origins of the hand frames in the hand links' frames [m], shape (2, 3).
        hand_tip: distance from the hand frame ahead to the end of the hand, about along the forearm [m].
        hand_half_width: distance from the hand frame to the farther side of the hand [m].
        leg_postures: named postures of a leg [rad], in the order of `legs`.
        arm_postures: named postures of the left arm [rad], in the order of `arms`.
        arm_kp, arm_kd: gains of the arms under external control [N*m/rad], [N*m*s/rad], shape (arm joints,).
        squat_heights: heights of the pelvis above the nominal one, ascending [m].
        squat_reach: foremost centre of mass ahead of the ankles that the ankles' range allows at these heights, with
            level soles and an upright pelvis [m].
        squat_reach_per_pitch: forward shift of that point per pelvis pitch [m/rad].
        level_shank: lean of the shank up to which the ankle keeps the sole level [rad].
        collision_pairs: pairs of links that can touch each other.
        capsules: shapes that the arms avoid besides the links' collision shapes, by link.
        contact_links: links whose contacts the privileged observation flags.
        commands: ranges of commands, `initial` and `finishing`, by name, where the table has its own.
        qp: parameters of the `qp` controller (`hugwbc.mbc.params`), by name, where the table has its own.
        inertias: mass [kg], centre [m] and inertia about it [kg*m^2] of what a joint moves rigidly, in the frame of its
            link, where they are others than in the URDF, by joint; "root_joint" for the base.
    """

    name: str
    xml_path: pathlib.Path
    urdf_path: pathlib.Path
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
    base_axes: np.ndarray
    armature: np.ndarray
    damping: np.ndarray
    friction: np.ndarray
    viscous: np.ndarray
    corner_speed: np.ndarray
    command_delay: float
    nominal_height: float
    base: str
    trunk: str
    imu_link: str
    camera: np.ndarray
    foot_links: tuple[str, str]
    hand_links: tuple[str, str]
    legs: np.ndarray
    arms: np.ndarray
    waist: int
    pairs: Mapping[str, np.ndarray]
    moved: Mapping[str, tuple[str, str]]
    sole_x: tuple[float, float]
    sole_y: tuple[float, float]
    sole_z: float
    sole_depth: float
    ankle_x: float
    thigh: float
    shank: float
    shoulder: np.ndarray
    upper_arm: float
    forearm: float
    hands: np.ndarray
    hand_tip: float
    hand_half_width: float
    leg_postures: Mapping[str, np.ndarray]
    arm_postures: Mapping[str, np.ndarray]
    arm_kp: np.ndarray
    arm_kd: np.ndarray
    squat_heights: tuple[float, ...]
    squat_reach: tuple[float, ...]
    squat_reach_per_pitch: float
    level_shank: float
    collision_pairs: frozenset[frozenset[str]]
    capsules: Mapping[str, tuple["Capsule", ...]]
    contact_links: tuple[str, ...]
    commands: Mapping[str, Mapping[str, tuple[float, float]]]
    qp: Mapping[str, Any]
    inertias: Mapping[str, tuple[float, np.ndarray, np.ndarray]] = dataclasses.field(default_factory=dict)

    def friction_torque(self, velocity: np.ndarray) -> np.ndarray:
        """Return the torque that the real drives lose to friction at joint speeds [N*m].

        Coulomb friction changes its sign over a few tenths of a radian per second (`FRICTION_SPEED`) instead of at
        once, so that noise of a speed around zero does not become chatter of the torque.

        Args:
            velocity: joint speeds [rad/s], shape (..., n).
        """
        return self.friction * np.tanh(velocity / FRICTION_SPEED) + self.viscous * velocity

    def index(self, name: str) -> int:
        """Return the position of a joint in every joint vector."""
        try:
            return self.joint_names.index(name)
        except ValueError:
            raise UnknownNameError("joint", name, self.joint_names) from None

    def indices(self, names: Sequence[str]) -> np.ndarray:
        """Return the positions of several joints in every joint vector, shape (len(names),)."""
        return np.array([self.index(name) for name in names])

    def pair(self, part: str) -> np.ndarray:
        """Return the indices of the left and the right joint that play a part, shape (2,)."""
        try:
            return self.pairs[part]
        except KeyError:
            raise UnknownNameError(f"part of {self.name}", part, self.pairs) from None

    def imu_turn(self, q: np.ndarray, dq: np.ndarray) -> tuple[float, float]:
        """Return angle [rad] and speed [rad/s] by which the joints turn the IMU about the base's z axis."""
        return (float(q[self.waist]), float(dq[self.waist])) if self.imu_link == self.trunk else (0.0, 0.0)

    def limits(self, margin: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the position limits with a margin, at most a quarter of a joint's range [rad], each of shape (n,)."""
        margins = np.minimum(margin, (self.upper - self.lower) / 4.0)
        return self.lower + margins, self.upper - margins

    @functools.cached_property
    def target_range(self) -> tuple[np.ndarray, np.ndarray]:
        """The lowest and highest position target of each joint [rad], each of shape (n,).

        A PD joint turns the distance to its target into torque. To give its full torque at a position limit, its target
        must lie torque_limit / kp beyond that limit.
        """
        margin = self.torque_limit / self.kp
        return frozen(self.lower - margin), frozen(self.upper + margin)

    @functools.cached_property
    def held(self) -> np.ndarray:
        """Indices of the joints of neither legs, waist nor arms, which hold their nominal positions, shape (m,)."""
        return np.setdiff1d(np.arange(len(self.joint_names)), np.r_[self.legs, self.waist, self.arms])

    @functools.cached_property
    def arm_names(self) -> tuple[str, ...]:
        """Names of the arm joints in the order of `arms`."""
        return tuple(self.joint_names[i] for i in self.arms)

    @functools.cached_property
    def yaw_joints(self) -> np.ndarray:
        """Indices of the joints that turn the body about its vertical axis: hip yaw and waist."""
        return np.sort(np.r_[self.pair("hip_yaw"), self.waist])

    @functools.cached_property
    def hip_yaw_roll(self) -> np.ndarray:
        """Indices of the four hip yaw and hip roll joints (the paper's hip x and z)."""
        return np.sort(np.r_[self.pair("hip_yaw"), self.pair("hip_roll")])

    @property
    def leg_length(self) -> float:
        """Length of a straight leg from the hip pitch axis to the ankle pitch axis, from the side [m]."""
        return self.thigh + self.shank

    @property
    def weight(self) -> float:
        """Weight of all links [N]."""
        return GRAVITY * self.mass

    @property
    def sole_middle(self) -> float:
        """Place of the sole's centre along the foot link's frame [m]."""
        return sum(self.sole_x) / 2.0

    @property
    def sole_ahead(self) -> float:
        """Distance of the sole's centre ahead of the ankle [m]."""
        return self.sole_middle - self.ankle_x


def _from_the_side(way: np.ndarray, joints: Joints, link: str, roles: Mapping[str, Any]) -> list[float]:
    """Return a vector of a link's frame without its part along the base's y axis, with all joints at 0 [m]."""
    aside = placement(joints, link, roles["base"])[1][1]
    return (way - (way @ aside) * aside).tolist()


def load_robot(name: str = DEFAULT_ROBOT) -> Robot:
    """Load a robot.

    Args:
        name: "h1", with the maker's corrected masses; "h1-2023", the earlier description; "g1", the Unitree G1; or the
            path of a table of your own, NAME/NAME.yaml, or of its folder. NAME.xml and NAME.urdf are written beside it.

    Raises:
        ModelError: if the table is malformed or incomplete, or a table of your own is implausible.
        UnknownNameError: if there is no such robot, or its table names a joint, link or frame that it lacks.
    """
    return _load_robot(name if name in robot_names() else str(table_file(name)))


@functools.cache
def _load_robot(name: str) -> Robot:
    table, file = robot_table(name), table_file(name)
    own = models_dir() not in file.parents or file.stem not in SHIPPED
    if own and (found := table_problems(table)):
        raise ModelError(f"{file}: {'; '.join(found)}")
    robot = _robot_of(name, table, file)
    if own:
        runpy.run_path(str(models_dir() / "build.py"))["write"](name)
    return robot


RobotName = Annotated[str, AfterValidator(refusing(lambda name: load_robot(name).name))]
"""The name of a robot, or the path of its table, which becomes absolute."""


def _robot_of(name: str, table: Mapping[str, Any], file: pathlib.Path) -> Robot:
    joints, roles = table["joints"], table["roles"]
    names = [joint["name"] for joint in joints]
    feet, hands = ((roles[part], other_side(roles[part])) for part in ("foot", "hand"))
    parts = {**roles["leg"], **roles["arm"]}
    children = {joint["name"]: joint["child"] for joint in joints}
    links = {part: children[name] for part, name in parts.items()}

    def indices(of: Sequence[str]) -> np.ndarray:
        return np.array([names.index(name) for name in of])

    def seen_from(part: str, link: str) -> np.ndarray:
        return placement(joints, link, links[part])[0]

    def column(key: str) -> np.ndarray:
        return frozen([joint[key] for joint in joints])

    ranges = column("range")
    hand_tip, hand_half_width = _hand_size(table, links["elbow"])
    return Robot(
        name=name,
        xml_path=file.with_name(f"{table['name']}.xml"),
        urdf_path=file.with_name(f"{table['name']}.urdf"),
        mass=math.fsum(link["mass"] for link in table["links"]),
        joint_names=tuple(names),
        lower=frozen(ranges[:, 0]),
        upper=frozen(ranges[:, 1]),
        velocity_limit=column("velocity"),
        torque_limit=frozen(np.minimum(column("effort"), column("policy_torque_limit"))),
        kp=column("kp"),
        kd=column("kd"),
        nominal=column("nominal"),
        axes=column("axis"),
        base_axes=frozen([placement(joints, row["child"], roles["base"])[1] @ row["axis"] for row in joints]),
        armature=column("armature"),
        damping=frozen([table["damping"]] * len(joints)),
        friction=column("friction"),
        viscous=column("viscous"),
        corner_speed=column("corner_speed"),
        command_delay=float(table["command_delay"]),
        nominal_height=float(table["nominal_height"]),
        base=roles["base"],
        trunk=roles["trunk"],
        imu_link=table["imu"]["parent"],
        camera=frozen(table["camera"]["xyz"]),
        foot_links=feet,
        hand_links=hands,
        legs=indices([side(name) for side in (str, other_side) for name in roles["leg"].values()]),
        arms=indices([side(name) for side in (str, other_side) for name in roles["arm"].values()]),
        waist=names.index(roles["waist"]["yaw"]),
        pairs={part: indices([name, other_side(name)]) for part, name in parts.items()},
        moved={part: (children[name], children[other_side(name)]) for part, name in parts.items()},
        sole_x=tuple(table["sole"]["x"]),
        sole_y=tuple(table["sole"]["y"]),
        sole_z=float(table["sole"]["z"]),
        sole_depth=-float(seen_from("ankle_pitch", feet[0])[2] + table["sole"]["z"]),
        ankle_x=-float(seen_from("ankle_pitch", feet[0])[0]),
        thigh=math.hypot(*_from_the_side(seen_from("hip_pitch", links["knee"]), joints, links["hip_pitch"], roles)),
        shank=math.hypot(*seen_from("knee", links["ankle_pitch"])[::2].tolist()),
        shoulder=frozen(placement(joints, links["shoulder_roll"], roles["base"])[0]),
        upper_arm=float(np.linalg.norm(seen_from("shoulder_roll", links["elbow"]))),
        forearm=math.hypot(*placement(joints, hands[0], links["elbow"], table["hand"]["xyz"])[0].tolist()),
        hands=frozen(on_both_sides(table["hand"]["xyz"])),
        hand_tip=hand_tip,
        hand_half_width=hand_half_width,
        leg_postures={key: frozen(value) for key, value in table["leg_postures"].items()},
        arm_postures={key: frozen(value) for key, value in table["arm_postures"].items()},
        arm_kp=frozen(2 * table["arm_servo"]["kp"]),
        arm_kd=frozen(2 * table["arm_servo"]["kd"]),
        squat_heights=tuple(table["squat"]["heights"]),
        squat_reach=tuple(table["squat"]["reach"]),
        squat_reach_per_pitch=float(table["squat"]["reach_per_pitch"]),
        level_shank=float(table["squat"]["level_shank"]),
        collision_pairs=frozenset(map(frozenset, table["collision_pairs"])),
        capsules={link: tuple(Capsule(**shape) for shape in shapes) for link, shapes in table["capsules"].items()},
        contact_links=tuple(table["contact_links"]),
        qp=dict(table.get("qp", {})),
        commands={name: _ranges(name, ranges) for name, ranges in table.get("commands", {}).items()},
    )


def _hand_size(table: Mapping[str, Any], elbow: str) -> tuple[float, float]:
    """Return how far the left hand reaches ahead of its frame, and to its side [m]; 0 without a collision shape.

    With all joints at 0, ahead is the axis of the hand's link that is nearest to the line from the elbow to the hand;
    the side is that one of its other two axes that is nearest to the base's y axis.
    """
    joints, hand, place = table["joints"], table["roles"]["hand"], table["hand"]["xyz"]
    box = next((link.get("collision_box") for link in table["links"] if link["name"] == hand), None)
    if box is None:
        return 0.0, 0.0
    forearm, axes = placement(joints, hand, elbow, place)
    along = forearm @ axes
    ahead = int(np.abs(along).argmax())
    lateral = np.abs(placement(joints, hand, table["roles"]["base"])[1][1])
    aside = int(np.where(np.arange(3) == ahead, -1.0, lateral).argmax())
    middle, half = np.subtract(box["center"], place), np.array(box["size"]) / 2.0
    tip = math.copysign(1.0, along[ahead]) * middle[ahead] + half[ahead]
    return round(float(tip), 6), round(float(abs(middle[aside]) + half[aside]), 6)  # micrometres: sums of decimals


def on_both_sides(place: Sequence[float]) -> np.ndarray:
    """Return a place in the frame of a left link and its mirror image in that of the right one, shape (2, 3)."""
    x, y, z = place
    return np.array([[x, y, z], [x, 0.0 - y, z]])


def _ranges(command: str, ranges: Mapping[str, Sequence[float]]) -> dict[str, tuple[float, float]]:
    """Return a table's own ranges of a command, checked."""
    checked, least = {}, 0.0 if command in ("f", "l") else -math.inf
    for kind, (low, high) in ranges.items():
        speed = command in ("v_x", "v_y", "omega")
        if not least < low <= high < math.inf or (speed and not low <= 0.0 <= high):
            raise ModelError(
                f"commands has {command} from {low:g} to {high:g}; give finite ends, low first, f and l above 0, "
                "and speeds with 0 between, which a stand needs"
            )
        checked[kind] = float(low), float(high)
    return checked


@dataclasses.dataclass(frozen=True, eq=False)
class Mirror:
    """Every joint's mirror image in the x-z plane: mirrored = vector[joint_index] * joint_sign."""

    joint_index: np.ndarray  # of each joint's partner, which has the other side in its name, shape (n,)
    joint_sign: np.ndarray  # +1 or -1, shape (n,)

    def joints(self, vector: np.ndarray) -> np.ndarray:
        """Mirror joint positions, velocities, torques or actions, shape (..., n)."""
        return vector[..., self.joint_index] * self.joint_sign

    def arms(self, vector: np.ndarray, robot: Robot) -> np.ndarray:
        """Mirror a vector of the k arm joints, shape (..., k)."""
        full = np.zeros((*vector.shape[:-1], len(robot.joint_names)))
        full[..., robot.arms] = vector
        return self.joints(full)[..., robot.arms]


@functools.lru_cache(maxsize=64)  # robots of models that are not ours are new each time
def load_mirror(robot: Robot) -> Mirror:
    """Return the mirror map of a robot, from its joints' names and axes.

    A joint about y keeps its sign and a joint about x or z changes it, because the axis is an axial vector.
    """
    index = robot.indices([other_side(name) for name in robot.joint_names])
    # The mirrored joint's own axis is that at its index; the reflected axis of this joint is AXIAL_SIGNS * axis.
    sign = np.sum(AXIAL_SIGNS * robot.base_axes * robot.base_axes[index], axis=1)
    return Mirror(index, np.where(sign < 0.0, -1.0, 1.0))  # also of joints in no role that are no mirror images

"""The robot model of the inverse kinematics: moving arms, waist and hips, and capsules that must not touch."""

import xml.etree.ElementTree as ElementTree

import pinocchio as pin
import placo

from hugwbc.robot import SIDES, Robot

# Capsules around the model's collision boxes, along z or x of the link frame: centre, radius, length of the axis [m].
# Distances of capsules have a closed form and take half the time of those of cylinders, which need an iteration.
_CHEST = [((0.0, y, 0.235), 0.075, 0.255) for y in (0.05, -0.05)]
_HEAD = ((0.03, 0.0, 0.58), 0.085, 0.075)
_THIGH = ((0.03, 0.0, -0.18), 0.05, 0.31)
_FOREARM = ((0.17, 0.0, -0.013), 0.035, 0.185)
_FOREARM_LINK = "elbow_link"
_SHAPES = {
    "torso_link": [*_CHEST, _HEAD],
    **{f"{side}_hip_pitch_link": [_THIGH] for side in SIDES},
    **{f"{side}_{_FOREARM_LINK}": [_FOREARM] for side in SIDES},
}
HIP_NAMES = tuple(f"{side}_hip_{part}_joint" for side in SIDES for part in ("yaw", "roll", "pitch"))
HEIGHT_JOINT, PITCH_JOINT = "column_height", "column_pitch"


def upper_body(robot: Robot, *, on_column: bool = False) -> placo.RobotWrapper:
    """Build placo's model of the robot with arms, waist and hips; knees and ankles are fixed.

    Collision pairs are each forearm with the chest, the head, both thighs and the other forearm.

    Args:
        robot: gives names and description.
        on_column: whether to add two joints by which the pelvis moves up and down and pitches.
    """
    root = ElementTree.parse(robot.urdf_path).getroot()
    for link in root.findall("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            link.remove(shape)
        name = str(link.get("name"))
        shapes = _SHAPES.get(name, [])
        # URDF has no capsules; Pinocchio turns the cylinders that are named here into capsules.
        capsules = ElementTree.SubElement(link, "collision_checking")
        for number, (centre, radius, length) in enumerate(shapes):
            collision = ElementTree.SubElement(link, "collision", name=f"{name}_{number}")
            ElementTree.SubElement(capsules, "capsule", name=f"{name}_{number}")
            turn = "0 1.570796 0" if name.endswith(_FOREARM_LINK) else "0 0 0"
            ElementTree.SubElement(collision, "origin", xyz=" ".join(map(str, centre)), rpy=turn)
            geometry = ElementTree.SubElement(collision, "geometry")
            ElementTree.SubElement(geometry, "cylinder", radius=str(radius), length=str(length))
    stiff = {robot.joint_names[index] for index in robot.legs} - set(HIP_NAMES)
    for joint in root.findall("joint"):
        if joint.get("name") in stiff:
            joint.set("type", "fixed")
    if on_column:
        _put_on_column(root)
    wrapper = placo.RobotWrapper("h1", 0, ElementTree.tostring(root, encoding="unicode"))
    _keep_forearm_pairs(wrapper.collision_model)
    return wrapper


def _put_on_column(root: ElementTree.Element) -> None:
    for parent, child, name, kind, axis in (
        ("column", "carriage", HEIGHT_JOINT, "prismatic", "0 0 1"),
        ("carriage", "pelvis", PITCH_JOINT, "revolute", "0 1 0"),
    ):
        ElementTree.SubElement(root, "link", name=parent)
        joint = ElementTree.SubElement(root, "joint", name=name, type=kind)
        ElementTree.SubElement(joint, "parent", link=parent)
        ElementTree.SubElement(joint, "child", link=child)
        ElementTree.SubElement(joint, "axis", xyz=axis)
        ElementTree.SubElement(joint, "limit", lower="-1", upper="1", velocity="1", effort="1")


def _keep_forearm_pairs(model: pin.GeometryModel) -> None:
    names = [geometry.name for geometry in model.geometryObjects]
    pairs = [(pair.first, pair.second) for pair in model.collisionPairs]
    for first, second in pairs:
        if _FOREARM_LINK not in names[first] + names[second]:
            model.removeCollisionPair(pin.CollisionPair(first, second))


class Clearance:
    """The distances of the forearms to everything that they could touch, at the posture of a placo model."""

    def __init__(self, wrapper: placo.RobotWrapper) -> None:
        self._wrapper = wrapper
        names = [geometry.name for geometry in wrapper.collision_model.geometryObjects]
        pairs = [(names[pair.first], names[pair.second]) for pair in wrapper.collision_model.collisionPairs]
        self._of_arm = [
            [i for i, pair in enumerate(pairs) if any(name.startswith(f"{side}_{_FOREARM_LINK}") for name in pair)]
            for side in SIDES
        ]

    def __call__(self) -> list[float]:
        """Return the least distance of the left and the right forearm, negative in a collision [m]."""
        distances = [pair.min_distance for pair in self._wrapper.distances()]
        return [min([distances[i] for i in pairs]) for pairs in self._of_arm]

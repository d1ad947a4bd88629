"""The robot model of the inverse kinematics: moving arms, waist and hips, and capsules that must not touch."""

import xml.etree.ElementTree as ElementTree

import pinocchio as pin
import placo

from hugwbc.robot import SIDES, Robot

_FOREARM_LINK = "elbow_link"
_TURNS = {"x": "0 1.570796 0", "z": "0 0 0"}  # from the z axis of a cylinder in a URDF
HIP_NAMES = tuple(f"{side}_hip_{part}_joint" for side in SIDES for part in ("yaw", "roll", "pitch"))
HEIGHT_JOINT, PITCH_JOINT = "column_height", "column_pitch"


def upper_body(robot: Robot, *, on_column: bool = False) -> placo.RobotWrapper:
    """Build placo's model of the robot with arms, waist and hips; knees and ankles are fixed.

    The robot's capsules stand for its shape: their distances have a closed form and take half the time of those of
    cylinders, which need an iteration. Collision pairs are each forearm with the chest, the head, both thighs and the
    other forearm.

    Args:
        robot: gives names, description and capsules.
        on_column: whether to add two joints by which the pelvis moves up and down and pitches.
    """
    root = ElementTree.parse(robot.urdf_path).getroot()
    for link in root.findall("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            link.remove(shape)
        name = str(link.get("name"))
        # URDF has no capsules; Pinocchio turns the cylinders that are named here into capsules.
        capsules = ElementTree.SubElement(link, "collision_checking")
        for number, capsule in enumerate(robot.capsules.get(name, ())):
            collision = ElementTree.SubElement(link, "collision", name=f"{name}_{number}")
            ElementTree.SubElement(capsules, "capsule", name=f"{name}_{number}")
            xyz = " ".join(map(str, capsule.pos))
            ElementTree.SubElement(collision, "origin", xyz=xyz, rpy=_TURNS[capsule.axis])
            geometry = ElementTree.SubElement(collision, "geometry")
            ElementTree.SubElement(geometry, "cylinder", radius=str(capsule.radius), length=str(capsule.length))
    stiff = {robot.joint_names[index] for index in robot.legs} - set(HIP_NAMES)
    for joint in root.findall("joint"):
        if joint.get("name") in stiff:
            joint.set("type", "fixed")
    if on_column:
        _put_on_column(root)
    wrapper = placo.RobotWrapper(robot.name, 0, ElementTree.tostring(root, encoding="unicode"))
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

"""The robot model of the inverse kinematics: moving arms, waist and hips, and shapes that must not touch."""

import itertools
import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable

import coal
import numpy as np
import pinocchio as pin
import placo

from hugwbc.kinematics import place_frames
from hugwbc.robot import SIDES, Robot

_WIDEST = 0.07  # [m]; a box that is wider gets several capsules side by side
_ROUND = 1.03  # ratio of a capsule's radius to the distance of the box's edges: a little wider, but shorter at its ends
HEIGHT_JOINT, PITCH_JOINT = "column_height", "column_pitch"


def still_names(robot: Robot) -> tuple[str, ...]:
    """Return the names of the joints that stay where they are measured: six of the hips, and those in no chain."""
    pairs = [robot.pair(part) for part in ("hip_yaw", "hip_roll", "hip_pitch")]
    hips = [pair[side] for side in range(len(SIDES)) for pair in pairs]
    return tuple(robot.joint_names[index] for index in (*hips, *robot.held))


def upper_body(robot: Robot, *, on_column: bool = False) -> placo.RobotWrapper:
    """Build placo's model of the robot with arms, waist and hips; knees and ankles are fixed.

    Its shapes are capsules around the collision boxes of the simulated robot, and the robot's capsules around what has
    none. (Boxes themselves would be exact, but the nearest points of two parallel faces jump from edge to edge, and
    the arms chatter.) Its collision pairs are those of the robot's table in which an arm takes part.

    Args:
        robot: gives names, description, capsules and collision pairs.
        on_column: whether to add two joints by which the pelvis moves up and down and pitches.
    """
    root = ElementTree.parse(robot.urdf_path).getroot()  # noqa: S314  the user's
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
    stiff = {robot.joint_names[index] for index in robot.legs} - set(still_names(robot))
    for joint in root.findall("joint"):
        if joint.get("name") in stiff:
            joint.set("type", "fixed")
    if on_column:
        _put_on_column(root, robot.base)
    described = ElementTree.tostring(root, encoding="unicode")
    for link in root.findall("link"):  # placo would warn of boxes that overlap, such as those of two neighbours
        for collision in link.findall("collision"):
            link.remove(collision)
    wrapper = placo.RobotWrapper(robot.name, 0, ElementTree.tostring(root, encoding="unicode"))
    place_frames(wrapper.model, robot)
    _turn_hands(wrapper.model)
    boxes = pin.buildGeomFromUrdfString(wrapper.model, described, pin.GeometryType.COLLISION)
    _set_shapes(wrapper, robot, boxes.geometryObjects)
    return wrapper


def _turn_hands(model: pin.Model) -> None:
    """Turn the hand frames so that they have the pelvis's axes when all joints are at 0, whatever their links have."""
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    for side in SIDES:
        frame = model.frames[model.getFrameId(f"{side}_hand", pin.FrameType.BODY)]
        frame.placement.rotation = data.oMi[frame.parentJoint].rotation.T


def _put_on_column(root: ElementTree.Element, base: str) -> None:
    for parent, child, name, kind, axis in (
        ("column", "carriage", HEIGHT_JOINT, "prismatic", "0 0 1"),
        ("carriage", base, PITCH_JOINT, "revolute", "0 1 0"),
    ):
        ElementTree.SubElement(root, "link", name=parent)
        joint = ElementTree.SubElement(root, "joint", name=name, type=kind)
        ElementTree.SubElement(joint, "parent", link=parent)
        ElementTree.SubElement(joint, "child", link=child)
        ElementTree.SubElement(joint, "axis", xyz=axis)
        ElementTree.SubElement(joint, "limit", lower="-1", upper="1", velocity="1", effort="1")


def _set_shapes(wrapper: placo.RobotWrapper, robot: Robot, boxes: Iterable[pin.GeometryObject]) -> None:
    model, frames = wrapper.collision_model, wrapper.model.frames
    capsules = [(box.parentFrame, *shape) for box in boxes for shape in _around(box.placement, box.geometry)]
    for link, shapes in robot.capsules.items():
        frame = wrapper.model.getFrameId(link, pin.FrameType.BODY)
        for shape in shapes:
            place = frames[frame].placement * pin.SE3(np.eye(3), np.array(shape.pos))
            capsules.append((frame, place, coal.Capsule(shape.radius, shape.length)))
    for number, (frame, place, capsule) in enumerate(capsules):
        name, joint = f"{frames[frame].name}_{number}", frames[frame].parentJoint
        model.addGeometryObject(pin.GeometryObject(name, joint, frame, place, capsule))
    links = [frames[frame].name for frame, *_ in capsules]
    arms = [_arm_joint(wrapper.model, frames[frame].parentJoint, robot) for frame, *_ in capsules]
    for first, second in itertools.combinations(range(len(links)), 2):
        if {links[first], links[second]} in robot.collision_pairs and (arms[first] or arms[second]):
            model.addCollisionPair(pin.CollisionPair(first, second))


def _arm_joint(model: pin.Model, joint: int, robot: Robot) -> str:
    """Return the name of the arm joint that moves a joint, or is it; empty if none does."""
    while joint and model.names[joint] not in robot.arm_names:
        joint = model.parents[joint]
    return model.names[joint] if joint else ""


def _around(place: pin.SE3, box: coal.Box) -> list[tuple[pin.SE3, coal.Capsule]]:
    """Return capsules along a box's longest side that enclose it together, and their placements."""
    half = np.array(box.halfSide)
    axis = int(half.argmax())
    cells = np.ceil(2.0 * half / _WIDEST - 1e-9).astype(int)
    cells[axis] = 1
    corner = float(np.linalg.norm(np.delete(half / cells, axis)))  # the corners' distance from a capsule's axis
    length = max(2.0 * (half[axis] - corner * np.sqrt(_ROUND**2 - 1.0)), 0.0)
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), np.eye(3)[axis]).matrix()
    middles = [half * ((2.0 * np.array(cell) + 1.0) / cells - 1.0) for cell in np.ndindex(*cells)]
    return [(place * pin.SE3(turn, middle), coal.Capsule(_ROUND * corner, float(length))) for middle in middles]


class Clearance:
    """The distances of the arms to everything that they could touch, at the posture of a placo model.

    Attributes:
        between: least distance of the arms to each other at the last call, negative in a collision [m].
    """

    def __init__(self, wrapper: placo.RobotWrapper, robot: Robot) -> None:
        self._wrapper = wrapper
        shapes = wrapper.collision_model.geometryObjects
        moved_by = [_arm_joint(wrapper.model, shape.parentJoint, robot) for shape in shapes]
        pairs = [{moved_by[pair.first], moved_by[pair.second]} for pair in wrapper.collision_model.collisionPairs]
        arms = np.array(robot.arm_names).reshape(len(SIDES), -1).tolist()
        self._of_arm = [[i for i, pair in enumerate(pairs) if not pair.isdisjoint(arm)] for arm in arms]
        self._of_both = sorted(set(self._of_arm[0]).intersection(self._of_arm[1]))

    def __call__(self) -> list[float]:
        """Return the least distance of the left and the right arm, negative in a collision [m]."""
        distances = [pair.min_distance for pair in self._wrapper.distances()]
        self.between = min([distances[i] for i in self._of_both], default=math.inf)
        return [min([distances[i] for i in pairs], default=math.inf) for pairs in self._of_arm]

"""What a robot's table need not say: a published description gives links and joints, and the rest follows from them."""

import contextlib
import math
import pathlib
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hugwbc import rotations
from hugwbc.errors import ModelError, UnknownNameError

SIDES = ("left", "right")
_OTHER = {"left": "right", "Left": "Right", "l": "r", "L": "R"}
_OTHER |= {right: left for left, right in _OTHER.items()}
_SIDE = re.compile("[Ll]eft|[Rr]ight|(?<![A-Za-z])[lrLR](?![A-Za-z])")
_PAGE = "docs/how-to/add-a-robot.md"
Joints = Sequence[Mapping[str, Any]]
# What a drive is taken for where neither table nor description says it, after the drives of the H1 and the G1: armature
# [s^2/rad] and Coulomb friction by torque limit, viscous friction by the latter [s/rad], corner speed by highest speed.
_ARMATURE, _FRICTION, _VISCOUS, _CORNER = 2e-4, 0.02, 0.1, 0.5
# Gains by armature: a natural frequency of 10 Hz, and twice the critical damping.
_FREQUENCY, _DAMPING = 20.0 * math.pi, 2.0
LEAST_ERROR = 0.05  # [rad]; a drive that gives all its torque for less is a switch
LEAST_SPEED = 0.1  # the same limit for damping: least speed for all the torque, as a part of the highest speed
# Stiffness of arms under external control by torque limit [1/rad], its bounds [N m/rad], and damping by stiffness [s].
_SERVO, _SERVO_KP, _SERVO_TIME = 3.5, (40.0, 140.0), 0.0375
_SQUATS = (-0.30, -0.25, -0.20, -0.10, 0.0)  # [m], heights of the squats of a robot of `_SQUATTER` nominal height
_SQUATTER = 0.98
_TURNED = 2.0  # [degrees], of the IMU's frame in its link, which nothing corrects
_ANKLE_ROOM, _LEVEL_ROOM = 0.02, 0.07  # [rad], room to the ankle's limit in a squat, and with a sole kept level
# Postures by part [rad], cut to the joints' ranges; the rest of the limb is at its nominal one.
_TUCKED = {"hip_pitch": -1.0, "knee": 1.9, "ankle_pitch": -0.82}
_ARMS = {
    "hanging": {"shoulder_pitch": 0.0, "shoulder_roll": 0.2},
    "overhead": {"shoulder_pitch": -2.6, "shoulder_roll": 0.3},
    "forward": {"shoulder_pitch": -1.4, "shoulder_roll": 0.2},
    "backward": {"shoulder_pitch": 1.5, "shoulder_roll": 0.2},
}
# The parts that the code asks for; a leg may have an `ankle_roll` and an arm more joints.
_PARTS = {
    "leg": ("hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle_pitch"),
    "arm": ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow"),
    "waist": ("yaw",),
}
# Contact shapes of every robot, alike in both engines.
FRICTION = 0.8  # of soles and links
# The spheres at the corners of a sole are small, so that the robot tips over within 5 mm of the sole's edges.
SOLE_RADIUS = 0.005  # [m]
FOOT_BOX_HALF, FOOT_BOX_MIDDLE = 0.02, 0.03  # [m], half height of the box on a sole, and height of its middle above it
START_GAP = 0.002  # [m], between soles and ground at the start, free of penetration
_COLOURS = {"dark": [0.11, 0.12, 0.14, 1], "light": [0.80, 0.82, 0.84, 1]}


def other_side(name: str) -> str:
    """Return the name of the joint, link or frame on the other side; the same name where it says no side."""
    return _SIDE.sub(lambda side: _OTHER[side[0]], name, count=1)


def is_left(name: str) -> bool:
    """Return whether a joint, link or frame is on the left side, by its name."""
    return (side := _SIDE.search(name)) is not None and side[0][0] in "lL"


def mirrored(joint: Mapping[str, Any], other: Mapping[str, Any]) -> float:
    """Return +1 or -1, the sign that a joint's position gets on its mirror image, by their axes (axial vectors)."""
    return math.copysign(1.0, float(np.dot(np.multiply([-1, 1, -1], joint["axis"]), other["axis"])))


def placement(
    joints: Joints,
    link: str,
    seen_from: str,
    point: Sequence[float] = (0.0, 0.0, 0.0),
    q: Mapping[str, float] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return place and axes of a link (or of a point of it), seen from a link above it.

    Args:
        joints: rows of a table.
        link: its name.
        seen_from: name of the other link.
        point: in the link's frame [m].
        q: joint positions by name [rad]; None for all at 0.

    Returns:
        Place [m], shape (3,), and the link's axes as columns, shape (3, 3).

    Raises:
        ModelError: if the link does not hang below the other one.
    """
    if link == seen_from:
        return np.array(point), np.eye(3)
    joint = next((joint for joint in joints if joint["child"] == link), None)
    if joint is None:
        raise ModelError(
            f"{link} does not hang below {seen_from}, which a role says; `roles` names links and joints, and a "
            f"description whose legs hang below the trunk has to be turned over ({_PAGE})"
        )
    place, axes = placement(joints, joint["parent"], seen_from, q=q)
    place, axes = place + axes @ joint["xyz"], axes @ _turn(*joint["rpy"])
    if q and q[joint["name"]]:
        axes = axes @ rotations.to_matrix(rotations.from_axis_angle(np.array(joint["axis"]), q[joint["name"]]))
    return place + axes @ point, axes


def _turn(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Return the axes that URDF's angles describe, shape (3, 3)."""
    (a, b, c), (d, e, f) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    about_x = np.array([[1, 0, 0], [0, a, -d], [0, d, a]])
    about_y = np.array([[b, 0, e], [0, 1, 0], [-e, 0, b]])
    about_z = np.array([[c, -f, 0], [f, c, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def _image(change: Mapping[str, Any], sign: float) -> dict[str, Any]:
    """Return the mirror image of corrections of a link or of a joint, whose position changes by `sign` (`mirrored`)."""
    image = dict(change)
    for key, signs in {"com": (1, -1, 1), "xyz": (1, -1, 1), "rpy": (-1, 1, -1), "axis": (-sign, sign, -sign)}.items():
        if key in change:
            image[key] = [one * value for one, value in zip(signs, change[key], strict=True)]
    image.update({key: -change[key] for key in ("ixy", "iyz") if key in change})
    if "nominal" in change:
        image["nominal"] = sign * change["nominal"]
    if "range" in change:
        image["range"] = sorted(sign * limit for limit in change["range"])
    if box := change.get("collision_box"):
        x, y, z = box["center"]
        image["collision_box"] = {**box, "center": [x, -y, z]}
    return image


def describe(table: dict[str, Any], description: pathlib.Path) -> None:
    """Give a table, in place, the links, joints, frames and nominal positions of a robot with a description."""
    from hugwbc.description import read_description  # MuJoCo is not needed by robots without one

    read = read_description(description)
    frames = {**read["frames"], **{link["name"]: {"parent": link["name"], "xyz": [0.0] * 3} for link in read["links"]}}
    for name in (table["roles"].get(role) for role in ("base", "trunk", "foot", "hand")):
        if (carrier := frames.get(name, {}).get("parent", name)) != name:
            raise ModelError(f"{name} is fixed to {carrier}; roles take links that a joint moves: give {carrier}")
    for kind in ("joints", "links"):
        changes = table.get(kind, {})
        for name in changes:
            if name not in (names := [row["name"] for row in read[kind]]):
                raise UnknownNameError(f"name under {kind}", name, names)
        rows = {row["name"]: row for row in read[kind]}
        for name, row in rows.items():
            if is_left(left := other_side(name)) and left in changes:
                row.update(_image(changes[left], mirrored(rows[left], row) if kind == "joints" else 1.0))
        table[kind] = [{**row, **changes.get(row["name"], {})} for row in read[kind]]
    check_roles(table)
    left = [name for limb in ("leg", "arm", "waist") for name in table["roles"][limb].values()]
    if coupled := sorted(read["coupled"] & {*left, *map(other_side, left)}):
        raise ModelError(
            f"{', '.join(coupled)} in the roles follow other joints or lead them (<mimic>, <equality>), and in a table "
            "each joint has a drive of its own; take that out of the description where the robot allows it"
        )
    for part, carriers in (("imu", ("base", "trunk")), ("camera", ("trunk",)), ("hand", ("hand",))):
        links = [table["roles"][carrier] for carrier in carriers]
        if isinstance(name := table.setdefault(part, links[0]), str):
            if name not in frames:
                raise UnknownNameError(f"frame of {description}", name, frames)
            table[part] = frames[name]
        if (parent := table[part].setdefault("parent", links[0])) not in links:
            fixed = f", which is fixed to {frames[parent]['parent']}" * (parent in read["frames"])
            raise ModelError(f"{part} is on {parent}{fixed}; give a frame of {' or '.join(links)}")
        turned = table[part].pop("turned", 0.0)
        if part == "imu" and turned > _TURNED:
            raise ModelError(
                f"the frame of the IMU is turned by {turned:.0f} degrees in {parent}; give one with its link's axes, "
                f"such as imu: {{parent: {parent}, xyz: [0, 0, 0.1]}}"
            )
    by_name = {joint["name"]: joint for joint in table["joints"]}
    pose = {name: joint["nominal"] for name, joint in by_name.items() if "nominal" in joint} | table.get("nominal", {})
    for name in pose:
        if name not in by_name:
            raise UnknownNameError("joint under nominal", name, by_name)
    for name, joint in by_name.items():
        other = by_name.get(other_side(name), joint)
        joint["nominal"] = float(pose.get(name, mirrored(other, joint) * pose.get(other["name"], 0.0))) + 0.0


def check_roles(table: Mapping[str, Any]) -> None:
    """Refuse roles that are missing, or that no link or joint of a table plays."""
    roles, found = table["roles"], []
    played = [(part, roles.get(part), "link", part in ("foot", "hand")) for part in ("base", "trunk", "foot", "hand")]
    for limb, parts in _PARTS.items():
        given = roles.get(limb) or {}
        played += [
            (f"{limb}: {part}", given.get(part), "joint", limb != "waist") for part in dict.fromkeys((*parts, *given))
        ]
    for role, name, kind, paired in played:
        names = sorted(row["name"] for row in table[f"{kind}s"])
        if name is None:
            none = f"; where there is none, put in one that is stuck ({_PAGE})" * (kind == "joint")
            found.append(f"roles lacks `{role}`; give the name of the {kind}{' on the left side' * paired}{none}")
        elif paired and not is_left(name):
            found.append(
                f"`{role}` is {name}, which is not of the left side; give the {kind} with left, or l, in its name"
            )
        else:
            absent = {name, other_side(name) if paired else name} - {*names}
            found += [str(UnknownNameError(f"{kind} in the role `{role}`,", one, names)) for one in sorted(absent)]
    if held := [name for part, name in (roles.get("waist") or {}).items() if part not in _PARTS["waist"]]:
        found.append(f"the waist moves by yaw alone; leave {', '.join(held)} out of the roles, and its drive holds it")
    if found:
        raise ModelError("; ".join(found))


def complete(table: dict[str, Any], description: pathlib.Path | None) -> None:
    """Give a table, in place, what follows from its links and joints, and its description, where it does not say it."""
    roles, joints = table["roles"], table["joints"]
    _check_rings(joints)
    if description is not None:
        from hugwbc.description import collision_boxes, measure_sole

        if "sole" not in table:
            table["sole"] = measure_sole(description, roles["foot"])
        _shape(table, collision_boxes(description))
    _set_gains(table)
    table.setdefault("damping", 0.001)
    table.setdefault("command_delay", 0.002)
    if "nominal_height" not in table:
        q = {joint["name"]: joint["nominal"] for joint in joints}
        sole = placement(joints, roles["foot"], roles["base"], [0.0, 0.0, table["sole"]["z"]], q)[0]
        table["nominal_height"] = math.ceil(-1e3 * sole[2]) / 1e3
    if "squat" not in table:
        table["squat"] = _squat(table)
    by_name = {joint["name"]: joint for joint in joints}

    def posture(limb: str, given: Mapping[str, float]) -> list[float]:
        parts = {part: by_name[name] for part, name in roles[limb].items()}
        wanted = {part: joint["nominal"] for part, joint in parts.items()}
        for part, angle in given.items():  # about +x or +y of the base; arms may turn the other way
            axis = placement(joints, parts[part]["child"], roles["base"])[1] @ parts[part]["axis"]
            wanted[part] = math.copysign(angle, angle * axis[0 if part.endswith("roll") else 1])
        return [min(max(wanted[part], joint["range"][0]), joint["range"][1]) for part, joint in parts.items()]

    efforts = [by_name[name]["effort"] for name in roles["arm"].values()]
    kp = [min(max(_SERVO * effort, _SERVO_KP[0]), _SERVO_KP[1]) for effort in efforts]
    table.setdefault("arm_servo", {"kp": kp, "kd": [_SERVO_TIME * one for one in kp]})
    table.setdefault("leg_postures", {"tucked": posture("leg", _TUCKED)})
    table.setdefault("arm_postures", {kind: posture("arm", given) for kind, given in _ARMS.items()})


def _check_rings(joints: Joints) -> None:
    """Refuse joints that carry each other."""
    parents = {joint["child"]: joint["parent"] for joint in joints}
    for link in parents:
        above = link
        for _ in parents:
            above = parents.get(above, above)
        if above in parents:  # nothing carries the base
            raise ModelError(f"the joints above {link} carry each other in a ring; one of them has a wrong parent")


def complete_drive(joint: dict[str, Any]) -> None:
    """Give a joint of a description the figures of its drive that neither it nor the table says."""
    joint.setdefault("armature", _ARMATURE * joint["effort"])
    joint.setdefault("friction", _FRICTION * joint["effort"])
    joint.setdefault("viscous", _VISCOUS * joint["friction"])
    joint.setdefault("corner_speed", _CORNER * joint["velocity"])


def _set_gains(table: dict[str, Any]) -> None:
    """Give the joints the gains that the table does not say, for the inertia of their rotors, or of what they carry.

    A joint in no role holds what it carries by its gains alone; for the joints in roles, the controller adds torques.
    """
    joints, roles = table["joints"], table["roles"]
    q = {joint["name"]: joint["nominal"] for joint in joints}
    led = {side(name) for limb in _PARTS for name in roles[limb].values() for side in (str, other_side)}
    for joint in joints:
        kp, kd = joint["armature"] * _FREQUENCY**2, 2.0 * _DAMPING * joint["armature"] * _FREQUENCY
        if joint["name"] not in led and not {"kp", "kd"} <= joint.keys():
            inertia = joint["armature"] + _carried(table, joint, q)
            effort, speed = joint["effort"], joint["velocity"]  # the check names joints that have none
            kp = min(inertia * _FREQUENCY**2, effort / LEAST_ERROR if effort > 0.0 else math.inf)
            highest = effort / (LEAST_SPEED * speed) if min(effort, speed) > 0.0 else math.inf
            kd = min(max(kd, 2.0 * math.sqrt(kp * inertia)), highest)
        joint.setdefault("kp", kp)
        joint.setdefault("kd", kd)


def _carried(table: Mapping[str, Any], joint: Mapping[str, Any], q: Mapping[str, float]) -> float:
    """Return the inertia of all links that a joint moves about its axis, at joint positions q [rad] [kg m^2]."""
    total, axis = 0.0, np.array(joint["axis"])
    for link in table["links"]:
        with contextlib.suppress(ModelError):  # of a link that the joint does not move
            place, axes = placement(table["joints"], link["name"], joint["child"], link["com"], q)
            (a, b, c), arm = axes.T @ axis, np.cross(axis, place)
            turned = link["ixx"] * a * a + link["iyy"] * b * b + link["izz"] * c * c
            turned += 2.0 * (link["ixy"] * a * b + link["ixz"] * a * c + link["iyz"] * b * c)
            total += link["mass"] * float(arm @ arm) + turned
    return total


def _shape(table: dict[str, Any], boxes: Mapping[str, Mapping[str, list[float]]]) -> None:
    """Give links without shapes these boxes, or boxes of the links' inertia, to draw and to collide with."""
    roles, joints = table["roles"], {joint["name"]: joint for joint in table["joints"]}
    # The names of links need no side, but for feet and hands.
    knees, elbows = (
        [joints[side(name)] for side in (str, other_side)] for name in (roles["leg"]["knee"], roles["arm"]["elbow"])
    )
    thighs, shanks = ([knee[end] for knee in knees] for end in ("parent", "child"))
    forearms = [elbow["child"] for elbow in elbows]
    hands, feet = ([roles[part], other_side(roles[part])] for part in ("hand", "foot"))
    solid = {roles["trunk"], *thighs, *shanks, *forearms, *hands}
    visuals = table.setdefault("visuals", {})
    for link in table["links"]:
        moments = np.array([link["ixx"], link["iyy"], link["izz"]])
        size = 2.0 * np.sqrt(np.maximum(1.5 * (moments.sum() - 2.0 * moments) / max(link["mass"], 1e-9), 1e-6))
        box = boxes.get(link["name"], {"center": link["com"], "size": size.tolist()})
        if link["name"] in solid:
            link.setdefault("collision_box", box)
        if other_side(link["name"]) not in visuals:
            half = [length / 2.0 for length in box["size"]]
            shape = {"type": "box", "size": half, "pos": box["center"], "colour": "light"}
            visuals.setdefault(link["name"], [shape])
    table.setdefault("colours", _COLOURS)
    pairs = [(one, other) for one, other in (hands, thighs, shanks, feet)]
    for side in (0, 1):
        hand, forearm, trunk = hands[side], forearms[side], roles["trunk"]
        pairs += [(hand, trunk), (hand, thighs[side]), (hand, thighs[1 - side]), (forearm, trunk)]
        pairs += [(feet[side], shanks[1 - side])]
    table.setdefault("collision_pairs", [list(pair) for pair in dict.fromkeys(pairs)])
    table.setdefault("contact_links", [link["name"] for link in table["links"] if link["name"] in solid])
    table.setdefault("capsules", {})


def _squat(table: dict[str, Any]) -> dict[str, Any]:
    """Return the `squat` of a table: how far ahead of its ankles a robot squats upright with level soles.

    The shank leans until the ankle is `_ANKLE_ROOM` short of its limit, and the thigh as far as the height demands.
    With all joints at 0, the shank need not be upright nor the sole level with the base.
    """
    roles, joints = table["roles"], table["joints"]
    by_name = {joint["name"]: joint for joint in joints}
    hip, knee, ankle = (roles["leg"][part] for part in ("hip_pitch", "knee", "ankle_pitch"))
    shank, foot = (
        math.atan2(*placement(joints, link, roles["base"])[1][[0, 2], 2])
        for link in (by_name[knee]["child"], roles["foot"])
    )
    lean = -by_name[ankle]["range"][0] - foot - _ANKLE_ROOM
    masses = [(link["mass"], link["name"], link["com"]) for link in table["links"]]

    def posture(bend: float, p: float) -> dict[str, float]:
        q = {name: joint["nominal"] for name, joint in by_name.items()}
        for name in roles["leg"].values():
            bent = {hip: lean - bend - p, knee: bend, ankle: -lean - foot}.get(name, 0.0)
            q[name], q[other_side(name)] = bent, bent
        return q

    def reach(h: float, p: float) -> float:
        pitch = _turn(0.0, p, 0.0)

        def seen(link: str, point: Sequence[float], q: Mapping[str, float]) -> np.ndarray:
            return pitch @ placement(joints, link, roles["base"], point, q)[0]

        low, high = lean, by_name[knee]["range"][1]
        for _ in range(20):
            q = posture((low + high) / 2.0, p)
            tall = -seen(roles["foot"], [0.0, 0.0, table["sole"]["z"]], q)[2] > table["nominal_height"] + h
            low, high = ((low + high) / 2.0, high) if tall else (low, (low + high) / 2.0)
        q = posture((low + high) / 2.0, p)
        moment = sum(mass * seen(link, com, q)[0] for mass, link, com in masses)
        return float(moment / sum(mass for mass, *_ in masses) - seen(by_name[ankle]["child"], [0.0] * 3, q)[0])

    heights = [h * table["nominal_height"] / _SQUATTER for h in _SQUATS]
    middle = heights[len(heights) // 2]
    ahead = [reach(h, 0.0) for h in heights]
    tilt = (reach(middle, 0.2) - ahead[len(heights) // 2]) / 0.2
    return {
        "heights": heights,
        "reach": ahead,
        "reach_per_pitch": tilt,
        "level_shank": shank + lean + _ANKLE_ROOM - _LEVEL_ROOM,
    }

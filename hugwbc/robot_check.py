"""Whether a robot's table is plausible: what is wrong with it, what is valid, and what to do."""

import itertools
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from hugwbc.errors import HugwbcError, UnknownNameError
from hugwbc.robot_tables import robot_table
from hugwbc.state import GRAVITY
from hugwbc.table_defaults import SIDES, is_left, mirrored, other_side, placement

_ABOVE_ZERO = ("effort", "policy_torque_limit", "velocity", "armature", "corner_speed", "kp", "kd")
_FOLLOWS = {"corner_speed": "velocity", "policy_torque_limit": "effort"}  # where the table does not say it
_SAME = ("effort", "velocity", "armature", "kp", "kd")  # of the left and the right joint
# Axes of legs and waist in the base's frame, by part; the others turn about y.
_AXES = {"hip_roll": "x", "ankle_roll": "x", "hip_yaw": "z", "yaw": "z"}
_EXACT = 1e-13  # rounding of the moments of a flat body
_ALONG = 0.8  # least part of a joint's axis along the one that its role asks for
_TILTED = 12.0  # [degrees], above which the tilt of an axis is named that is within `_ALONG`
# [degrees], of frames with all joints at 0: of the shanks, whose lean tells what the ankle has to make up for, and of
# the trunk that carries the IMU, whose attitude becomes the base's.
_LEANING, _TURNED_TRUNK = 12.0, 2.0
_MIRROR = np.array([1.0, -1.0, 1.0])  # of places
_TOUCH = 0.01  # [m], of a sole above or below the ground, and of its height at heel and toe
_ASIDE = 0.005  # [m], of a sole from the middle of its link
_APART = 0.002  # [m], of the origins of a joint and its mirror image
_TURNED = 0.01  # [rad], likewise of ranges and nominal positions
_ASKEW = 5.0  # [degrees], likewise of the frames of links
_LIGHTER, _SHIFTED = 0.05, 0.02  # of a link's mass, and of its centre of mass [m], likewise
_MOST_TURNS = 2.0  # from 0 to an end of a range; more are degrees
_STRAIGHT = 0.99  # share of the length of straight legs beyond which the knees cannot be controlled
_FOREARM = 0.3  # least distance from the elbow to the hand, as a part of the upper arm
_STRONGEST = 3.0  # times the torque of the weight on a lever of a leg's length; the knees of H1 and G1 give 0.6 and 0.7


def problems(name: str) -> list[str]:
    """Return what is missing or implausible in the table of a robot, one sentence each; empty if it is fine."""
    try:
        return table_problems(robot_table(name))
    except HugwbcError as error:
        return [str(error)]


def table_problems(table: Mapping[str, Any]) -> list[str]:
    """Return what is missing or implausible in a table that `robot_table` returned."""
    return [*_double(table)] or [text for check in _CHECKS for text in check(table)]


def tilted_axes(table: Mapping[str, Any]) -> Iterator[str]:
    """Say which axes of legs and waist are tilted by more than `_TILTED` from those that their roles ask for."""
    for part, name, axis, wanted in _axes(table):
        if (tilt := math.degrees(math.acos(min(axis["xyz".index(wanted)], 1.0)))) > _TILTED:
            yield f"{name} ({part}) {tilt:.0f} degrees from +{wanted}"


def _axes(table: Mapping[str, Any]) -> Iterator[tuple[str, str, np.ndarray, str]]:
    """Yield role, name, axis in the base's frame with all joints at 0, and wanted axis, of legs' and waist's joints."""
    roles = table["roles"]
    for part, left in {**roles["leg"], **roles["waist"]}.items():
        wanted = _AXES.get(part, "y")
        for name in (left, other_side(left)) if wanted == "y" else (left,):  # the mirror image of a pitch is a pitch
            joint = next(joint for joint in table["joints"] if joint["name"] == name)
            axes = placement(table["joints"], joint["child"], roles["base"])[1]
            yield part, name, axes @ joint["axis"], wanted


def _double(table: Mapping[str, Any]) -> Iterator[str]:
    for kind, field in (("joints", "name"), ("joints", "child"), ("links", "name")):
        names = [row[field] for row in table[kind]]
        for name in sorted({name for name in names if names.count(name) > 1}):
            yield f"{names.count(name)} rows of `{kind}` have the {field} {name}; give each another one"


def _tree(table: Mapping[str, Any]) -> Iterator[str]:
    """Check that the limbs hang together as their roles say."""
    roles, above = table["roles"], {joint["child"]: joint for joint in table["joints"]}
    for link in table["links"]:
        if link["name"] != roles["base"] and link["name"] not in above:
            yield f"no joint carries {link['name']}, which is not the base {roles['base']}; remove it or name its joint"

    def order(link: str) -> Iterator[str]:
        for joint in table["joints"]:
            if joint["parent"] == link:
                yield joint["name"]
                yield from order(joint["child"])

    below, names = [*order(roles["base"])], [joint["name"] for joint in table["joints"]]
    if sorted(below) == sorted(names) and below != names:
        yield f"`joints` do not follow one another down each limb, as in MuJoCo; give them as {', '.join(below)}"

    for part, name, axis, wanted in _axes(table):
        if (along := axis["xyz".index(wanted)]) > _ALONG:
            continue
        remedy = "give one that turns"
        if along < -_ALONG:
            joint = next(joint for joint in table["joints"] if joint["name"] == name)
            turned, ends = ([round(-one, 6) + 0.0 for one in joint[key]] for key in ("axis", "range"))
            span = f", range: {ends[::-1]}" * (ends[0] > ends[1])  # one that has none is asked for it below
            remedy = f"joints: {{{name}: {{axis: {turned}{span}}}}} turns it"
        yield (
            f"{name} ({part}) turns about {axis.round(2).tolist()} of the base with all joints at 0; {remedy} "
            f"about +{wanted}"
        )
    yield from _leg_frames(table)
    for limb, end, top in (("leg", "foot", "base"), ("arm", "hand", "trunk"), ("waist", "trunk", "base")):
        joints, parts = _chain(table, roles[end], roles[top]), list(roles[limb].values())
        if joints is not None and limb == "waist" and not joints:
            yield (
                f"no waist is between {roles[top]} (base) and {roles[end]} (trunk), where {', '.join(parts)} is to be; "
                "where the legs hang below the waist, turn the description over; where there is none, put in a joint "
                "that is stuck (docs/how-to/add-a-robot.md)"
            )
        elif joints is None:
            yield f"{roles[end]} ({end}) does not hang below {roles[top]} ({top}); give other links"
        elif parts != [name for name in joints if name in parts]:
            between = f"{', '.join(joints) or 'no joints'} between {roles[top]} and {roles[end]}"
            yield f"roles `{limb}` are {', '.join(parts)}, and there are {between}; give some of these, in their order"
    imu, yaw = table["imu"]["parent"], roles["waist"]["yaw"]
    held = [name for name in _chain(table, imu, roles["base"]) or () if name != yaw]
    if imu not in (roles["base"], roles["trunk"]):
        yield f"imu is on {imu}; give a frame of {roles['base']} or {roles['trunk']}"
    elif held:
        yield f"imu is on {imu}, behind {', '.join(held)}, which are held; give a frame of {roles['base']}"
    elif (angle := _angle(placement(table["joints"], imu, roles["base"])[1])) > _TURNED_TRUNK:
        yield (
            f"the frame of {imu}, which carries the IMU, is turned by {angle:.0f} degrees from that of {roles['base']} "
            "with all joints at 0; turn it back in the description, and its shapes, inertia and joints with it"
        )
    elif imu != roles["base"]:
        axis = next(axis for part, _, axis, _ in _axes(table) if part == "yaw")
        if (tilt := math.degrees(math.acos(min(axis[2], 1.0)))) > _TURNED_TRUNK:
            yield (
                f"{yaw} turns about an axis {tilt:.0f} degrees from +z, and the IMU on {imu} with it, which is taken "
                f"for a turn about z; give a frame of {roles['base']}"
            )


def _chain(table: Mapping[str, Any], link: str, top: str) -> list[str] | None:
    """Return the names of the joints from the link `top` down to another one; None if that is not below it."""
    above, names = {joint["child"]: joint for joint in table["joints"]}, list[str]()
    while link != top:
        if link not in above:
            return None
        names.append(above[link]["name"])
        link = above[link]["parent"]
    return names[::-1]


def _leg_frames(table: Mapping[str, Any]) -> Iterator[str]:
    """Check the frames that thigh and shank are measured in: joints turn about y, and the shank's is not tilted."""
    roles, joints = table["roles"], {joint["name"]: joint for joint in table["joints"]}
    for part in ("hip_pitch", "knee"):
        for joint in (joints[side(roles["leg"][part])] for side in (str, other_side)):
            link, axis = joint["child"], np.asarray(joint["axis"])
            lean = math.degrees(math.asin(min(abs(placement(table["joints"], link, roles["base"])[1][2, 0]), 1.0)))
            if not abs(axis[1]) > _ALONG:
                found = f"{joint['name']} ({part}) turns about {axis.round(2).tolist()} of {link}, and not about its y"
            elif part == "knee" and lean > _LEANING:
                found = f"the x axis of {link} leans by {lean:.0f} degrees with all joints at 0"
            else:
                continue
            yield f"{found}; turn the link's frame in the description, and its shapes, inertia and joints with it"


def _bodies(table: Mapping[str, Any]) -> Iterator[str]:
    for link in table["links"]:
        name, mass = link["name"], link["mass"]
        if not mass > 0.0:
            yield f"the mass of {name} is {mass:g} kg; give one above 0, under `links`"
            continue
        tensor = np.array([[link["ixx"], link["ixy"], link["ixz"]], [0, link["iyy"], link["iyz"]], [0, 0, link["izz"]]])
        small, middle, large = np.linalg.eigvalsh(tensor, UPLO="U")
        if not 0.0 < small <= large <= (1.0 + _EXACT) * (small + middle):  # MuJoCo refuses others
            yield (
                f"no body has the inertia of {name}: its moments are {small:.2g}, {middle:.2g} and {large:.2g} kg m²; "
                "each must be above 0, and at most the sum of the others"
            )


def _drives(table: Mapping[str, Any]) -> Iterator[str]:
    for field in _ABOVE_ZERO:
        # A right joint takes its figures from the left one, so that only the left one is named.
        source = _FOLLOWS.get(field, field)
        follows = source != field and not all(joint[source] > 0.0 for joint in table["joints"])
        lacking = [] if follows else [joint["name"] for joint in table["joints"] if not joint[field] > 0.0]
        if names := [name for name in lacking if is_left(name) or other_side(name) not in {*lacking} - {name}]:
            yield f"{field} is 0 or less of {', '.join(names)}; give figures above 0, under `drives`"
    for joint in table["joints"]:
        name, (low, high) = joint["name"], joint["range"]
        if not low < high:
            yield f"the range of {name} is {low:g} to {high:g} rad; give range: [lower, upper] under `joints`"
        elif max(-low, high) > 2.0 * math.pi * _MOST_TURNS:
            yield f"the range of {name} is {low:g} to {high:g} rad, more than {_MOST_TURNS:g} turns; give it in radians"
        elif not low <= joint["nominal"] <= high:
            yield f"the nominal position of {name} is {joint['nominal']:g} rad; give one from {low:g} to {high:g} rad"
        if 0.0 < joint["velocity"] <= joint["corner_speed"]:
            yield f"corner_speed of {name} is not below its highest speed `velocity`, {joint['velocity']:g} rad/s"
        if not math.isclose(float(np.linalg.norm(joint["axis"])), 1.0, rel_tol=1e-3):
            yield f"the axis of {name} has the length {np.linalg.norm(joint['axis']):g}; give a vector of length 1"


def _sides(table: Mapping[str, Any]) -> Iterator[str]:
    """Check that left and right legs and arms are mirror images; grippers need not be."""
    joints, links = ({row["name"]: row for row in table[kind]} for kind in ("joints", "links"))
    roles = table["roles"]
    limbs = {name for end in ("foot", "hand") for name in _chain(table, roles[end], roles["base"]) or ()}  # of the left
    for name, joint in joints.items():
        if (other := joints.get(other_side(name))) is None:
            yield (
                f"{name} has no joint {other_side(name)} on the other side; names differ in left and right, or l "
                "and r; a joint of no side has none of these in its name: rename it in the description"
            )
            continue
        if name not in limbs or other is joint:
            continue
        if (angle := _askew(table, joint["child"], other["child"])) > _ASKEW:
            yield (
                f"the frame of {other['child']} is turned by {angle:.0f} degrees from the mirror image of that of "
                f"{joint['child']}; turn it back in the description, and its shapes, inertia and joints with it"
            )
            continue  # what follows compares figures in these frames
        if np.abs(_MIRROR * joint["xyz"] - other["xyz"]).max() > _APART and _apart(table, joint, other) > _APART:
            yield f"{name} is at {joint['xyz']} and {other['name']} at {other['xyz']}; give mirror images"
        sign = mirrored(joint, other)
        image = sorted(sign * limit for limit in joint["range"])
        if np.abs(np.subtract(image, other["range"])).max() > _TURNED:
            yield f"the range of {other['name']} is {other['range']}; the mirror image of the left one is {image}"
        image = sign * joint["nominal"]
        if abs(image - other["nominal"]) > _TURNED:
            yield f"{other['name']} is nominally at {other['nominal']:g} rad; the left one's mirror image is {image:g}"
        if differ := [field for field in _SAME if not math.isclose(joint[field], other[field], rel_tol=1e-3)]:
            yield f"{', '.join(differ)} of {name} and {other['name']} differ; give both the same"
        link, right = links[joint["child"]], links[other["child"]]
        if (
            abs(link["mass"] - right["mass"]) > _LIGHTER * link["mass"]
            or np.abs(_MIRROR * link["com"] - right["com"]).max() > _SHIFTED
        ):
            yield (
                f"{link['name']} weighs {link['mass']:g} kg at {link['com']}, and {right['name']} {right['mass']:g} kg "
                f"at {right['com']}; give mirror images under `links`"
            )


def _askew(table: Mapping[str, Any], left: str, right: str) -> float:
    """Return by what angle a link's frame is turned from the mirror image of another one's, joints at 0 [degrees]."""
    joints, base, mirror = table["joints"], table["roles"]["base"], np.diag(_MIRROR)
    axes, others = (placement(joints, link, base)[1] for link in (left, right))
    return _angle(mirror @ axes @ mirror @ others.T)


def _angle(turn: np.ndarray) -> float:
    """Return the angle of a rotation, shape (3, 3) [degrees]."""
    return math.degrees(math.acos(min(max((float(np.trace(turn)) - 1.0) / 2.0, -1.0), 1.0)))


def _apart(table: Mapping[str, Any], joint: Mapping[str, Any], other: Mapping[str, Any]) -> float:
    """Return the distance of a joint's axis from the mirror image of the other joint's origin, joints at 0 [m]."""
    place, axes = placement(table["joints"], joint["child"], table["roles"]["base"])
    image = _MIRROR * placement(table["joints"], other["child"], table["roles"]["base"])[0]
    return float(np.linalg.norm(np.cross(axes @ joint["axis"], image - place)))


def _stance(table: Mapping[str, Any]) -> Iterator[str]:
    """Check that the soles lie flat on the ground in the nominal pose, below the centre of mass."""
    roles, joints, sole, height = table["roles"], table["joints"], table["sole"], table["nominal_height"]
    q = {joint["name"]: joint["nominal"] for joint in joints}
    (heel, toe), (right, left) = sole["x"], sole["y"]
    if not (heel < toe and right < left):
        yield f"sole is x {sole['x']}, y {sole['y']}; give heel before toe, and right before left"
        return
    hip, knee, ankle = (roles["leg"][part] for part in ("hip_pitch", "knee", "ankle_pitch"))
    origin = {joint["name"]: placement(joints, joint["child"], roles["base"], q=q)[0] for joint in joints}
    lengths = [float(np.linalg.norm(origin[a] - origin[b])) for a, b in itertools.pairwise((hip, knee, ankle))]
    if max(toe - heel, left - right, abs(sole["z"])) > sum(lengths):
        yield f"sole is {sole}, larger than the leg of {sum(lengths):.3f} m; give it in metres"
        return
    if abs(middle := (right + left) / 2.0) > _ASIDE:
        joint = next(joint for joint in joints if joint["child"] == roles["foot"])
        sideways = (placement(joints, roles["foot"], roles["base"])[1] @ joint["axis"])[1]
        half = (left - right) / 2.0
        yield f"the middle of the sole is {1e3 * middle:.0f} mm left of the foot link's origin, where it is to be; " + (
            f"move {joint['name']} there along its axis under `joints`, the com of {roles['foot']} back under `links`, "
            f"and give sole: y: [{-half:.3f}, {half:.3f}]"
            if abs(sideways) > _ALONG
            else "give the part of it that is as wide on both sides under `sole`: y"
        )
    for side in (str, other_side):
        foot, level = side(roles["foot"]), side(ankle)
        if placement(joints, foot, roles["base"], q=q)[1][2, 2] < 0.0:
            yield (
                f"the z axis of {foot} points down in the nominal pose; turn the link's frame in the description, and "
                "its shapes, inertia and joints with it"
            )
            continue
        ends = [placement(joints, foot, roles["base"], [x, 0.0, sole["z"]], q)[0] for x in (heel, toe)]
        if abs(ends[0][2] - ends[1][2]) > _TOUCH:
            fall = ends[0][2] - ends[1][2]
            yield (
                f"the sole of {foot} is not level in the nominal pose: its heel is {1e3 * fall:.0f} mm above its toe; "
                f"give {level}: {q[level] - math.asin(fall / (toe - heel)):.3f} under `nominal`, where the link's axes "
                "are level with its sole; else turn the link in the description"
            )
        elif abs(gap := height + (ends[0][2] + ends[1][2]) / 2.0) > _TOUCH:
            yield (
                f"the sole of {foot} is {abs(1e3 * gap):.0f} mm {'above' if gap > 0.0 else 'below'} the ground in the "
                f"nominal pose; give nominal_height: {height - gap:.3f}, or another sole: z or `nominal`"
            )
    used = float(np.linalg.norm(origin[hip] - origin[ankle])) / sum(lengths)
    if used > _STRAIGHT:
        yield (
            f"in the nominal pose the legs are {100.0 * used:.1f} % straight, and a leg must bend to balance; "
            "bend the knees under `nominal`, to about 0.8 rad"
        )
    places = [placement(joints, link["name"], roles["base"], link["com"], q)[0] for link in table["links"]]
    centre = np.average(places, axis=0, weights=[link["mass"] for link in table["links"]])[0]
    mass = math.fsum(link["mass"] for link in table["links"])
    effort = next(joint["effort"] for joint in joints if joint["name"] == knee)
    if (moment := 0.5 * GRAVITY * mass * abs(origin[knee][0] - centre)) > effort > 0.0:
        yield (
            f"of the {mass:g} kg, {knee} bears {moment:.3g} N m in the nominal pose, and its effort is {effort:g} N m; "
            "correct the masses [kg], or the `effort`"
        )
    legs = [joint for joint in joints if joint["name"] in roles["leg"].values()]
    strongest, lever = max(legs, key=lambda joint: joint["effort"]), GRAVITY * mass * sum(lengths)
    if strongest["effort"] > _STRONGEST * lever > 0.0:
        yield (
            f"the effort of {strongest['name']} is {strongest['effort']:g} N m, and {lever:.3g} N m hold the {mass:g} "
            f"kg on a lever of a leg's length, {sum(lengths):.2f} m; give the `effort` in N m, and the masses in kg"
        )
    ends = [placement(joints, roles["foot"], roles["base"], [x, 0.0, sole["z"]], q)[0][0] for x in (heel, toe)]
    if not ends[0] < centre < ends[1]:
        yield (
            f"in the nominal pose the centre of mass is at x = {centre:.3f} m of the base, and the soles reach from "
            f"{ends[0]:.3f} to {ends[1]:.3f} m; change `nominal` so that it is above them"
        )


def _limbs(table: Mapping[str, Any]) -> Iterator[str]:
    """Check that hands are away from elbows, and that gains and postures have a valid number for each joint."""
    ranges = {joint["name"]: joint["range"] for joint in table["joints"]}
    roles, child = table["roles"], {joint["name"]: joint["child"] for joint in table["joints"]}
    arm = [(child[roles["arm"][part]], (0.0, 0.0, 0.0)) for part in ("shoulder_roll", "elbow")]
    arm.append((roles["hand"], table["hand"]["xyz"]))
    shoulder, elbow, hand = (placement(table["joints"], link, roles["base"], at)[0] for link, at in arm)
    upper_arm, forearm = float(np.linalg.norm(elbow - shoulder)), float(np.linalg.norm(hand - elbow))
    if forearm < _FOREARM * upper_arm:
        yield (
            f"the hand is {100.0 * forearm:.0f} cm from the elbow, which is {100.0 * upper_arm:.0f} cm from the "
            f"shoulder; give the palm's place in the frame of {roles['hand']}, hand: {{xyz: [x, y, z]}}"
        )
    for section, limb in (("arm_servo", "arm"), ("arm_postures", "arm"), ("leg_postures", "leg")):
        parts, known = table["roles"][limb], robot_table()[section]
        if lacking := [name for name in known if name not in table[section]]:
            yield f"{section} lacks {', '.join(lacking)}; give each, with a number for each of {', '.join(parts)}"
        for name, values in table[section].items():
            if len(values) != len(parts):
                yield f"{section} has {len(values)} numbers for {name}; give one for each of {', '.join(parts)}"
            elif section == "arm_servo":
                if not min(values) > 0.0:
                    yield f"{section} has {name} from {min(values):g} on; give figures above 0"
            else:
                for joint, value in zip(parts, values, strict=True):
                    low, high = ranges[parts[joint]]
                    if not low - _TURNED <= value <= high + _TURNED:
                        yield f"{section} has {joint} at {value:g} rad for {name}; give {low:g} to {high:g} rad"


def _shapes(table: Mapping[str, Any]) -> Iterator[str]:
    """Check that shapes have an extent, that boxes end above the soles, and that collision pairs have shapes."""
    roles, q = table["roles"], {joint["name"]: joint["nominal"] for joint in table["joints"]}
    for link in table["links"]:
        name, box = link["name"], link.get("collision_box")
        if box is not None and not min(box["size"]) > 0.0:
            yield f"the box of {name} has the size {box['size']}; give lengths above 0"
        if box is not None and name in (roles["foot"], other_side(roles["foot"])):
            yield f"{name} has a collision_box; leave it out: a foot collides by its `sole`"
            continue
        if box is None:
            if name == roles["trunk"] != roles["base"]:
                yield f"the trunk, {name}, has no collision_box, so that nothing shows its falls; give it one"
            continue
        corners = [
            np.add(box["center"], np.multiply(box["size"], at)) for at in itertools.product((-0.5, 0.5), repeat=3)
        ]
        lowest = min(placement(table["joints"], name, roles["base"], corner.tolist(), q)[0][2] for corner in corners)
        if (below := -table["nominal_height"] - lowest) > 0.0:
            yield (
                f"the box of {name} reaches {1e3 * below:.0f} mm below the soles in the nominal pose; give a smaller "
                f"one, links: {{{name}: {{collision_box: {{center: [x, y, z], size: [x, y, z]}}}}}}, with full lengths"
            )
    for name, capsules in table["capsules"].items():
        for capsule in capsules:
            if not (capsule["radius"] > 0.0 <= capsule["length"]):
                yield f"a capsule of {name} is {capsule}; give a radius above 0, and a length of 0 or more"
    shapes = {link["name"] for link in table["links"] if "collision_box" in link}
    shapes |= {roles["foot"], other_side(roles["foot"])}
    for name in sorted(set(itertools.chain(*table["collision_pairs"])) - shapes):
        yield f"collision_pairs name {name}, which has no collision_box; valid: {', '.join(sorted(shapes))}"


def _motors(table: Mapping[str, Any]) -> Iterator[str]:
    """Check that each joint has one motor slot in the messages."""
    if (interface := table.get("interface")) is None:
        return
    motors, modes = interface["motors"], interface["modes"]
    slots, names = [name for name in motors if name is not None], [row["name"] for row in table["joints"]]
    for name in dict.fromkeys((*slots, *names)):
        if name not in names:
            yield f"interface.motors has {name}, which is no joint; leave an unused slot null"
        elif slots.count(name) != 1:
            yield f"interface.motors has {name} {slots.count(name)} times; give each joint one slot"
    if len(modes) != len(motors):
        yield f"interface has {len(motors)} motors and {len(modes)} modes; give as many"


def _names(table: Mapping[str, Any]) -> Iterator[str]:
    """Check that sections name links and colours that exist, and that none has the name of a frame that is added."""
    touching = table["contact_links"]
    if alone := [name for name in touching if other_side(name) not in touching]:
        yield f"contact_links have {', '.join(alone)} of one side alone; name those of both"
    names, links = [], [row["name"] for row in table["links"]]
    for section in ("contact_links", "capsules", "visuals"):
        names += [(f"link under {section},", name, links) for name in table[section]]
    for shape in itertools.chain(*table["visuals"].values()):
        names += [("colour under visuals,", shape["colour"], table["colours"])]
    for what, name, valid in names:
        if name not in valid:
            yield str(UnknownNameError(what, name, valid))
    frames = {f"{side}_{part}" for side in SIDES for part in ("sole", "toe", "heel", "hand")} | {"imu"}
    for kind in ("joints", "links"):
        for row in table[kind]:
            if row["name"] in frames:
                yield f"{row['name']} is the name of a frame that hugwbc adds; give that one of the {kind} another name"


_CHECKS = (_tree, _bodies, _drives, _sides, _stance, _limbs, _shapes, _motors, _names)

"""Broken copies of the G1's table: what is wrong is named, with what to do."""

import copy
import math

import numpy as np
import pytest
import yaml

from hugwbc import rotations
from hugwbc.cli import main
from hugwbc.errors import ConfigError, ModelError
from hugwbc.evaluation.installation import check_hands, check_walking
from hugwbc.robot import _robot_of, load_robot
from hugwbc.robot_check import problems, table_problems
from hugwbc.robot_tables import robot_names, robot_table, table_file
from hugwbc.table_defaults import placement

G1 = robot_table("g1")
KNEES = LEFT_KNEE, RIGHT_KNEE = "left_knee_joint", "right_knee_joint"
MASSES = ("mass", "ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def _row(table, name):
    return next(row for row in (*table["joints"], *table["links"]) if row["name"] == name)


def _set(name, **fields):
    return lambda table: _row(table, name).update(fields)


def _twice(table):
    table["interface"]["motors"][0] = RIGHT_KNEE


BROKEN = {
    "a contact of one side": (
        lambda table: table.update(contact_links=["pelvis", "left_knee_link"]),
        ["contact_links have left_knee_link of one side alone; name those of both"],
    ),
    "a link weighs nothing": (_set("torso_link", mass=0.0), ["the mass of torso_link is 0 kg; give one above 0"]),
    "an inertia is impossible": (_set("pelvis", izz=0.05), ["no body has the inertia of pelvis"]),
    "an inertia is rounded beyond what a body has": (
        _set("torso_link", ixx=0.1, iyy=0.05, izz=0.1505, ixy=0.0, ixz=0.0, iyz=0.0),
        ["no body has the inertia of torso_link"],
    ),
    "a foot has a box": (
        _set("left_ankle_roll_link", collision_box={"center": [0.0, 0.0, 0.0], "size": [0.1, 0.1, 0.1]}),
        ["left_ankle_roll_link has a collision_box; leave it out: a foot collides by its `sole`"],
    ),
    "nothing shows that the trunk falls": (
        lambda table: (
            _row(table, "torso_link").pop("collision_box"),
            table.update(collision_pairs=[pair for pair in table["collision_pairs"] if "torso_link" not in pair]),
        ),
        ["the trunk, torso_link, has no collision_box, so that nothing shows its falls; give it one"],
    ),
    "the soles are in the air": (
        lambda table: table["sole"].update(z=-0.005),
        [f"the sole of {side}_ankle_roll_link is 30 mm above the ground" for side in ("left", "right")],
    ),
    "the soles are not in the middle": (
        lambda table: table["sole"].update(y=[0.0, 0.05]),
        ["is 25 mm left of the foot link's origin, where it is to be; give the part of it that is as wide on both"],
    ),
    "the soles are aside of ankles that pitch last": (
        lambda table: (table["sole"].update(y=[0.0, 0.05]), _set("left_ankle_roll_joint", axis=[0, 1, 0])(table)),
        [
            "left_ankle_roll_joint (ankle_roll) turns about",
            "; move left_ankle_roll_joint there along its axis under `joints`, the com of left_ankle_roll_link back",
        ],
    ),
    "the pelvis is too high": (
        lambda table: table.update(nominal_height=0.90),
        ["143 mm above the ground in the nominal pose; give nominal_height: 0.757", "143 mm above"],
    ),
    "the soles are in centimetres": (
        lambda table: table.update(sole={"x": [-5, 12], "y": [-2.5, 2.5], "z": -3.5}, nominal_height=4.222),
        ["larger than the leg of 0.641 m; give it in metres"],
    ),
    "masses are in grams": (
        lambda table: [row.update({key: 1e3 * row[key] for key in MASSES}) for row in table["links"]],
        ["of the 33341.1 kg, left_knee_joint bears"],
    ),
    "efforts are in kgf cm": (
        lambda table: [row.update(effort=10.2 * row["effort"]) for row in table["joints"]],
        ["the effort of left_hip_roll_joint is 1417.8 N m, and 210 N m hold the 33.3411 kg on a lever of a leg's"],
    ),
    "a range is in degrees": (
        lambda table: [_row(table, name).update(range=[-5.0, 165.0]) for name in KNEES],
        [f"the range of {name} is -5 to 165 rad, more than 2 turns; give it in radians" for name in KNEES],
    ),
    "the legs are straight": (
        lambda table: [
            _row(table, f"{side}_{part}_joint").update(nominal=0.0)
            for side in ("left", "right")
            for part in ("hip_pitch", "knee", "ankle_pitch")
        ],
        ["mm below the ground", "mm below the ground", "legs are 99.7 % straight"],
    ),
    "a nominal position is outside": (
        lambda table: [_row(table, name).update(nominal=-0.2) for name in KNEES],
        [
            "the nominal position of left_knee_joint is -0.2 rad; give one from -0.087267 to 2.8798 rad",
            "right_knee_joint is -0.2 rad",
            "give left_ankle_pitch_joint: 0.512 under `nominal`",
            "give right_ankle_pitch_joint: 0.512 under `nominal`",
            "the legs are 99.2 % straight",
            "the centre of mass is at",
        ],
    ),
    "left and right stand differently": (
        _set("right_shoulder_roll_joint", nominal=0.2),
        ["right_shoulder_roll_joint is nominally at 0.2 rad; the left one's mirror image is -0.2"],
    ),
    "left and right are driven differently": (
        _set(RIGHT_KNEE, effort=100.0),
        ["effort of left_knee_joint and right_knee_joint differ; give both the same"],
    ),
    "left and right weigh differently": (
        _set("left_knee_link", mass=3.0),
        ["left_knee_link weighs 3 kg at [0.005457, 0.003964, -0.12074], and right_knee_link 1.932 kg"],
    ),
    "the right hand's frame is turned": (  # its masses are nearly on the axis of the turn
        lambda table: (
            _set("right_wrist_yaw_joint", rpy=[math.pi, 0, 0], axis=[0, 0, -1])(table),
            _set("right_wrist_yaw_link", com=[0.07082443, 0.000191745, -0.001617416])(table),
        ),
        ["the frame of right_wrist_yaw_link is turned by 180 degrees from the mirror image of that of left_wrist_yaw"],
    ),
    "the right range is the left one": (
        _set("right_hip_roll_joint", range=[-0.5236, 2.9671]),
        ["the range of right_hip_roll_joint is [-0.5236, 2.9671]; the mirror image of the left one is"],
    ),
    "a joint has no range": (  # as continuous ones of a description
        _set("waist_roll_joint", range=[0.0, 0.0]),
        ["the range of waist_roll_joint is 0 to 0 rad; give range: [lower, upper] under `joints`"],
    ),
    "a gain is 0": (_set("waist_yaw_joint", kp=0.0), ["kp is 0 or less of waist_yaw_joint; give figures above 0"]),
    "a motor has two slots": (
        _twice,
        ["right_knee_joint 2 times; give each joint one slot", "left_hip_pitch_joint 0 times"],
    ),
    "gains of a forearm are left out": (
        lambda table: table["arm_servo"].update(kp=[80, 80, 80, 80], kd=[3, 3, 3, 3, 0, 1.5, 1.5]),
        ["arm_servo has 4 numbers for kp; give one for each of shoulder_pitch,", "arm_servo has kd from 0 on"],
    ),
    "the hands are the elbows": (
        lambda table: (
            table["roles"].update(hand="left_elbow_link", arm=dict(list(table["roles"]["arm"].items())[:4])),
            table["hand"].update(parent="left_elbow_link", xyz=[0.0, 0.0, 0.0]),
            [
                gains.__delitem__(slice(4, None))
                for key in ("arm_servo", "arm_postures")
                for gains in table[key].values()
            ],
        ),
        ["the hand is 0 cm from the elbow, which is 18 cm from the shoulder; give the palm's place in the frame of"],
    ),
    "a posture is missing": (lambda table: table["leg_postures"].clear(), ["leg_postures lacks tucked; give each"]),
    "a drive has all its torque at its highest speed": (
        lambda table: [_row(table, name).update(corner_speed=20.0, velocity=20.0) for name in KNEES],
        ["corner_speed of left_knee_joint is not below", "corner_speed of right_knee_joint is not below"],
    ),
    "the IMU is behind held joints": (
        lambda table: table["imu"].update(parent="torso_link"),
        ["imu is on torso_link, behind waist_roll_joint, waist_pitch_joint, which are held; give a frame of pelvis"],
    ),
    "the IMU is on a shank": (
        lambda table: table["imu"].update(parent="left_knee_link"),
        ["imu is on left_knee_link; give a frame of pelvis or torso_link"],
    ),
    "a role is another joint's": (
        lambda table: table["roles"]["leg"].update(knee="left_elbow_joint"),
        ["roles `leg` are left_hip_pitch_joint, left_hip_roll_joint, left_hip_yaw_joint, left_elbow_joint,"],
    ),
    "a roll's name has the letter of the right side": (
        lambda table: (
            _row(table, "waist_roll_joint").update(name="waist_R"),
            table["interface"]["motors"].__setitem__(table["interface"]["motors"].index("waist_roll_joint"), "waist_R"),
        ),
        ["waist_R has no joint waist_L on the other side; names differ in left and right, or l and r; a joint of no"],
    ),
    "the hand is the foot": (
        lambda table: table["roles"].update(hand="left_ankle_roll_link"),
        ["left_ankle_roll_link (hand) does not hang below torso_link (trunk)"],
    ),
    "a waist turns the other way, and has no range": (
        _set("waist_yaw_joint", axis=[0, 0, -1], range=[0.0, 0.0]),
        ["at 0; joints: {waist_yaw_joint: {axis: [0.0, 0.0, 1.0]}} turns it about +z", "is 0 to 0 rad; give range"],
    ),
    "a shape is missing": (
        lambda table: table["collision_pairs"].append(["pelvis", "torso_link"]),
        ["collision_pairs name pelvis, which has no collision_box; valid: left_ankle_roll_link, left_elbow_link"],
    ),
    "a shank is longer than the leg": (
        _set("left_knee_link", collision_box={"center": [0, 0, -0.2], "size": [0.05, 0.05, 0.4]}),
        ["the box of left_knee_link reaches 50 mm below the soles in the nominal pose; give a smaller one, links"],
    ),
    "no speeds are given": (
        lambda table: [row.update(velocity=0.0, corner_speed=0.0) for row in table["joints"] if "ankle" in row["name"]],
        ["velocity is 0 or less of left_ankle_pitch_joint, left_ankle_roll_joint; give figures above 0"],
    ),
    "no waist is between base and trunk": (
        lambda table: table["roles"].update(trunk="pelvis"),
        ["no waist is between pelvis (base) and pelvis (trunk), where waist_yaw_joint is to be; where the legs hang"],
    ),
    "a policy's torque is limited to less than nothing": (
        _set("waist_yaw_joint", policy_torque_limit=-80.0),
        ["policy_torque_limit is 0 or less of waist_yaw_joint"],
    ),
    "a posture is in degrees": (
        lambda table: table["arm_postures"].update(forward=[-80, 0.2, 0, 0, 0, 0, 0]),
        ["arm_postures has shoulder_pitch at -80 rad for forward; give -3.0892 to 2.6704 rad"],
    ),
    "shapes have no extent": (
        lambda table: (
            _row(table, "torso_link")["collision_box"].update(size=[0.1, -0.2, 0.3]),
            table["capsules"].update(pelvis=[{"pos": [0, 0, 0], "radius": 0.0, "length": 0.1}]),
        ),
        ["the box of torso_link has the size [0.1, -0.2, 0.3]; give lengths above 0", "a capsule of pelvis is {'pos'"],
    ),
    "links and looks are misspelt": (
        lambda table: (
            table["contact_links"].append("torso"),
            table["visuals"].update(trunk=[{"type": "box", "size": [1, 1, 1], "pos": [0, 0, 0], "colour": "pink"}]),
        ),
        [
            "unknown link under contact_links, 'torso'. Did you mean 'torso_link'",
            "unknown link under visuals, 'trunk'",
            "unknown colour under visuals, 'pink'",
        ],
    ),
    "joints are in the order of another simulator": (
        lambda table: table["joints"].insert(1, table["joints"].pop(6)),  # both hips before the knees
        ["`joints` do not follow one another down each limb, as in MuJoCo; give them as left_hip_pitch_joint,"],
    ),
    "the interface has nothing": (
        lambda table: table["interface"].update(motors=[], modes=[1]),
        [
            *(f"interface.motors has {row['name']} 0 times; give each joint one slot" for row in G1["joints"]),
            "interface has 0 motors and 1 modes; give as many",
        ],
    ),
    "a joint is given twice": (
        lambda table: table["joints"].append(copy.deepcopy(_row(table, LEFT_KNEE))),
        [
            "2 rows of `joints` have the name left_knee_joint; give each another one",
            "2 rows of `joints` have the child",
        ],
    ),
}


MALFORMED = {
    "a frame is turned": (lambda table: table["hand"].update(rpy=[0, 0, 1]), "rpy: unknown Place field 'rpy'. Valid: "),
    "a field is misspelt": (
        _set(LEFT_KNEE, efort=1.0),
        "efort: unknown Joint field 'efort'. Did you mean 'effort'",
    ),
    "a section is misspelt": (
        lambda table: table.update(soles={}),
        "soles: unknown Table field 'soles'. Did you mean 'sole'",
    ),
    "a command is misspelt": (
        lambda table: table.update(commands={"vx": {}}),
        "vx: unknown Commands field 'vx'. Did you mean 'v_x'",
    ),
    "a field of a section is misspelt": (
        lambda table: table["squat"].update(hights=[0.0]),
        "hights: unknown Squat field 'hights'. Did you mean 'heights'",
    ),
    "a shape is misspelt": (
        lambda table: table["visuals"]["pelvis"][0].update(type="boxx"),
        "type: unknown Table.visuals.pelvis.0.type 'boxx'. Did you mean 'box'",
    ),
    "a number is none": (
        lambda table: table["camera"].update(xyz=[math.nan, 0, 0]),
        ".nan Table.camera.Place.xyz.0 is '.nan'; it should be a valid number",
    ),
    "a number has its unit": (_set(LEFT_KNEE, effort="88 N m"), "effort: Table.joints.3.effort is '88 N m'; it should"),
    "a field is empty": (
        _set(LEFT_KNEE, viscous=None),
        "viscous: Table.joints.3.viscous is None; it should be a valid",
    ),
    "a point lacks a coordinate": (
        lambda table: table["hand"].update(xyz=[0.09, 0.003]),
        "xyz: Table.hand.Place.xyz is [0.09, 0.003]; it should have at least 3 items",
    ),
    "gains of a forearm are one number": (
        lambda table: table["arm_servo"].update(kp=80),
        "kp: Table.arm_servo.kp is 80; it should be a valid list",
    ),
    "a joint has no place": (
        lambda table: _row(table, LEFT_KNEE).pop("xyz"),
        "effort: left_knee_joint lacks xyz; give it",
    ),
    "a link has no inertia": (
        lambda table: [_row(table, "pelvis").pop(key) for key in ("ixx", "com")],
        "mass: pelvis lacks com, ixx; give it",
    ),
    "a section is missing": (lambda table: table.pop("imu"), "roles: there is neither a `description` nor imu; give"),
    "the interface has nothing": (
        lambda table: table.update(interface={}),
        "interface: Table.interface.motors is miss",
    ),
    "joints are corrections of nothing": (
        lambda table: table.update(joints={LEFT_KNEE: {"effort": 100.0}}),
        "joints: without a description, `joints` have a row each, joints: [{name: NAME, ...}]",
    ),
    "a frame is of no description": (
        lambda table: table.update(hand="palm"),
        "hand: hand is palm; without a description, give its xyz",
    ),
    "friction drives": (
        _set("waist_yaw_joint", friction=-3.0),
        "friction: Table.joints.12.friction is -3.0; it should",
    ),
    "commands come before they are given": (
        lambda table: table.update(command_delay=-0.002),
        "command_delay: Table.command_delay is -0.002; it should be greater than or equal to 0",
    ),
}


@pytest.mark.parametrize("name", robot_names())
def test_nothing_is_wrong_with_the_tables_that_come_along(name) -> None:
    assert problems(name) == []


@pytest.mark.parametrize(("edit", "expected"), BROKEN.values(), ids=BROKEN)
def test_what_is_wrong_is_named(edit, expected) -> None:
    table = copy.deepcopy(G1)
    edit(table)
    found = table_problems(table)
    assert len(found) == len(expected), found
    for text, part in zip(found, expected, strict=True):
        assert part in text


def _axes(roll, pitch, yaw):
    """Return the axes that URDF's angles describe, shape (3, 3)."""
    return rotations.to_matrix(rotations.from_yaw_pitch_roll(yaw, pitch, roll))


def _angles(axes):
    """Return URDF's angles of axes, shape (3, 3)."""
    return [math.atan2(axes[2, 1], axes[2, 2]), math.asin(-axes[2, 0]), math.atan2(axes[1, 0], axes[0, 0])]


def _turn_frame(table, name, about, angle):
    """Turn the frame of what a left joint moves, and the right one's as its image, and leave all where it is."""
    for joint, side in ((_row(table, name), 1.0), (_row(table, name.replace("left", "right")), -1.0)):
        image = angle if about == [0, 1, 0] else side * angle
        turn = rotations.to_matrix(rotations.from_axis_angle(np.array(about, dtype=float), image))
        link = _row(table, joint["child"])
        joint["rpy"] = _angles(_axes(*joint["rpy"]) @ turn)
        joint["axis"], link["com"] = (turn.T @ joint["axis"]).tolist(), (turn.T @ link["com"]).tolist()
        for below in table["joints"]:
            if below["parent"] == joint["child"]:
                below["xyz"], below["rpy"] = (turn.T @ below["xyz"]).tolist(), _angles(turn.T @ _axes(*below["rpy"]))


@pytest.mark.parametrize(
    ("name", "about", "angle", "found"),
    [
        ("left_hip_pitch_joint", [0, 0, 1], math.pi / 2, "turns about [1.0, 0.0, 0.0] of left_hip_pitch_link, and not"),
        (LEFT_KNEE, [1, 0, 0], math.pi / 2, "turns about [0.0, 0.0, -1.0] of left_knee_link, and not about its y"),
        (LEFT_KNEE, [0, 1, 0], 0.5, "the x axis of left_knee_link leans by 29 degrees with all joints at 0"),
    ],
)
def test_frames_in_which_legs_are_not_measured_as_they_are_are_named(name, about, angle, found) -> None:
    table = copy.deepcopy(G1)
    _turn_frame(table, name, about, angle)
    left, right = table_problems(table)
    assert found in left and "right" in right
    assert all("turn the link's frame in the description" in problem for problem in (left, right))


def test_a_hip_whose_axis_is_tilted_with_its_frame_is_fine() -> None:
    """As an R1's, by 25 degrees, and an H2's, by 30."""
    table = copy.deepcopy(G1)
    for side, roll in (("left", -0.5), ("right", 0.5)):
        hip, below = (_row(table, f"{side}_hip_{part}_joint") for part in ("pitch", "roll"))
        back = _axes(-roll, 0.0, 0.0)
        hip["rpy"] = [roll, 0.0, 0.0]
        below["xyz"], below["rpy"] = (back @ below["xyz"]).tolist(), _angles(back @ _axes(*below["rpy"]))
    assert table_problems(table) == []
    plain, tilted = (_robot_of("g1", one, table_file("g1")) for one in (G1, table))
    assert tilted.leg_length == pytest.approx(plain.leg_length), "the legs are as long"


def test_a_foot_that_is_upside_down_is_named() -> None:
    table = copy.deepcopy(G1)
    for side in ("left", "right"):
        joint, foot = (_row(table, f"{side}_ankle_roll_{part}") for part in ("joint", "link"))
        joint["rpy"], joint["axis"] = [math.pi, 0.0, 0.0], [1.0, 0.0, 0.0]
        foot["com"] = [foot["com"][0], -foot["com"][1], -foot["com"][2]]
    table["sole"] = {**table["sole"], "z": -table["sole"]["z"]}
    found = table_problems(table)
    assert any(one.startswith("the z axis of left_ankle_roll_link points down in the nominal pose") for one in found)


def test_a_trunk_with_the_imu_that_is_turned_is_named() -> None:
    table = robot_table("h1")
    _row(table, "torso_joint")["rpy"] = [0.0, 0.1, 0.0]
    (found,) = table_problems(table)
    assert found.startswith(
        "the frame of torso_link, which carries the IMU, is turned by 6 degrees from that of pelvis"
    )


def test_a_waist_aside_of_the_vertical_turns_no_imu() -> None:
    table = robot_table("h1")
    _row(table, "torso_joint")["axis"] = [math.sin(0.3), 0.0, math.cos(0.3)]
    (found,) = table_problems(table)
    assert found.startswith("torso_joint turns about an axis 17 degrees from +z, and the IMU on torso_link with it")


def test_a_wrist_in_no_role_is_a_mirror_image_too() -> None:
    table = copy.deepcopy(G1)
    for part in ("roll", "pitch", "yaw"):
        del table["roles"]["arm"][f"wrist_{part}"]
    for section in ("arm_servo", "arm_postures"):
        table[section] = {name: values[:4] for name, values in table[section].items()}
    assert table_problems(table) == []
    _row(table, "right_wrist_yaw_joint")["rpy"] = [math.pi, 0.0, 0.0]
    assert "the frame of right_wrist_yaw_link is turned by 180 degrees" in " ".join(table_problems(table))


@pytest.mark.parametrize(("edit", "message"), MALFORMED.values(), ids=MALFORMED)
def test_what_has_another_form_is_named_with_its_line(edit, message, tmp_path) -> None:
    table = {key: value for key, value in copy.deepcopy(G1).items() if key != "name"}
    edit(table)
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(table, sort_keys=False))
    (found,) = problems(str(path))
    place, _, words = found.partition(": ")
    _, line, column = place.split(":")
    assert f"{path.read_text().splitlines()[int(line) - 1][int(column) - 1 :].split(' ')[0]} {words}".startswith(
        message
    )


def test_a_joint_without_a_limit_is_named(tmp_path) -> None:
    table = copy.deepcopy(G1)
    del _row(table, LEFT_KNEE)["effort"]
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(table, sort_keys=False))
    assert problems(str(tmp_path / "mine.yaml")) == [
        "left_knee_joint lacks effort; give them under `drives` or `joints`"
    ]


def test_grippers_need_not_be_mirror_images() -> None:
    """Here the G1's wrists are in no role: two of the same build, of which one carries a tool."""
    table = copy.deepcopy(G1)
    for part in ("roll", "pitch", "yaw"):
        del table["roles"]["arm"][f"wrist_{part}"]
    table["roles"]["hand"] = table["hand"]["parent"] = "left_elbow_link"
    for section in ("arm_servo", "arm_postures"):
        table[section] = {name: values[:4] for name, values in table[section].items()}
    _row(table, "right_wrist_roll_joint").update(range=_row(table, "left_wrist_roll_joint")["range"], nominal=0.5)
    _row(table, "right_wrist_yaw_joint").update(kp=50.0)
    _row(table, "right_wrist_yaw_link").update(mass=1.0)
    assert table_problems(table) == []


def test_hands_of_published_robots_weigh_a_centimetre_apart() -> None:
    table = copy.deepcopy(G1)
    com = _row(table, "right_wrist_yaw_link")["com"]
    com[0] += 0.011
    assert table_problems(table) == []
    com[0] += 0.011
    assert len(table_problems(table)) == 1


def test_where_a_joint_lies_on_its_axis_is_free() -> None:
    """The right shoulder's pitch moves along its axis, and the roll behind it back."""
    table = copy.deepcopy(G1)
    pitch, roll = (_row(table, f"right_shoulder_{part}_joint") for part in ("pitch", "roll"))
    along = 0.007 * np.array(pitch["axis"])
    pitch["xyz"] = (pitch["xyz"] + placement(table["joints"], pitch["child"], "torso_link")[1] @ along).tolist()
    roll["xyz"] = (roll["xyz"] - along).tolist()
    assert table_problems(table) == []
    roll["xyz"][2] += 0.007
    (found,) = table_problems(table)
    assert found.startswith("left_shoulder_roll_joint is at")


def test_roles_that_nothing_plays_are_named_all_at_once(tmp_path, capsys) -> None:
    table = copy.deepcopy(G1)
    table["roles"]["leg"].update(knee="left_kne_joint")
    table["roles"]["foot"] = "left_sole"
    del table["roles"]["waist"]
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(table, sort_keys=False))
    assert main(["check", "--robot", str(tmp_path / "mine.yaml")]) == 1
    text = capsys.readouterr().out
    assert "FAIL  table: unknown link in the role `foot`, 'left_sole'." in text and "'right_sole'" in text
    assert "role `leg: knee`, 'left_kne_joint'. Did you mean 'left_knee_joint'?" in text
    assert "roles lacks `waist: yaw`; give the name of the joint; where there is none, put in one that is" in text
    assert "1 of 1 checks failed" in text


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (_set("torso_link", mass=0.0), "mine.yaml: the mass of torso_link is 0 kg"),
        (lambda table: table.update(arm_servo=80), r"mine.yaml:\d+:1: Table.arm_servo is 80; it should be the fields"),
        (lambda table: table["squat"]["reach"].reverse(), "give both ascending, a reach for each height"),
    ],
)
def test_what_the_check_refuses_is_not_loaded(tmp_path, edit, message) -> None:
    table = copy.deepcopy(G1)
    edit(table)
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(table, sort_keys=False))
    assert len(problems(str(path))) == 1
    with pytest.raises(ModelError, match=message):
        load_robot(str(path))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: [1,\nb: }", "mine.yaml:2:4: not valid YAML: did not find"),
        ("nominal:\n  left_knee: 0.6\n  left_knee: 0.2", "mine.yaml:3:3: not valid YAML: left_knee is given twice"),
        ("# \u00e4".encode("latin-1"), "mine.yaml: 'utf-8' codec can't decode"),
        ("[" * 100_000, "not valid YAML: more than 20000 values, or more than 50 levels"),
        ("- 1", "mine.yaml:1:1: Table is [1]; it should be the fields of a Table (docs/how-to/add-a-robot.md shows a"),
        ("joints: []\nlinks: []\ndrives: []", "mine.yaml:1:1: Table.roles is missing; give it"),
        ("joints: 3\nlinks: []\ndrives: []\nroles: {}", "mine.yaml:1:1: Table.joints is 3; it should be a valid list"),
    ],
)
def test_what_is_no_table_is_refused(tmp_path, text, message) -> None:
    (tmp_path / "mine.yaml").write_bytes(text if isinstance(text, bytes) else text.encode())
    (found,) = problems(str(tmp_path / "mine.yaml"))
    assert message in found


def test_a_base_below_the_feet_is_refused(tmp_path) -> None:
    table = copy.deepcopy(G1)
    table["roles"]["base"] = "torso_link"
    del table["nominal_height"]
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(table, sort_keys=False))
    (found,) = problems(str(tmp_path / "mine.yaml"))
    assert "pelvis does not hang below torso_link, which a role says" in found


@pytest.mark.slow
def test_a_robot_with_weak_knees_does_not_pass_the_walk(tmp_path) -> None:
    """A G1 whose knees turn at 3 instead of 20 rad/s lifts its feet less; with 20 instead of 139 N m it falls."""
    for name, fields in {"slow": {"velocity": 3.0, "corner_speed": 2.4}, "weak": {"effort": 20.0}}.items():
        table = copy.deepcopy(G1) | {"drives": []}  # the joints have their figures
        for knee in (LEFT_KNEE, RIGHT_KNEE):
            _row(table, knee).update(fields)
        (tmp_path / f"{name}.yaml").write_text(yaml.safe_dump(table, sort_keys=False))
    assert check_walking(str(tmp_path / "slow.yaml")).startswith("it walks at 0.")
    with pytest.raises(ConfigError, match=r"_knee_joint gave \S+ of 20 N m; .*bend the knees"):
        check_walking(str(tmp_path / "weak.yaml"))
    assert check_walking("g1").startswith("it walks at 0.")


@pytest.mark.slow
def test_arms_without_strength_do_not_pass_the_hands(tmp_path) -> None:
    table = copy.deepcopy(G1)
    for row in table["joints"]:
        if "shoulder" in row["name"] or "elbow" in row["name"]:
            row.update(effort=0.4)
    path = tmp_path / "weak.yaml"
    path.write_text(yaml.safe_dump(table, sort_keys=False))
    with pytest.raises(ConfigError, match=r"a hand is \d+ cm from its target"):
        check_hands(str(path))


def test_joints_that_carry_each_other_are_told(tmp_path) -> None:
    table = copy.deepcopy(G1)
    _row(table, "left_hip_pitch_joint")["parent"] = "left_knee_link"
    (tmp_path / "ring.yaml").write_text(yaml.safe_dump({key: value for key, value in table.items() if key != "name"}))
    with pytest.raises(ModelError, match="carry each other in a ring"):
        load_robot(str(tmp_path / "ring.yaml"))

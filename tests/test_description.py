"""A robot's table that names a published description, against the same robot's table with all figures."""

import copy
import itertools
import math
import re
import shutil
import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pytest
import yaml

from hugwbc import load_robot, robot, robot_tables, rotations
from hugwbc.description import measure_sole, read_description
from hugwbc.errors import ConfigError, ModelError, UnknownNameError
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.feet import pivot, sole_about
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.reach import cop_reach
from hugwbc.robot_check import problems
from hugwbc.robot_tables import robot_table
from hugwbc.runtime.safety import gain_limits
from hugwbc.sim import Simulation
from hugwbc.table_defaults import complete, is_left, other_side, placement

G1, TABLE = load_robot("g1"), robot_table("g1")
NOMINAL = {
    row["name"]: row["nominal"] for row in TABLE["joints"] if row["nominal"] and not row["name"].startswith("right")
}
SHORT = {
    "description": str(G1.urdf_path),
    "roles": TABLE["roles"],
    "imu": "imu",
    "sole": TABLE["sole"],
    "drives": TABLE["drives"],
    "nominal": NOMINAL,
}


def _robot(folder, table):
    folder.mkdir(exist_ok=True)
    (folder / "mine.yaml").write_text(yaml.safe_dump(table, sort_keys=False))
    return load_robot(str(folder / "mine.yaml"))


def test_twenty_lines_and_a_urdf_are_a_robot(tmp_path) -> None:
    """Links, joints, limits, mirrored positions and the frame of the IMU are those of the full table."""
    mine = _robot(tmp_path, SHORT)
    assert problems(mine.name) == []
    order = G1.indices(mine.joint_names)
    for field in ("lower", "upper", "torque_limit", "velocity_limit", "nominal", "axes", "armature", "friction"):
        np.testing.assert_allclose(getattr(mine, field), getattr(G1, field)[order], atol=1e-9, err_msg=field)
    for field in ("mass", "leg_length", "sole_depth", "upper_arm", "nominal_height"):
        assert getattr(mine, field) == pytest.approx(getattr(G1, field), rel=1e-6), field
    assert mine.imu_link == G1.imu_link
    mine_links, links = ({row["name"]: row for row in robot_table(name)["links"]} for name in (mine.name, "g1"))
    for key in ("com", "ixx", "iyy", "izz", "ixy", "ixz", "iyz"):
        for name, row in links.items():
            np.testing.assert_allclose(mine_links[name][key], row[key], atol=1e-8, err_msg=name)
    np.testing.assert_allclose(robot_table(mine.name)["imu"]["xyz"], TABLE["imu"]["xyz"])
    assert mine.xml_path.is_file() and mine.urdf_path.is_file()


def test_links_have_the_boxes_around_their_shapes_or_of_their_inertia(tmp_path) -> None:
    """Shapes of fixed links count too; of a link with a mesh, its other shapes are not all."""
    lying = '<origin xyz="0 0.1 0" rpy="1.5707963 0 0" /><geometry><cylinder radius="0.03" length="0.2" /></geometry>'
    plate = '<collision><origin xyz="0 0 -0.4" /><geometry><box size="0.02 0.02 0.02" /></geometry></collision>'
    mesh = '<collision><geometry><mesh filename="none.stl" /></geometry></collision>'
    links = {"left_knee_link": f"<collision>{lying}</collision>", "left_elbow_link": plate + mesh}
    root = ET.parse(G1.urdf_path).getroot()
    for link in root.findall("link"):
        if shapes := links.get(link.get("name")):
            for kind in ("visual", "collision"):
                for old in link.findall(kind):
                    link.remove(old)
            link.extend(ET.fromstring(f"<some>{shapes}</some>"))
    frame = (
        '<some><link name="plate">{}</link><joint name="screws" type="fixed"><origin xyz="0 0 0.5" />{}</joint></some>'
    )
    root.extend(ET.fromstring(frame.format(plate, '<parent link="torso_link" /><child link="plate" />')))
    ET.ElementTree(root).write(tmp_path / "maker.urdf")
    mine = _robot(tmp_path, {**SHORT, "description": "maker.urdf"})
    found, boxes = (
        {row["name"]: row["collision_box"] for row in robot_table(name)["links"] if "collision_box" in row}
        for name in (mine.name, "g1")
    )
    assert found.keys() <= boxes.keys()
    np.testing.assert_allclose(found["left_knee_link"]["center"], [0, 0.1, 0], atol=1e-6)
    np.testing.assert_allclose(found["left_knee_link"]["size"], [0.06, 0.2, 0.06], atol=1e-6)
    for key in ("center", "size"):
        np.testing.assert_allclose(found["right_knee_link"][key], boxes["right_knee_link"][key], atol=1e-9)
    low = np.subtract(boxes["torso_link"]["center"], np.divide(boxes["torso_link"]["size"], 2))
    found_low = np.subtract(found["torso_link"]["center"], np.divide(found["torso_link"]["size"], 2))
    np.testing.assert_allclose(found_low, np.minimum(low, [-0.01, -0.01, 0.09]), atol=1e-9)
    forearm = next(row for row in robot_table(mine.name)["links"] if row["name"] == "left_elbow_link")
    assert found["left_elbow_link"]["center"] == forearm["com"]


def test_mjcf_has_armatures_efforts_and_the_feets_shapes(tmp_path) -> None:
    """Efforts are those of position drives, of motors with gears, and the smaller one of actuator and joint."""
    text = G1.xml_path.read_text()
    for old, new in (
        ('<position kp="150" kv="4" forcerange="-139 139"', '<motor gear="69.5" ctrlrange="-2 2"'),
        ('<joint name="left_hip_roll_joint"', '<joint actuatorfrcrange="-100 100" name="left_hip_roll_joint"'),
        ('<joint name="right_hip_roll_joint"', '<joint actuatorfrcrange="-100 100" name="right_hip_roll_joint"'),
    ):
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "maker.xml").write_text(text)
    table = {key: value for key, value in SHORT.items() if key not in ("drives", "sole")}
    rows = [row for row in TABLE["joints"] if not row["name"].startswith("right")]
    drives = [{"joints": [row["name"]], "velocity": row["velocity"]} for row in rows]
    mine = _robot(tmp_path, {**table, "description": "maker.xml", "drives": drives})
    assert problems(mine.name) == []
    order = G1.indices(mine.joint_names)
    np.testing.assert_allclose(mine.armature, G1.armature[order])
    efforts = np.where(np.isin(order, G1.pair("hip_roll")), 100.0, G1.torque_limit[order])
    np.testing.assert_allclose(mine.torque_limit, efforts)
    # The spheres at the sole's corners touch the ground below their middles.
    np.testing.assert_allclose([*mine.sole_x, *mine.sole_y], [*G1.sole_x, *G1.sole_y], atol=0.0006)
    assert mine.sole_z == G1.sole_z


def test_mjcf_without_speeds_and_efforts_is_asked_for_them(tmp_path) -> None:
    """Also of joints in no role, whose damping would follow from them."""
    table = {key: value for key, value in SHORT.items() if key != "drives"} | {"description": "maker.xml"}
    (tmp_path / "maker.xml").write_text(re.sub(' forcerange="[^"]*"', "", G1.xml_path.read_text()))
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(table, sort_keys=False))
    effort, velocity = problems(str(tmp_path / "mine.yaml"))
    assert effort.startswith("effort is 0 or less of") and velocity.startswith("velocity is 0 or less of")
    assert all("left_hip_pitch_joint" in one and "waist_roll_joint" in one for one in (effort, velocity))


def test_a_nameless_part_may_carry_a_mesh_without_a_mass(tmp_path) -> None:
    text = G1.xml_path.read_text()
    place = text.index(">", text.index('<body name="torso_link"')) + 1
    part = '<body pos="0 0 0.3"><geom type="mesh" mesh="cover" mass="0"/></body>'
    (tmp_path / "maker.xml").write_text(
        text[:place].replace("<asset>", '<asset><mesh name="cover" file="cover.stl"/>', 1) + part + text[place:]
    )
    assert "cover.stl" in (tmp_path / "maker.xml").read_text()
    rows = [row for row in TABLE["joints"] if not row["name"].startswith("right")]
    drives = [{"joints": [row["name"]], "velocity": row["velocity"]} for row in rows]
    mine = _robot(tmp_path / "mine", {**SHORT, "description": str(tmp_path / "maker.xml"), "drives": drives})
    assert mine.mass == pytest.approx(G1.mass)


def test_inertias_of_shapes_in_place_of_those_given_are_refused(tmp_path) -> None:
    text = G1.xml_path.read_text()
    spoilt = text.replace("<compiler", '<compiler inertiafromgeom="true"', 1)
    assert spoilt != text
    (tmp_path / "maker.xml").write_text(spoilt)
    with pytest.raises(ModelError, match=r'takes inertias from shapes \(inertiafromgeom="true"\)'):
        read_description(tmp_path / "maker.xml")


def test_textures_need_not_be_there(tmp_path) -> None:
    looks = (
        '<asset><texture name="skin" type="2d" file="none.png"/><material name="skin" texture="skin"/></asset>'
        '<worldbody><site name="mark" material="skin"/>'
    )
    text = G1.xml_path.read_text().replace("<worldbody>", looks, 1)
    (tmp_path / "maker.xml").write_text(text.replace('material="light"', 'material="skin"'))
    read = read_description(tmp_path / "maker.xml")
    assert [row["name"] for row in read["joints"]] == list(G1.joint_names) and "mark" in read["frames"]
    assert measure_sole(tmp_path / "maker.xml", "left_ankle_roll_link")["z"] == G1.sole_z


def test_corrections_of_a_left_part_are_mirrored(tmp_path) -> None:
    """Unless the right one has its own; a range follows the axis, which a roll has reversed in the mirror image."""
    box = {"center": [0.0, 0.01, -0.1], "size": [0.05, 0.06, 0.2]}
    links = {
        "left_knee_link": {"mass": 2.0, "com": [0.01, 0.02, -0.13], "ixy": 1e-4, "collision_box": box},
        "left_hip_yaw_link": {"mass": 2.0},
        "right_hip_yaw_link": {"mass": 2.01},
    }
    joints = {"left_hip_roll_joint": {"range": [-0.4, 1.0], "xyz": [0.0, 0.06, -0.03], "effort": 120.0}}
    mine = _robot(tmp_path, {**SHORT, "links": links, "joints": joints})
    assert problems(mine.name) == []
    rows = {row["name"]: row for kind in ("links", "joints") for row in robot_table(mine.name)[kind]}
    knee, roll = rows["right_knee_link"], rows["right_hip_roll_joint"]
    assert (knee["mass"], knee["com"], knee["ixy"]) == (2.0, [0.01, -0.02, -0.13], -1e-4)
    assert knee["collision_box"] == {"center": [0.0, -0.01, -0.1], "size": [0.05, 0.06, 0.2]}
    assert (roll["range"], roll["xyz"], roll["effort"]) == ([-1.0, 0.4], [0.0, -0.06, -0.03], 120.0)
    assert rows["right_hip_yaw_link"]["mass"] == 2.01


def test_a_joint_in_no_role_holds_what_is_beyond_it(tmp_path) -> None:
    """Its inertia is that of MuJoCo's mass matrix; 0.05 rad, or a tenth of its speed, take its whole effort."""
    drives = [{"joints": ["waist_pitch_joint"], "armature": 0.0072, "effort": effort} for effort in (1.0, 50.0, 1e4)]
    weak, low, high = (_robot(tmp_path / str(i), {**SHORT, "drives": [drive]}) for i, drive in enumerate(drives))
    pitch = low.index("waist_pitch_joint")
    model = mujoco.MjModel.from_xml_path(str(low.xml_path))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    matrix = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, matrix)
    assert high.kp[pitch] == pytest.approx(matrix[6 + pitch, 6 + pitch] * (20.0 * np.pi) ** 2, rel=1e-6)
    assert low.kp[pitch] == pytest.approx(50.0 / 0.05)
    assert high.kd[pitch] == pytest.approx(2.0 * np.sqrt(high.kp[pitch] * matrix[6 + pitch, 6 + pitch]), rel=1e-6)
    assert low.kd[pitch] == pytest.approx(50.0 / (0.1 * low.velocity_limit[pitch]))
    assert weak.kp[pitch] == pytest.approx(1.0 / 0.05)  # also where that is less than for the rotor alone
    for limit, gain in zip(gain_limits(weak), (weak.kp, weak.kd), strict=True):
        assert np.all(gain <= limit)  # so that holding it counts nothing as clamped


def test_transmissions_do_not_hide_speeds_and_a_refusal_has_its_remedy(tmp_path) -> None:
    """A transmission's joint has the name of the joint and no limit. MuJoCo refuses moments 1, 0.1, 0.1."""
    text = G1.urdf_path.read_text()
    extra = '<transmission name="some"><joint name="left_knee_joint"><role>joint1</role></joint></transmission></robot>'
    (tmp_path / "maker.urdf").write_text(text.replace("</robot>", extra))
    mine = _robot(tmp_path, {**SHORT, "drives": [], "description": "maker.urdf"})
    np.testing.assert_allclose(mine.velocity_limit, G1.velocity_limit[G1.indices(mine.joint_names)])
    (tmp_path / "maker.xml").write_text(
        '<mujoco><worldbody><body name="pelvis"><freejoint/>'
        '<inertial pos="0 0 0" mass="1" diaginertia="1 .1 .1"/></body></worldbody></mujoco>'
    )
    with pytest.raises(ModelError, match="write <compiler balanceinertia='true'/> into it"):
        _robot(tmp_path / "other", {**SHORT, "description": str(tmp_path / "maker.xml")})


def test_a_tilted_sole_is_refused(tmp_path) -> None:
    text = G1.xml_path.read_text().replace('name="left_toe_left"', 'type="box" euler="0 0.262 0" name="left_toe_left"')
    (tmp_path / "maker.xml").write_text(
        text.replace('size="0.005" pos="0.12 0.025', 'size="0.1 0.03 0.01" pos="0.12 0.025')
    )
    short = {key: value for key, value in SHORT.items() if key != "sole"}
    with pytest.raises(ModelError, match="sole of left_ankle_roll_link is tilted by 15 degrees to the link's axes"):
        _robot(tmp_path, {**short, "description": "maker.xml"})


@pytest.mark.parametrize("turn", [*itertools.product((0.5, -0.5), repeat=4), (0.8, 0.0, 0.6, 0.0)])
def test_a_joint_may_be_mounted_at_any_angle(tmp_path, turn) -> None:
    """Exchanged axes too, whose pitch is a right angle, so that roll and yaw turn about the same axis."""
    inertial = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    arm = f'<body name="arm" quat="{" ".join(map(str, turn))}">{inertial}<joint name="elbow" axis="0 1 0"/></body>'
    (tmp_path / "maker.xml").write_text(
        f'<mujoco><worldbody><body name="base"><freejoint/>{inertial}{arm}</body></worldbody></mujoco>'
    )
    joints = read_description(tmp_path / "maker.xml")["joints"]
    np.testing.assert_allclose(placement(joints, "arm", "base")[1], rotations.to_matrix(np.array(turn)), atol=1e-12)


def test_what_an_mjcf_leaves_to_its_shapes_and_turns_is_refused(tmp_path) -> None:
    text = G1.xml_path.read_text()
    head = '<body name="head"><geom size="0.1" mass="3"/></body>'
    imu = '<site name="turned" euler="0 1 0"/>'
    hinges = '<joint name="one" axis="0 1 0"/><joint name="two"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    changes = {
        head: "gives head no <inertial>, only shapes",
        imu: "frame of the IMU is turned by 57 degrees",
        f'<body name="more">{hinges}</body>': "has 2 joints on more; give each a link",
        '<body><geom size="0.1" mass="3"/></body>': "gives part_[0-9]+_of_torso_link no <inertial>, only shapes",
    }
    for number, (change, message) in enumerate(changes.items()):
        place = text.index(">", text.index('<body name="torso_link"' if change != imu else '<body name="pelvis"')) + 1
        (tmp_path / "maker.xml").write_text(text[:place] + change + text[place:])
        table = {**SHORT, "description": str(tmp_path / "maker.xml"), "imu": "turned" if change == imu else "imu"}
        with pytest.raises(ModelError, match=message):
            _robot(tmp_path / str(number), table)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            '<joint name="left_knee_joint"',
            '<joint ref="0.3" name="left_knee_joint"',
            "has a ref of left_knee_joint; leave",
        ),
        (
            '<joint name="left_knee_joint"',
            '<joint stiffness="20" name="left_knee_joint"',
            r"has a spring \(stiffness\) in left_knee_joint; leave",
        ),
        (
            '<joint name="left_knee_joint"',
            '<joint type="slide" name="left_knee_joint"',
            "valid, and .* has left_knee_joint",
        ),
        (
            '<joint name="left_knee_joint"',
            '<joint name="shin" axis="0 0 1"/><joint name="left_knee_joint"',
            "has 2 joints on left_knee_link; give each a link of its own",
        ),
        ('<body name="waist_roll_link"', "<body", "has a link or a joint without a name"),
        ("<worldbody>", '<worldbody><body name="table"/>', "has table, pelvis in the world; give one robot"),
        (
            "<actuator>",
            '<equality><connect body1="left_knee_link" body2="pelvis" anchor="0 0 0"/></equality><actuator>',
            "closes loops of links",
        ),
    ],
)
def test_what_a_table_cannot_say_is_refused(tmp_path, old, new, message) -> None:
    text = G1.xml_path.read_text()
    assert old in text
    (tmp_path / "maker.xml").write_text(text.replace(old, new, 1))
    with pytest.raises(ModelError, match=message):
        read_description(tmp_path / "maker.xml")


def test_links_need_no_side_and_right_pitch_joints_turn_as_the_left_ones(tmp_path) -> None:
    text = G1.urdf_path.read_text()
    for number, side in enumerate(("left", "right"), start=1):
        for part in ("knee", "elbow"):
            text = text.replace(f'"{side}_{part}_link"', f'"{part}_{number}"')
    (tmp_path / "maker.urdf").write_text(text)
    mine = _robot(tmp_path, {**SHORT, "description": "maker.urdf"})
    assert mine.moved["knee"] == ("knee_1", "knee_2") and mine.moved["elbow"] == ("elbow_1", "elbow_2")
    assert frozenset(("knee_1", "knee_2")) in mine.collision_pairs
    assert all(len(pair) == 2 for pair in mine.collision_pairs)
    root = ET.fromstring(text)
    knee = next(joint for joint in root.findall("joint") if joint.get("name") == "right_knee_joint")
    limit = knee.find("limit").attrib
    limit.update(lower=str(-float(limit["upper"])), upper=str(-float(limit["lower"])))
    knee.find("axis").set("xyz", "0 -1 0")
    (tmp_path / "turned.urdf").write_text(ET.tostring(root, encoding="unicode"))
    turned = {**SHORT, "description": str(tmp_path / "turned.urdf")}
    with pytest.raises(ModelError, match=r"right_knee_joint \(knee\) turns about .*; joints: .* about \+y") as refused:
        _robot(tmp_path / "turned", turned)
    remedy = re.search(r"joints: \{.*\}\}", str(refused.value))
    assert remedy is not None
    back = _robot(tmp_path / "back", {**turned, **yaml.safe_load(remedy[0])})
    for field in ("axes", "lower", "upper", "nominal"):
        np.testing.assert_allclose(getattr(back, field), getattr(mine, field), atol=1e-6, err_msg=field)


def test_powers_of_ten_need_no_point(tmp_path) -> None:
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(SHORT | {"drives": []}) + "damping: 2e-3\n")
    table = robot_table(str(tmp_path / "mine.yaml"))
    assert table["damping"] == 0.002


def test_a_foot_whose_frame_is_behind_the_axis_of_its_pitch_stands_as_before(tmp_path) -> None:
    """The same machine: a roll joint may lie anywhere on its axis. Balance is measured from the axis of the pitch."""
    behind, foot, roll = 0.03, "left_ankle_roll_link", "left_ankle_roll_joint"
    rows = {row["name"]: row for kind in ("joints", "links") for row in TABLE[kind]}
    (x, y, z), (a, b, c) = rows[roll]["xyz"], rows[foot]["com"]
    moved = {"joints": {roll: {"xyz": [x - behind, y, z]}}, "links": {foot: {"com": [a + behind, b, c]}}}
    sole = {**TABLE["sole"], "x": [end + behind for end in TABLE["sole"]["x"]]}
    centres, reaches = [], []
    for name, table in (("plain", SHORT), ("behind", {**SHORT, **moved, "sole": sole})):
        robot = _robot(tmp_path / name, table)
        assert problems(robot.name) == []
        dynamics = Dynamics(robot)
        dynamics.update(Simulation(robot=robot).state())
        pivots = [pivot(dynamics, side, 0.02) for side in range(2)]
        centres.append([*pivots, *(sole_about(one[:2], 0.1, 0.02, robot) for one in pivots)])
        reaches.append(cop_reach(ControllerParams(), robot))
    for plain, behind_it in zip(*centres, strict=True):
        np.testing.assert_allclose(behind_it, plain, atol=1e-6)
    assert reaches == pytest.approx([0.05, 0.05])


@pytest.mark.parametrize("turn", [0.3, -0.3])
def test_an_ankle_that_is_mounted_turned_squats_as_before(tmp_path, turn) -> None:
    root, ankle = ET.parse(G1.urdf_path).getroot(), "ankle_pitch_joint"
    for joint in root.findall("joint"):
        if joint.get("name").endswith(ankle):
            joint.find("origin").set("rpy", f"0 {turn} 0")
            for end in ("lower", "upper"):
                joint.find("limit").set(end, str(float(joint.find("limit").get(end)) - turn))
    ET.ElementTree(root).write(tmp_path / "turned.urdf")
    short = {key: value for key, value in SHORT.items() if key != "squat"}
    plain = _robot(tmp_path / "plain", short)
    left = f"left_{ankle}"
    nominal = {**NOMINAL, left: NOMINAL[left] - turn}
    mine = _robot(tmp_path / "turned", {**short, "description": "../turned.urdf", "nominal": nominal})
    assert problems(mine.name) == []
    assert mine.squat_reach == pytest.approx(plain.squat_reach, abs=1e-6)
    assert mine.level_shank == pytest.approx(plain.level_shank, abs=1e-6)


def test_the_sole_may_be_of_a_link_that_is_fixed_to_the_foot(tmp_path) -> None:
    link = '<link name="{}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    box = '</inertial><collision><geometry><box size="{}"/></geometry></collision></link>'
    fixed = '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><origin xyz="{}"/>'
    (tmp_path / "foot.urdf").write_text(
        '<robot name="foot">'
        + link.format("base") + box.format("0.1 0.1 0.1") + link.format("foot") + box.format("0.1 0.04 0.02")
        + link.format("plate") + box.format("0.2 0.06 0.01")
        + fixed.format("ankle", "revolute", "base", "foot", "0 0 -1")
        + '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        + fixed.format("bolt", "fixed", "foot", "plate", "0.03 0 -0.03") + "</joint></robot>"
    )  # fmt: skip
    assert measure_sole(tmp_path / "foot.urdf", "foot") == {"x": [-0.07, 0.13], "y": [-0.03, 0.03], "z": -0.035}


@pytest.mark.parametrize(
    ("shape", "height"),
    [('type="sphere" size="0.02"', -0.05), ('type="capsule" size="0.01 0.02" euler="0 90 0"', -0.04)],
)
def test_round_shapes_stand_on_their_middles(tmp_path, shape, height) -> None:
    geoms = "".join(f'<geom {shape} pos="{x} {y} -0.03"/>' for x in (-0.05, 0.12) for y in (-0.025, 0.025))
    body = '<body name="foot"><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/><freejoint/>'
    (tmp_path / "foot.xml").write_text(f"<mujoco><worldbody>{body}{geoms}</body></worldbody></mujoco>")
    longer = 0.02 * ("capsule" in shape)
    expected = {"x": [-0.05 - longer, 0.12 + longer], "y": [-0.025, 0.025], "z": height}
    found = measure_sole(tmp_path / "foot.xml", "foot")
    assert found.keys() == expected.keys() and all(found[key] == pytest.approx(expected[key]) for key in expected)


def test_the_mesh_of_a_sole_is_the_one_that_the_description_names(tmp_path) -> None:
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    for folder, length in (("visual", 0.2), ("meshes/collision", 0.1)):
        (tmp_path / folder).mkdir(parents=True)
        rows = [f"v {length * x} {0.04 * y} {0.02 * z}" for x, y, z in corners]
        faces = ["1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"]
        (tmp_path / folder / "foot.obj").write_text("\n".join([*rows, *(f"f {face}" for face in faces)]))
    text = (
        '<mujoco><compiler meshdir="{}"/><asset><mesh name="m" file="{}"/></asset><worldbody><body name="foot">'
        '<inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/><freejoint/><geom type="mesh" mesh="m"/></body>'
        "</worldbody></mujoco>"
    )
    for folder, file, length in (
        (".", "visual/foot.obj", 0.2),
        ("meshes", "collision/foot.obj", 0.1),
        ("nowhere", "collision/foot.obj", 0.1),
    ):
        (tmp_path / "foot.xml").write_text(text.format(folder, file))
        assert measure_sole(tmp_path / "foot.xml", "foot")["x"] == [-length, length], file
    (tmp_path / "foot.xml").write_text(text.format("nowhere", "foot.obj"))
    with pytest.raises(
        ModelError, match=r"names the mesh foot\.obj, and there are .*visual.*; leave the right one alone"
    ):
        measure_sole(tmp_path / "foot.xml", "foot")


@pytest.mark.parametrize("role", ["base", "trunk", "hand"])
def test_a_role_that_is_missing_is_asked_for(tmp_path, role) -> None:
    roles = {name: part for name, part in TABLE["roles"].items() if name != role}
    with pytest.raises(ModelError, match=f"roles lacks `{role}`; give the name of the link"):
        _robot(tmp_path, {**SHORT, "roles": roles})


def test_a_hand_may_be_long_along_any_axis_of_its_link() -> None:
    table, hands = copy.deepcopy(TABLE), ("left_wrist_yaw_link", "right_wrist_yaw_link")
    for row in table["links"]:
        if row["name"] in hands:  # as if the frame of the hand were turned about y: x becomes z
            box = row["collision_box"]
            row["collision_box"] = {
                key: [-value[2] if key == "center" else value[2], value[1], value[0]] for key, value in box.items()
            }
    for row in table["joints"]:
        if row["child"] in hands:
            row["rpy"] = [0.0, math.pi / 2, 0.0]
    x, y, z = table["hand"]["xyz"]
    table["hand"]["xyz"] = [-z, y, x]
    assert robot._hand_size(table, "left_elbow_link") == robot._hand_size(TABLE, "left_elbow_link") == (0.05, 0.033)


def test_postures_of_arms_whose_joints_turn_the_other_way_are_the_same(tmp_path) -> None:
    root, mine = ET.parse(G1.urdf_path).getroot(), []
    for number in range(2):
        ET.ElementTree(root).write(tmp_path / f"{number}.urdf")
        mine.append(_robot(tmp_path / str(number), {**SHORT, "description": f"../{number}.urdf"}))
        for joint in root.findall("joint"):
            if joint.get("name") in ("left_shoulder_pitch_joint", "right_shoulder_pitch_joint"):
                joint.find("axis").set("xyz", "0 -1 0")
                low, high = (float(joint.find("limit").get(end)) for end in ("lower", "upper"))
                joint.find("limit").attrib.update(lower=str(-high), upper=str(-low))
    for kind, posture in mine[0].arm_postures.items():
        np.testing.assert_allclose(mine[1].arm_postures[kind] * [-1, 1, 1, 1, 1, 1, 1], posture, err_msg=kind)


def test_a_joint_that_is_given_by_itself_keeps_its_figures(tmp_path) -> None:
    corrected = {"left_knee_joint": {"effort": 99.0}, "left_hip_yaw_joint": {"armature": 0.03}}
    mine = _robot(tmp_path, {**SHORT, "joints": corrected})
    assert mine.torque_limit[mine.pair("knee")].tolist() == [99.0, 99.0]
    assert mine.armature[mine.pair("hip_yaw")].tolist() == [0.03, 0.03]


@pytest.mark.parametrize("follower", ["left_wrist_pitch_joint", "waist_roll_joint"])
def test_coupled_joints_play_no_role(tmp_path, follower) -> None:
    root = ET.parse(G1.urdf_path).getroot()
    joint = next(joint for joint in root.findall("joint") if joint.get("name") == follower)
    ET.SubElement(joint, "mimic", joint="waist_pitch_joint")
    ET.ElementTree(root).write(tmp_path / "maker.urdf")
    table = {**SHORT, "description": "maker.urdf"}
    if follower.startswith("left"):
        with pytest.raises(ModelError, match=r"^left_wrist_pitch_joint in the roles follow .* take that out"):
            _robot(tmp_path, table)
    else:
        assert problems(_robot(tmp_path, table).name) == [], "it is held, and plays no role"


def test_a_table_of_ones_own_among_the_models_is_checked_and_written(tmp_path, monkeypatch) -> None:
    shutil.copytree(robot.models_dir(), tmp_path / "models")
    for module in (robot, robot_tables):
        monkeypatch.setattr(module, "models_dir", lambda: tmp_path / "models")
    mine = _robot(tmp_path / "models" / "mine", SHORT)
    assert mine.xml_path.is_file() and mine.xml_path.parent == tmp_path / "models" / "mine"


def test_drives_without_friction_stay_so(tmp_path) -> None:
    drives = [{**drive, "friction": 0.0, "viscous": 0.0} for drive in TABLE["drives"]]
    mine = _robot(tmp_path, {**SHORT, "drives": drives})
    assert not np.any((mine.friction, mine.viscous))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"imu": "imu_lin"}, "unknown frame of .*'imu_lin'. Did you mean 'imu'"),
        ({"hand": "left_foot"}, "unknown frame of .*'left_foot'"),
        ({"hand": "left_sole"}, "hand is on left_ankle_roll_link; give a frame of left_wrist_yaw_link"),
        ({"imu": "left_hand"}, "imu is on left_wrist_yaw_link; give a frame of pelvis or torso_link"),
        (
            {"roles": {**TABLE["roles"], "foot": "left_sole"}},
            "left_sole is fixed to left_ankle_roll_link; roles take links that a joint moves: give left_ankle",
        ),
        (
            {"imu": {"parent": "left_sole", "xyz": [0, 0, 0]}},
            "imu is on left_sole, which is fixed to left_ankle_roll_link; give a frame of",
        ),
        ({"nominal": {"left_kne_joint": 0.3}}, "unknown joint under nominal 'left_kne_joint'. Did you mean"),
        ({"links": {"left_kne_link": {"mass": 1}}}, "unknown name under links 'left_kne_link'. Did you mean"),
        ({"commands": {"v_x": {"final": [0, 1]}}}, "unknown Limits field 'final'. Did you mean"),
        ({"commands": {"v_x": {"finishing": [1, 0]}}}, "commands has v_x from 1 to 0; give finite ends, low first"),
        ({"commands": {"v_x": {"finishing": [0.2, 1]}}}, "commands has v_x from 0.2 to 1; give .* 0 between"),
        ({"commands": {"f": {"finishing": [0, 3]}}}, "commands has f from 0 to 3; give .* f and l above 0"),
        ({"commands": {"l": {"finishing": [0, 0.1]}}}, "commands has l from 0 to 0.1; give .* f and l above 0"),
        (
            {"roles": {**TABLE["roles"], "hand": "right_wrist_yaw_link"}},
            "`hand` is right_wrist_yaw_link, which is not of",
        ),
        (
            {"roles": {**TABLE["roles"], "waist": {"yaw": "waist_yaw_joint", "pitch": "waist_pitch_joint"}}},
            "the waist moves by yaw alone; leave waist_pitch_joint out of the roles",
        ),
        (
            {"imu": {"parent": "torso_link", "xyz": [0, 0, 0]}},
            "behind waist_roll_joint, waist_pitch_joint, which are held",
        ),
        ({"drives": [{"joints": ["left_hip_pich_joint"]}]}, "unknown joint under drives 'left_hip_pich_joint'"),
        ({"drives": [{"joints": ["left_knee_joint"]}] * 2}, "drives has left_knee_joint 2 times"),
        ({"squat": {**TABLE["squat"], "heights": []}}, "give both ascending, a reach for each height"),
        ({"squat": {**TABLE["squat"], "heights": [0.0, -0.1]}}, "give both ascending, a reach for each height"),
        ({"commands": {"v_x": 1.0}}, "commands.v_x is 1.0; it should be the fields of a Limits"),
        ({"nominal": [0.1, 0.2]}, r"nominal is \[0.1, 0.2\]; it should be a mapping"),
        ({"links": TABLE["links"]}, "with a description, `links` are corrections of it, links: {NAME: ...}"),
        ({"drives": [{"armature": 0.1}]}, "drives.0.joints is missing; give it"),
        (
            {"drives": [{"joints": "left_knee_joint"}]},
            "drives.0.joints is 'left_knee_joint'; it should be a valid list",
        ),
        (
            {"drives": [{"joints": ["left_knee_joint"], "effort": "88 N m"}]},
            "drives.0.effort is '88 N m'; it should be a valid number",
        ),
        ({"description": "none.urdf"}, "none.urdf is no URDF or MJCF that MuJoCo reads"),
        ({"description": "mine.urdf"}, "mine.urdf is no URDF"),
        ({"sole": None}, "has no shape of left_ankle_roll_link; give the field sole"),
    ],
)
def test_what_does_not_fit_the_description_is_refused(tmp_path, change, message) -> None:
    table = {key: value for key, value in {**SHORT, **change}.items() if value is not None}
    with pytest.raises((ModelError, UnknownNameError), match=message):
        _robot(tmp_path, table)


@pytest.mark.parametrize("maker", ["mine.urdf", "mine.xml"])
@pytest.mark.parametrize("description", ["mine.urdf", "../mine/mine.urdf", str(G1.urdf_path)])
def test_no_file_of_another_origin_is_written_over(tmp_path, maker, description) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()
    there = {"mine.urdf", maker} if "mine" in description else {maker}
    text = G1.urdf_path.read_text().replace("Generated by models/build.py", "By the maker")
    for name in there:
        (folder / name).write_text(text)
    with pytest.raises(ModelError, match=r"mine.\w+ is not from hugwbc, .*; rename it or the table"):
        _robot(folder, {**SHORT, "description": description})
    assert {path.name for path in folder.iterdir()} == {"mine.yaml", *there}
    assert all((folder / name).read_text() == text for name in there)


def test_a_folder_that_cannot_be_written_and_missing_sections_are_named(tmp_path) -> None:
    (tmp_path / "mine.xml").mkdir()
    with pytest.raises(ConfigError, match=r"cannot write .*mine.xml"):
        _robot(tmp_path, SHORT)
    other = tmp_path / "other.yaml"
    other.write_text(yaml.safe_dump({key: value for key, value in TABLE.items() if key not in ("name", "visuals")}))
    with pytest.raises(ModelError, match="there is neither a `description` nor visuals; give one or the other"):
        load_robot(str(other))


def test_sides_by_word_or_letter() -> None:
    pairs = {"left_knee": "right_knee", "Left_Hip": "Right_Hip", "l_knee_fe": "r_knee_fe", "foot_L": "foot_R"}
    for left, right in pairs.items():
        assert (other_side(left), other_side(right)) == (right, left)
        assert is_left(left) and not is_left(right)
    for neither in ("waist_roll_joint", "pelvis", "AL1", "imu_link"):
        assert other_side(neither) == neither and not is_left(neither)


@pytest.mark.parametrize("name", ["h1-2023", "g1"])
def test_computed_squats_are_those_of_inverse_kinematics(name) -> None:
    """The tables' rows come from inverse kinematics with Pinocchio (tests/mbc/test_reach.py), rounded or fitted."""
    table = robot_table(name)
    given = table.pop("squat")
    complete(table, None)
    found = table["squat"]
    expected = np.interp(found["heights"], given["heights"], given["reach"])
    np.testing.assert_allclose(found["reach"], expected, atol=0.033)
    assert found["reach_per_pitch"] == pytest.approx(given["reach_per_pitch"], abs=0.02)
    assert found["level_shank"] == pytest.approx(given["level_shank"], abs=0.005)

"""The robot's table: names, groups, limits, gains, and errors on unknown names."""

import numpy as np
import pytest
import yaml

from hugwbc import robot_tables
from hugwbc.errors import ModelError, UnknownNameError
from hugwbc.kinematics import Kinematics
from hugwbc.robot import load_robot
from hugwbc.robot_tables import models_dir, robot_names, robot_table, table_file
from hugwbc.scripts.view import View
from hugwbc.sim import Actuators
from hugwbc.state import RobotState

LEG = ["hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle"]
ARM = ["shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow"]


def test_joint_order_is_the_papers() -> None:
    names = [f"left_{p}_joint" for p in LEG] + [f"right_{p}_joint" for p in LEG] + ["torso_joint"]
    names += [f"left_{p}_joint" for p in ARM] + [f"right_{p}_joint" for p in ARM]
    assert list(load_robot().joint_names) == names


def test_groups(robot) -> None:
    np.testing.assert_array_equal(robot.legs, np.arange(10))
    assert robot.waist == 10
    np.testing.assert_array_equal(robot.arms, np.arange(11, 19))
    assert robot.arm_names[0] == "left_shoulder_pitch_joint"
    assert robot.arm_names[-1] == "right_elbow_joint"
    np.testing.assert_array_equal(robot.hip_yaw_roll, [0, 1, 5, 6])


def test_limits_and_gains_of_some_joints(robot) -> None:
    knee, ankle, elbow = (robot.index(n) for n in ("left_knee_joint", "right_ankle_joint", "left_elbow_joint"))
    assert (robot.lower[knee], robot.upper[knee], robot.nominal[knee]) == (-0.26, 2.05, 0.8)
    assert (robot.kp[ankle], robot.kd[ankle], robot.torque_limit[ankle], robot.velocity_limit[ankle]) == (40, 2, 38, 9)
    # The paper's clip at the elbow, 35, is above the motor's 18: the motor's limit holds.
    assert robot.torque_limit[elbow] == 18
    np.testing.assert_array_equal(robot.axes[robot.waist], [0, 0, 1])
    assert np.all((robot.lower < robot.nominal) & (robot.nominal < robot.upper))


def test_arrays_are_read_only_and_the_robot_is_loaded_once(robot) -> None:
    assert load_robot() is robot
    with pytest.raises(ValueError, match="read-only"):
        robot.kp[0] = 1.0


def test_unknown_joint_suggests_the_nearest() -> None:
    with pytest.raises(
        UnknownNameError, match=r"unknown joint 'left_kne_joint'. Did you mean 'left_knee_joint'\? Valid: "
    ):
        load_robot().index("left_kne_joint")
    with pytest.raises(UnknownNameError, match="unknown joint 'tail'"):
        load_robot().indices(["torso_joint", "tail"])


def test_missing_table_field_is_named(tmp_path) -> None:
    (tmp_path / "mine.yaml").write_text("joints: []\nroles: {}\n")
    with pytest.raises(ModelError, match=r"mine.yaml:1:1: there is neither a `description` nor links, imu, camera"):
        load_robot(str(tmp_path / "mine.yaml"))


def test_a_robot_of_ones_own_is_the_path_of_its_table(tmp_path) -> None:
    """A copy of the G1's folder under another name is the same robot, with its own files."""
    folder = load_robot("g1").xml_path.parent
    for suffix in ("yaml", "xml", "urdf"):
        (tmp_path / f"mine.{suffix}").write_bytes((folder / f"g1.{suffix}").read_bytes())
    mine = load_robot(str(tmp_path / "mine.yaml"))
    assert load_robot(mine.name) is mine
    assert (mine.xml_path, mine.mass) == (tmp_path / "mine.xml", load_robot("g1").mass)
    with pytest.raises(UnknownNameError, match=r"unknown robot '.*Valid: h1, h1-2023, g1, the path of a"):
        load_robot(str(tmp_path / "other.yaml"))


def test_the_files_of_a_table_have_its_name(tmp_path) -> None:
    """Two tables that were written from one robot's do not replace each other's models."""
    for name in ("one", "other"):
        (tmp_path / f"{name}.yaml").write_text(yaml.safe_dump(robot_table("g1"), sort_keys=False))
        assert load_robot(str(tmp_path / f"{name}.yaml")).xml_path == tmp_path / f"{name}.xml"


def test_a_joint_may_have_the_name_of_its_link(tmp_path, g1_at_zero) -> None:
    text = load_robot("g1").xml_path.with_suffix(".yaml").read_text()
    (tmp_path / "mine.yaml").write_text(text.replace("_knee_joint", "_knee_link"))
    mine = _at_zero(load_robot(str(tmp_path / "mine.yaml")))
    assert mine.position("left_knee_link")[2] == g1_at_zero.position("left_knee_link")[2] < 0.0


def test_a_folder_of_the_same_name_does_not_hide_a_robot(tmp_path, monkeypatch) -> None:
    (tmp_path / "g1").mkdir()
    (tmp_path / "g1" / "g1.yaml").write_text("roles: {}")
    monkeypatch.chdir(tmp_path)
    assert table_file("g1") == models_dir() / "g1" / "g1.yaml"


def test_parts_of_the_g1() -> None:
    """29 joints: two legs of six, two arms of seven, and a waist of three, whose roll and pitch are held."""
    robot = load_robot("g1")
    assert len(robot.joint_names) == 29 and robot.mass == pytest.approx(33.34, abs=0.01)
    assert (robot.legs.size, robot.arms.size, robot.held.size) == (12, 14, 2)
    ankles = [robot.joint_names[i] for i in robot.pair("ankle_roll")]
    assert ankles == ["left_ankle_roll_joint", "right_ankle_roll_joint"]
    assert (robot.foot_links[1], robot.hand_links[0]) == ("right_ankle_roll_link", "left_wrist_yaw_link")
    assert robot.imu_turn(np.ones(29), np.ones(29)) == (0.0, 0.0)
    assert (robot.hand_tip, robot.hand_half_width) == (0.05, 0.033)
    assert (load_robot("h1").hand_tip, load_robot("h1").hand_half_width) == (View.hand_tip, View.hand_half_width)
    with pytest.raises(UnknownNameError, match=r"unknown part of h1 'ankle_roll'. Did you mean"):
        load_robot("h1").pair("ankle_roll")


def test_robots_by_name() -> None:
    """Masses: the maker's corrected description, and the earlier one of the paper."""
    assert robot_names() == ("h1", "h1-2023", "g1")
    new, earlier = load_robot("h1"), load_robot("h1-2023")
    assert (new.name, earlier.name) == ("h1", "h1-2023")
    assert load_robot("h1-2023") is earlier
    assert (new.mass, earlier.mass) == (pytest.approx(59.338), pytest.approx(51.649896))
    assert new.joint_names == earlier.joint_names
    np.testing.assert_array_equal(earlier.armature, np.full(19, 0.01))


def test_a_table_is_a_copy_and_has_the_differences_applied() -> None:
    robot_table("h1")["links"][0]["mass"] = 0.0
    assert (robot_table("h1")["links"][0]["mass"], robot_table("h1-2023")["links"][0]["mass"]) == (5.983, 5.39)
    assert "robots" not in robot_table()


def test_drives_by_joint(robot) -> None:
    """Full torque up to a corner speed below the highest one; the corner's share is that of the maker's drives."""
    assert np.all(robot.friction > 0.0) and np.all(robot.viscous > 0.0) and np.all(robot.armature > 0.0)
    share = robot.corner_speed / robot.velocity_limit
    motor = {"knee": 8.8 / 16.0, "hip_roll": 14.0 / 25.6, "ankle": 13.5 / 30.0, "elbow": 13.5 / 30.0}
    for part, expected in motor.items():
        assert share[robot.index(f"left_{part}_joint")] == pytest.approx(expected, abs=0.005)


def test_ideal_drives_have_no_friction_and_everything_else_is_the_same(robot) -> None:
    ideal = Actuators.ideal().known_robot(robot)
    assert ideal is Actuators.ideal().known_robot(robot) and (ideal.name, ideal.mass) == (robot.name, robot.mass)
    assert not ideal.friction_torque(np.ones(19)).any() and robot.friction_torque(np.ones(19)).all()
    assert ideal.command_delay == 0.0 < robot.command_delay
    np.testing.assert_array_equal(ideal.armature, robot.armature)


@pytest.mark.parametrize(
    ("name", "ankle", "leg"), [("h1", "left_ankle_link", 0.8), ("g1", "left_ankle_pitch_link", 0.6366)]
)
def test_dimensions_follow_from_the_joints(name, ankle, leg) -> None:
    """The shoulder roll joint, the straight leg and the stretched arm, as the kinematics has them."""
    robot = load_robot(name)
    kinematics = _at_zero(robot)
    at = kinematics.position
    np.testing.assert_allclose(at("left_shoulder_roll_link"), robot.shoulder, atol=1e-12)
    assert np.linalg.norm(at("left_elbow_link") - at("left_shoulder_roll_link")) == pytest.approx(robot.upper_arm)
    assert np.linalg.norm(at("left_hand") - at("left_elbow_link")) == pytest.approx(robot.forearm)
    in_link = kinematics.rotation(robot.hand_links[0]).T @ (at("left_hand") - at(robot.hand_links[0]))
    np.testing.assert_allclose(in_link, robot.hands[0], atol=1e-12)
    assert robot.leg_length == pytest.approx(leg, abs=1e-4)
    knee = [np.linalg.norm((at(upper) - at("left_knee_link"))[::2]) for upper in ("left_hip_pitch_link", ankle)]
    assert sum(knee) == pytest.approx(robot.leg_length)
    assert at(ankle)[2] - at("left_sole")[2] == pytest.approx(robot.sole_depth)
    for posture in robot.arm_postures.values():
        arm = robot.arms[: robot.arms.size // 2]
        assert np.all((robot.lower[arm] <= posture) & (posture <= robot.upper[arm]))


def test_missing_models_folder_says_what_to_do(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(robot_tables, "__file__", str(tmp_path / "hugwbc" / "robot_tables.py"))
    with pytest.raises(ModelError, match="reinstall hugwbc with its models"):
        robot_tables.models_dir()


def test_the_right_hand_mirrors_the_left_one(g1_at_zero) -> None:
    """The G1's hand frame is 3 mm left of the axis of its left wrist, so that the right one is right of it."""
    left, right = (g1_at_zero.position(f"{side}_hand") for side in ("left", "right"))
    np.testing.assert_allclose(left, right * (1, -1, 1), atol=1e-5)


def _at_zero(robot) -> Kinematics:
    """Return the kinematics of a robot with all joints at 0 and its base at the origin."""
    kinematics, zeros = Kinematics(robot), np.zeros(len(robot.joint_names))
    kinematics.update(RobotState(zeros, zeros, np.array([1.0, 0, 0, 0]), np.zeros(3), np.zeros(3)))
    return kinematics


@pytest.fixture
def g1_at_zero() -> Kinematics:
    return _at_zero(load_robot("g1"))

"""The robot's table: names, groups, limits, gains, and errors on unknown names."""

import numpy as np
import pytest

from hugwbc import robot as robot_module
from hugwbc.errors import ModelError, UnknownNameError
from hugwbc.robot import load_robot

LEG = ["hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle"]
ARM = ["shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow"]


def test_joint_order_is_the_papers() -> None:
    names = [f"left_{p}_joint" for p in LEG] + [f"right_{p}_joint" for p in LEG] + ["torso_joint"]
    names += [f"left_{p}_joint" for p in ARM] + [f"right_{p}_joint" for p in ARM]
    assert list(load_robot().joint_names) == names


def test_groups() -> None:
    robot = load_robot()
    np.testing.assert_array_equal(robot.legs, np.arange(10))
    assert robot.waist == 10
    np.testing.assert_array_equal(robot.arms, np.arange(11, 19))
    assert robot.arm_names[0] == "left_shoulder_pitch_joint"
    assert robot.arm_names[-1] == "right_elbow_joint"
    np.testing.assert_array_equal(robot.hip_yaw_roll, [0, 1, 5, 6])


def test_limits_and_gains_of_some_joints() -> None:
    robot = load_robot()
    knee, ankle, elbow = (robot.index(n) for n in ("left_knee_joint", "right_ankle_joint", "left_elbow_joint"))
    assert (robot.lower[knee], robot.upper[knee], robot.nominal[knee]) == (-0.26, 2.05, 0.8)
    assert (robot.kp[ankle], robot.kd[ankle], robot.torque_limit[ankle], robot.velocity_limit[ankle]) == (40, 2, 38, 9)
    # The paper's clip at the elbow, 35, is above the motor's 18: the motor's limit holds.
    assert robot.torque_limit[elbow] == 18
    np.testing.assert_array_equal(robot.axes[robot.waist], [0, 0, 1])
    assert np.all((robot.lower < robot.nominal) & (robot.nominal < robot.upper))


def test_limits_are_symmetric_left_to_right() -> None:
    robot = load_robot()
    left, right = robot.index("left_shoulder_yaw_joint"), robot.index("right_shoulder_yaw_joint")
    assert (robot.lower[right], robot.upper[right]) == (-robot.upper[left], -robot.lower[left])


def test_arrays_are_read_only_and_the_robot_is_loaded_once() -> None:
    robot = load_robot()
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


def test_missing_table_field_is_named(tmp_path, monkeypatch) -> None:
    (tmp_path / "h1.yaml").write_text("joints: []\narmature: 0.01\n")
    monkeypatch.setattr(robot_module, "model_dir", lambda: tmp_path)
    with pytest.raises(ModelError, match=r"h1.yaml lacks the field 'damping'; restore it"):
        load_robot.__wrapped__()


def test_missing_models_folder_says_what_to_do(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(robot_module, "__file__", str(tmp_path / "hugwbc" / "robot.py"))
    with pytest.raises(ModelError, match="reinstall hugwbc with its models"):
        robot_module.model_dir()

"""The robot's files: generated from the table, complete, symmetric, and inside the maker's outlines."""

import importlib.util
import types
import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pytest

from hugwbc import load_robot
from hugwbc.robot import other_side
from hugwbc.robot_tables import models_dir, robot_names, robot_table

MODEL = mujoco.MjModel.from_xml_path(str(load_robot("h1").xml_path))


def _build() -> types.ModuleType:
    spec = importlib.util.spec_from_file_location("models_build", models_dir() / "build.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


BUILD = _build()
TABLE = robot_table()
EACH = pytest.mark.parametrize("name", robot_names())


@EACH
def test_committed_files_are_what_the_table_gives(name: str) -> None:
    robot = load_robot(name)
    assert robot.xml_path.read_text() == BUILD.mjcf(robot_table(name))
    assert robot.urdf_path.read_text() == BUILD.urdf(robot_table(name))


def test_sizes() -> None:
    assert (MODEL.nq, MODEL.nv, MODEL.nu) == (26, 25, 19)
    assert MODEL.nbody == 21  # the world and 20 links
    assert MODEL.body_mass.sum() == pytest.approx(59.338, abs=1e-9)


def test_the_earlier_description_differs_in_masses_hip_range_and_drives_only() -> None:
    """51.649896 kg: the sum that the maker's first description gives."""
    earlier = mujoco.MjModel.from_xml_path(str(load_robot("h1-2023").xml_path))
    assert earlier.body_mass.sum() == pytest.approx(51.649896, abs=1e-9)
    hips = [MODEL.joint(f"{side}_hip_pitch_joint").id for side in ("left", "right")]
    np.testing.assert_array_equal(earlier.jnt_range[hips], [[-1.57, 1.57]] * 2)
    np.testing.assert_array_equal(MODEL.jnt_range[hips], [[-3.14, 2.53]] * 2)
    others = np.delete(np.arange(MODEL.njnt), hips)
    np.testing.assert_array_equal(earlier.jnt_range[others], MODEL.jnt_range[others])
    for field in ("body_pos", "body_quat", "geom_pos", "geom_size", "site_pos", "actuator_forcerange", "key_qpos"):
        np.testing.assert_array_equal(getattr(earlier, field), getattr(MODEL, field), err_msg=field)


@pytest.mark.parametrize("robot", ["h1", "g1"])
def test_inertias_are_possible_and_mirror_images(robot: str) -> None:
    """Principal moments are positive and obey the triangle inequality; the left side is the right one's reflection."""
    model = mujoco.MjModel.from_xml_path(str(load_robot(robot).xml_path))
    for body in range(1, model.nbody):
        moments = np.sort(model.body_inertia[body])
        assert moments[0] > 0.0 and moments[2] <= moments[:2].sum() * (1 + 1e-6), model.body(body).name
    links = {link["name"]: link for link in robot_table(robot)["links"]}
    for side, link in links.items():
        if side.startswith("left_"):
            other = links[other_side(side)]
            np.testing.assert_allclose(np.multiply(other["com"], [1, -1, 1]), link["com"], atol=1e-12)
            for key, sign in {"mass": 1, "ixx": 1, "iyy": 1, "izz": 1, "ixz": 1, "ixy": -1, "iyz": -1}.items():
                # The shanks of the maker's G1 have opposite signs of ixz, 4.5e-5 kg m^2.
                assert other[key] == pytest.approx(sign * link[key], abs=0.0 if robot == "h1" else 1e-4), (side, key)


@EACH
def test_actuators_follow_the_joint_order_with_the_tables_gains(name: str) -> None:
    robot = load_robot(name)
    model = mujoco.MjModel.from_xml_path(str(robot.xml_path))
    np.testing.assert_array_equal(model.dof_armature[6:], robot.armature)
    np.testing.assert_array_equal(model.dof_damping[6:], robot.damping)
    assert tuple(model.actuator(i).name for i in range(model.nu)) == robot.joint_names
    assert tuple(model.joint(i + 1).name for i in range(model.nu)) == robot.joint_names
    np.testing.assert_array_equal(model.actuator_gainprm[:, 0], robot.kp)
    np.testing.assert_array_equal(model.actuator_biasprm[:, 1:3], -np.stack((robot.kp, robot.kd), axis=1))
    np.testing.assert_array_equal(model.actuator_forcerange[:, 1], robot.torque_limit)
    np.testing.assert_array_equal(model.actuator_forcerange[:, 0], -robot.torque_limit)
    np.testing.assert_array_equal(model.jnt_range[1:], np.stack((robot.lower, robot.upper), axis=1))


@EACH
def test_keyframe_is_the_nominal_pose_just_above_the_ground(name: str) -> None:
    model = mujoco.MjModel.from_xml_path(str(load_robot(name).xml_path))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    np.testing.assert_array_equal(data.qpos[7:], load_robot(name).nominal)
    assert data.ncon == 0
    for side in ("left", "right"):
        assert 0.0 < data.sensor(f"{side}_sole_position").data[2] < 0.005


def test_visuals_are_mirror_images() -> None:
    """In a mirror-symmetric pose, the cloud of visual shapes' centres is its own reflection."""
    data = mujoco.MjData(MODEL)
    mujoco.mj_resetDataKeyframe(MODEL, data, 0)
    mujoco.mj_forward(MODEL, data)
    visual = MODEL.geom_group == 2
    centres = data.geom_xpos[visual]
    sizes = MODEL.geom_size[visual]
    cloud = np.hstack((centres, sizes))
    for row in cloud * np.array([1, -1, 1, 1, 1, 1]):
        assert np.abs(cloud - row).max(axis=1).min() < 1e-6


def test_visuals_do_not_collide_and_lie_inside_the_makers_outlines() -> None:
    boxes = {link["name"]: link["bbox"] for link in TABLE["links"]}
    for geom in np.flatnonzero(MODEL.geom_group == 2):
        assert MODEL.geom_contype[geom] == MODEL.geom_conaffinity[geom] == 0
        box = boxes[MODEL.body(MODEL.geom_bodyid[geom]).name]
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, MODEL.geom_quat[geom])
        # Bounds of the shape in the link's frame, from MuJoCo's box around it.
        extent = np.abs(rotation.reshape(3, 3)) @ MODEL.geom_aabb[geom, 3:]
        assert np.all(MODEL.geom_pos[geom] - extent >= np.array(box["min"]) - 0.02)
        assert np.all(MODEL.geom_pos[geom] + extent <= np.array(box["max"]) + 0.02)


def test_every_link_is_drawn_in_both_files() -> None:
    urdf = ET.parse(load_robot().urdf_path)
    drawn = {link.get("name") for link in urdf.iter("link") if link.find("visual") is not None}
    links = {link["name"] for link in TABLE["links"]}
    assert drawn == links
    assert {MODEL.body(MODEL.geom_bodyid[g]).name for g in np.flatnonzero(MODEL.geom_group == 2)} == links
    assert len(links) == 20

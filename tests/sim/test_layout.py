"""Where the robot is in the state of a model, with and without other bodies."""

import mujoco
import numpy as np
import pytest

from hugwbc.errors import ModelError
from hugwbc.robot import load_robot
from hugwbc.robot_tables import robot_names
from hugwbc.sim.robot_model import robot_layout


def _spec(name="h1"):
    return mujoco.MjSpec.from_file(str(load_robot(name).xml_path))


def _with_box(first):
    """Return a model with a free box that comes before or after the robot."""
    scene, box = mujoco.MjSpec(), mujoco.MjSpec()
    body = box.worldbody.add_body(name="box")
    body.add_freejoint()
    body.add_geom(size=[0.1, 0.1, 0.1])
    robot = _spec()
    scene.option = robot.option
    for part in (box, robot) if first else (robot, box):
        scene.attach(part, prefix="" if part is robot else "box_", frame=scene.worldbody.add_frame())
    return scene.compile()


@pytest.mark.parametrize("name", robot_names())
def test_alone_the_robot_is_the_whole_state(name):
    model = _spec(name).compile()
    layout, n = robot_layout(model, load_robot(name)), len(load_robot(name).joint_names)
    assert (layout.qpos, layout.qvel, layout.ctrl) == (slice(0, n + 7), slice(0, n + 6), slice(0, n))
    assert np.array_equal(model.key("nominal").qpos[layout.joints], load_robot(name).nominal)


@pytest.mark.parametrize("first", [False, True])
def test_an_object_leaves_the_robots_part_the_same(first):
    model, robot = _with_box(first), load_robot()
    layout, data = robot_layout(model, robot), mujoco.MjData(model)
    data.qpos[layout.joints], data.qvel[layout.rates] = np.arange(19.0), np.arange(19.0)
    assert [float(data.joint(name).qpos[0]) for name in robot.joint_names] == list(range(19))
    assert [float(data.joint(name).qvel[0]) for name in robot.joint_names] == list(range(19))
    assert model.nq == 33 and layout.qpos.start == (7 if first else 0)
    data.qpos[layout.qpos][:3] = 1.0, 2.0, 3.0
    mujoco.mj_kinematics(model, data)
    assert data.body("pelvis").xpos == pytest.approx([1.0, 2.0, 3.0])


def test_joints_in_another_order_are_refused():
    spec = _spec()
    spec.delete(spec.joint("left_elbow_joint"))
    spec.body("left_elbow_link").add_joint(name="another_joint")
    spec.body("left_hip_yaw_link").add_joint(name="left_elbow_joint")
    for actuator in list(spec.actuators):
        if actuator.name == "left_elbow_joint":
            actuator.target = "left_elbow_joint"
    with pytest.raises(ModelError, match=r"does not hold h1 in one piece"):
        robot_layout(spec.compile(), load_robot("h1"))

"""The body of capsules: who can touch whom, and how far apart they are."""

import dataclasses

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from hugwbc.robot import load_robot
from hugwbc.robot_tables import robot_names
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import ArmIK, BodyReach
from hugwbc.upper_ik.detour import arm_mirror, posture_table
from hugwbc.upper_ik.self_collision import HEIGHT_JOINT, PITCH_JOINT, Clearance, still_names, upper_body
from tests.conftest import make_state


def _links(wrapper):
    """Pairs of links that are watched."""
    frames = wrapper.model.frames
    links = [frames[shape.parentFrame].name for shape in wrapper.collision_model.geometryObjects]
    return {frozenset((links[p.first], links[p.second])) for p in wrapper.collision_model.collisionPairs}


BOTH = pytest.mark.parametrize("name", robot_names())


def _mujoco(name):
    return mujoco.MjModel.from_xml_path(str(load_robot(name).xml_path))


@BOTH
def test_watched_are_the_pairs_of_arms_that_touch_in_the_simulator(name):
    robot, model = load_robot(name), _mujoco(name)
    arms = {*robot.hand_links, *(model.body(model.joint(joint).bodyid[0]).name for joint in robot.arm_names)}
    pairs = {
        frozenset(model.body(model.geom_bodyid[geom]).name for geom in geoms)
        for geoms in zip(model.pair_geom1, model.pair_geom2, strict=True)
    }
    expected = {pair for pair in pairs if pair & arms}
    assert any(robot.trunk in pair for pair in expected)
    assert _links(upper_body(robot)) == _links(upper_body(robot, on_column=True)) == expected


@BOTH
def test_the_shapes_enclose_those_of_the_simulator_by_little(name):
    """Points all over each colliding box, turned into the link's frame: within a capsule, and none far inside."""
    model, wrapper = _mujoco(name), upper_body(load_robot(name))
    grid = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 21)] * 3), axis=-1).reshape(-1, 3)
    capsules = {}
    for shape in wrapper.collision_model.geometryObjects:
        frame = wrapper.model.frames[shape.parentFrame]
        place = pin.SE3(frame.placement).inverse() * pin.SE3(shape.placement)
        part = (place.inverse(), shape.geometry.radius, shape.geometry.halfLength)
        capsules.setdefault(frame.name, []).append(part)
    watched = {link for pair in _links(wrapper) for link in pair}
    boxes = [g for g in range(model.ngeom) if model.geom(g).name and model.geom_type[g] == mujoco.mjtGeom.mjGEOM_BOX]
    seen = set()
    for geom in boxes:
        link = model.body(model.geom_bodyid[geom]).name
        if link not in watched:
            continue
        seen.add(link)
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        points = model.geom_pos[geom] + grid * model.geom_size[geom] @ turn.reshape(3, 3).T
        depth = []
        for place, radius, half in capsules[link]:
            local = points @ place.rotation.T + place.translation
            local[:, 2] -= np.clip(local[:, 2], -half, half)
            depth.append(radius - np.linalg.norm(local, axis=1))
        assert np.max(depth, axis=0).min() > -1e-9, link
        on_face = (np.abs(grid[:, :2]) == 1.0).any(axis=1) | (np.abs(grid[:, 2]) == 1.0)
        assert np.max(depth, axis=0)[on_face].max() < 0.04, link
    assert seen == watched


@BOTH
def test_what_has_room_touches_nothing_in_the_simulator(name):
    """Arms before the body in random postures: in contact in MuJoCo they have no room, and few others have none."""
    robot, model = load_robot(name), _mujoco(name)
    ik, data, rng = ArmIK(robot=robot), mujoco.MjData(model), np.random.default_rng(0)
    arms = {model.joint(joint).bodyid[0] for joint in robot.arm_names}
    wrist = len(arms) // 2 - 4
    low, high = np.array([[-1.2, -0.3, -1.2, -0.5, *[-0.5] * wrist], [0.5, 0.3, 0.5, 1.8, *[0.5] * wrist]])
    touching, narrow = [], []
    for _ in range(300):
        data.qpos[:3], data.qpos[7:] = (0.0, 0.0, 3.0), robot.nominal
        q = np.concatenate((rng.uniform(low, high), rng.uniform(low, high) * arm_mirror(robot)))
        data.qpos[7:][robot.arms] = q
        mujoco.mj_forward(model, data)
        bodies = [set(model.geom_bodyid[contact.geom]) for contact in data.contact]
        touching.append(any(pair & arms for pair in bodies))
        narrow.append(ik.clearance(q).min() < 0.0)
    touching, narrow = np.array(touching), np.array(narrow)
    assert touching.sum() > 50
    assert not np.any(touching & ~narrow)
    assert touching.sum() > 0.6 * narrow.sum(), "enclosing, but not by much"


def test_what_moves_is_arms_waist_and_hips_and_on_a_column_height_and_pitch(robot):
    moving = {*robot.arm_names, *still_names(robot), robot.joint_names[robot.waist]}
    assert set(upper_body(robot).joint_names()) == moving
    assert set(upper_body(robot, on_column=True).joint_names()) == {*moving, HEIGHT_JOINT, PITCH_JOINT}


@pytest.mark.parametrize("on_column", [False, True])
def test_hands_have_the_axes_of_the_pelvis_with_all_joints_at_0(on_column):
    """The links that carry a G1's hands are turned by 0.01 degrees; those of other robots may be by 90."""
    wrapper = upper_body(load_robot("g1"), on_column=on_column)
    wrapper.state.q = pin.neutral(wrapper.model)
    wrapper.update_kinematics()
    for side in ("left", "right"):
        assert wrapper.get_T_world_frame(f"{side}_hand")[:3, :3] == pytest.approx(np.eye(3), abs=1e-9)


def test_only_the_arm_that_comes_near_has_less_room(robot):
    wrapper = upper_body(robot)
    clearance = Clearance(wrapper, robot)
    wrapper.update_kinematics()
    before = clearance()
    assert before[0] == pytest.approx(before[1], abs=1e-6), "left and right are mirror images"
    wrapper.set_joint("left_shoulder_yaw_joint", -0.9)  # the left forearm turns into the chest
    wrapper.update_kinematics()
    left, right = clearance()
    assert left < 0.0 and right == pytest.approx(before[1], abs=1e-6)


def test_what_has_no_collision_shape_is_in_the_robots_table(robot):
    """The hand stays away from the head, and goes where it was without it."""
    bald = dataclasses.replace(robot, capsules={})
    hands, state = HandTargets.of((0.05, 0.1, 0.6), None), make_state(robot.nominal)
    residual = []
    for body in (robot, bald):
        ik = ArmIK(robot=body)
        residual.append([ik.solve(hands, state, 0.02) for _ in range(100)][-1].residual[0])
    assert residual[0] > 0.03 and residual[1] < 0.005


@BOTH
def test_every_robot_of_the_table_has_arms_that_reach(name):
    robot = load_robot(name)
    ik, body = ArmIK(robot=robot), BodyReach(robot=robot)
    assert ik.robot is robot
    if name.startswith("h1"):
        assert np.array_equal(posture_table(robot).q, posture_table(load_robot()).q)
    hands, state = HandTargets.of((0.35, 0.2, 0.15), (0.3, -0.25, 0.25)), make_state(robot.nominal)
    solutions = [ik.solve(hands, state, 0.02) for _ in range(100)]
    assert solutions[-1].residual.max() < 0.005
    body.start(robot.nominal[robot.arms], np.zeros(3))
    body.placo.update_kinematics()
    assert body.hands() == pytest.approx(ik.hands(robot.nominal[robot.arms], 0.0), abs=1e-6)

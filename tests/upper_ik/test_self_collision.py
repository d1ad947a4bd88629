"""The body of capsules: who can touch whom, and how far apart they are."""

import dataclasses

import numpy as np
import pytest

from hugwbc.robot import load_robot, robot_names
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import ArmIK, BodyReach
from hugwbc.upper_ik.detour import posture_table
from hugwbc.upper_ik.self_collision import HEIGHT_JOINT, HIP_NAMES, PITCH_JOINT, Clearance, upper_body
from tests.conftest import make_state


def _links(wrapper):
    """Pairs of links that are watched."""
    links = [shape.name.rsplit("_", 1)[0] for shape in wrapper.collision_model.geometryObjects]
    return {frozenset((links[p.first], links[p.second])) for p in wrapper.collision_model.collisionPairs}


def test_each_forearm_is_watched_against_trunk_thighs_and_the_other_and_nothing_else(robot):
    forearms = {"left_elbow_link", "right_elbow_link"}
    others = {"torso_link", "left_hip_pitch_link", "right_hip_pitch_link"}
    expected = {frozenset((arm, other)) for arm in forearms for other in others} | {frozenset(forearms)}
    assert _links(upper_body(robot)) == expected


def test_what_moves_is_arms_waist_and_hips_and_on_a_column_height_and_pitch(robot):
    moving = {*robot.arm_names, *HIP_NAMES, "torso_joint"}
    assert set(upper_body(robot).joint_names()) == moving
    assert set(upper_body(robot, on_column=True).joint_names()) == {*moving, HEIGHT_JOINT, PITCH_JOINT}


def test_parallel_forearms_are_as_far_apart_as_their_axes_less_two_radii(robot):
    """Elbows at right angles and arms hanging: both forearms point ahead, 3.5 cm thick to each side of their axes."""
    ik = ArmIK()
    q = robot.nominal[robot.arms].copy()
    hands = ik.hands(q, 0.0)
    assert np.ptp(hands[:, [0, 2]], axis=0) == pytest.approx(0.0, abs=1e-6), "they are parallel, side by side"
    wrapper = upper_body(robot)
    for name, angle in zip(robot.arm_names, q, strict=True):
        wrapper.set_joint(name, float(angle))
    wrapper.update_kinematics()
    names = [shape.name for shape in wrapper.collision_model.geometryObjects]
    (index,) = [
        number
        for number, pair in enumerate(wrapper.collision_model.collisionPairs)
        if "elbow" in names[pair.first] and "elbow" in names[pair.second]
    ]
    assert wrapper.distances()[index].min_distance == pytest.approx(np.ptp(hands[:, 1]) - 2 * 0.035, abs=1e-3)


def test_only_the_arm_that_comes_near_has_less_room(robot):
    wrapper = upper_body(robot)
    clearance = Clearance(wrapper)
    wrapper.update_kinematics()
    before = clearance()
    assert before[0] == pytest.approx(before[1], abs=1e-6), "left and right are mirror images"
    wrapper.set_joint("left_shoulder_yaw_joint", -1.2)  # the left forearm turns into the chest
    wrapper.update_kinematics()
    left, right = clearance()
    assert left < 0.0 and right == pytest.approx(before[1], abs=1e-6)


def test_the_shapes_are_those_of_the_robots_table(robot):
    thicker = {
        link: tuple(dataclasses.replace(shape, radius=shape.radius + 0.01) for shape in shapes)
        for link, shapes in robot.capsules.items()
    }
    other = dataclasses.replace(robot, capsules=thicker)
    q = robot.nominal[robot.arms]
    assert ArmIK(robot=other).clearance(q) == pytest.approx(ArmIK().clearance(q) - 0.02, abs=1e-6)


@pytest.mark.parametrize("name", robot_names())
def test_every_robot_of_the_table_has_arms_that_reach(name):
    robot = load_robot(name)
    ik, body = ArmIK(robot=robot), BodyReach(robot=robot)
    assert ik.robot is robot and np.array_equal(posture_table(robot).q, posture_table().q)
    hands, state = HandTargets.of((0.35, 0.2, 0.15), (0.3, -0.25, 0.25)), make_state(robot.nominal)
    solutions = [ik.solve(hands, state, 0.02) for _ in range(100)]
    assert solutions[-1].residual.max() < 0.005
    body.start(robot.nominal[robot.arms], np.zeros(3))
    body.placo.update_kinematics()
    assert body.hands() == pytest.approx(ik.hands(robot.nominal[robot.arms], 0.0), abs=1e-6)

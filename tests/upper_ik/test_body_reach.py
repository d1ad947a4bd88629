import dataclasses
import math

import numpy as np
import pytest

from hugwbc import Command, Gait, load_robot, rotations
from hugwbc.kinematics import Kinematics
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import ArmIK, BodyReach
from hugwbc.upper_ik.body_reach import on_column
from hugwbc.upper_ik.solver import LONGEST_TICK
from tests.conftest import make_state

DT = 0.02
LOW = HandTargets.of((0.45, 0.2, 0.55), (0.45, -0.2, 0.6), "world", whole_body=True)


@pytest.fixture
def standing(robot):
    return make_state(robot.nominal, position=(0.0, 0.0, robot.nominal_height))


def run(reach, hands, state, command, seconds=6.0):
    commands = [reach.update(hands, state, command, DT) for _ in range(round(seconds / DT))]
    return commands[-1], np.array([[c.h, c.p, c.w] for c in commands])


def test_a_low_target_makes_the_body_come_down_to_where_the_arms_reach_it(robot, standing):
    command, path = run(BodyReach(robot), LOW, standing, Command())
    assert command.h < -0.2
    assert command.p > 0.1
    assert np.all(np.abs(np.diff(path, axis=0)) <= np.array([0.15, 0.3, 0.6]) * DT + 1e-9)
    # Where the body then is, the arms alone reach; where it was, they do not.
    residual = {}
    for name, h, p, w in (("before", 0.0, 0.0, 0.0), ("after", command.h, command.p, command.w)):
        q = robot.nominal.copy()
        q[robot.waist] = w
        place = (0.0, 0.0, robot.nominal_height + h)
        state = make_state(q, orientation=rotations.from_yaw_pitch_roll(0.0, p, 0.0), position=place)
        ik = ArmIK(robot)
        for _ in range(200):
            solution = ik.solve(LOW, state, DT)
        residual[name] = solution.residual
    assert np.all(residual["before"] > 0.2)
    assert np.all(residual["after"] < 0.005)


def test_joints_in_no_chain_are_where_the_robot_holds_them():
    """A G1 that leans from the waist: its hands are 3 cm from where they are with the waist upright."""
    g1 = load_robot("g1")
    nominal = g1.nominal.copy()
    nominal[g1.index("waist_pitch_joint")] = 0.2
    leaning = dataclasses.replace(g1, nominal=nominal)
    reach = BodyReach(leaning)
    reach.solve(np.zeros((2, 3)), np.zeros(2, dtype=bool), np.zeros(3), np.zeros(3), DT)
    hands = ArmIK(leaning).hands(nominal[leaning.arms], 0.0)
    assert reach.hands() == pytest.approx(hands, abs=1e-6)


def test_within_reach_of_the_arms_the_body_hardly_moves(standing):
    near = HandTargets.of((0.3, 0.25, 1.15), (0.3, -0.25, 1.1), "world", whole_body=True)
    _, path = run(BodyReach(load_robot()), near, standing, Command())
    assert np.abs(path).max() < 0.05


def test_a_target_across_the_body_turns_the_waist(standing):
    across = HandTargets.of((0.55, -0.4, 1.3), None, "world", whole_body=True)
    command, _ = run(BodyReach(load_robot()), across, standing, Command())
    assert command.w < -0.1


@pytest.mark.parametrize("gait", [Gait.STANDING, Gait.WALKING, Gait.HOPPING_LEFT])
def test_the_body_stays_in_the_ranges_of_the_gait(standing, gait):
    deep = HandTargets.of((0.9, 0.3, 0.0), (0.9, -0.5, 0.0), "world", whole_body=True)
    command, path = run(BodyReach(load_robot()), deep, standing, Command(gait=gait))
    command.validate()
    assert path[:, 0].min() >= -0.3
    assert path[:, 1].max() <= 0.4
    if gait is Gait.HOPPING_LEFT:
        assert not np.any(path[:, 1:])


def test_a_value_beyond_its_range_is_left_to_the_clamp_that_counts_it(standing):
    fast = Command(v_x=9.0, gait=Gait.WALKING)
    assert BodyReach(load_robot()).update(LOW, standing, fast, DT).v_x == 9.0
    reach, low = BodyReach(load_robot()), Command(h=-0.9)
    run(reach, LOW, standing, Command())
    assert run(reach, None, standing, low)[0] == low


def test_on_the_way_back_it_stays_in_the_ranges_of_another_gait(standing):
    reach = BodyReach(load_robot())
    bent, _ = run(reach, LOW, standing, Command())
    assert bent.h < -0.2 and bent.p > 0.1
    reach.update(None, standing, Command(gait=Gait.HOPPING_LEFT), DT).validate()


def test_it_returns_to_the_command_and_leaves_everything_else(standing):
    reach = BodyReach(load_robot())
    walk = Command(v_x=0.3, omega=0.2, h=-0.05, p=0.1, w=0.2, gait=Gait.WALKING)
    bent, _ = run(reach, LOW, standing, walk)
    assert dataclasses.replace(bent, h=walk.h, p=walk.p, w=walk.w) == walk
    back, path = run(reach, None, standing, walk)
    assert back == walk
    assert np.all(np.abs(np.diff(path, axis=0)) <= np.array([0.15, 0.3, 0.6]) * DT + 1e-9)


@pytest.mark.parametrize(("frame", "useless"), [("heading", [0]), ("steady", [0]), ("pelvis", [0, 1])])
def test_what_carries_the_target_along_stays_as_commanded(standing, frame, useless):
    """A squat brings no hand nearer to a target that comes down with the pelvis."""
    far = HandTargets.of((0.7, 0.2, -0.3), None, frame, whole_body=True)
    reach = BodyReach(load_robot())
    run(reach, LOW, standing, Command(h=-0.05, p=0.1))
    _, path = run(reach, far, standing, Command(h=-0.05, p=0.1))
    assert path[-1][useless] == pytest.approx(np.array([-0.05, 0.1])[useless], abs=1e-5)
    assert np.all(np.abs(np.diff(path, axis=0)) <= np.array([0.15, 0.3, 0.6]) * DT + 1e-5)
    assert path[-1, 2] < -0.1  # the waist helps


def test_after_a_pause_the_body_does_not_jump(standing):
    reach, most = BodyReach(load_robot()), np.array([0.15, 0.3, 0.6]) * LONGEST_TICK + 1e-9
    before = np.zeros(3)
    for hands in (LOW, LOW, None):
        reach.update(hands, standing, Command(), 10.0)
        assert np.all(np.abs(reach.values - before) <= most) and np.any(reach.values != before)
        before = reach.values


def test_bad_numbers_are_survived_and_targets_that_are_not_usable_leave_the_body_where_it_is(standing):
    reach = BodyReach(load_robot())
    low, _ = run(reach, LOW, standing, Command())
    bad = HandTargets(np.full(3, math.nan), None, "world", whole_body=True)
    for hands, state in ((bad, standing), (LOW, dataclasses.replace(standing, position=None))):
        assert reach.update(hands, state, Command(), DT) == low
    broken = make_state(np.full(19, math.nan), position=(math.nan, 0.0, 1.0))
    for state, dt in ((broken, DT), (standing, math.nan)):
        command = reach.update(LOW, state, Command(), dt)
        assert all(math.isfinite(value) for value in command.array())
        command.validate()
    assert BodyReach(load_robot()).update(LOW, broken, Command(), DT).validate()


def test_frames_agree_with_the_whole_robot(robot):
    """A hand of a pitched, turned and lowered robot is at the same point of the column in all three frames."""
    h, p, yaw = -0.2, 0.3, 2.0
    place = np.array([1.0, -2.0, robot.nominal_height + h])
    state = make_state(robot.nominal, orientation=rotations.from_yaw_pitch_roll(yaw, p, 0.0), position=place)
    kinematics = Kinematics(robot)
    kinematics.update(state)
    world = kinematics.position("left_hand")
    level = rotations.rotation_z(-yaw) @ (world - place)
    pelvis = rotations.rotate_inverse(state.orientation, world - place)
    values = np.array([h, p, 0.0])
    points = [
        on_column(HandTargets(point, None, frame), state, values, robot)
        for point, frame in ((world, "world"), (level, "heading"), (pelvis, "pelvis"))
    ]
    for point in points:
        assert point is not None
        assert point[0] == pytest.approx(points[0][0])  # type: ignore[index]
    reach = BodyReach(robot)
    reach.allow(np.array([[-0.3, 0.0], [0.0, 0.4], [-1.0, 1.0]]))
    reach.start(robot.nominal[robot.arms], values)
    reach.solve(np.stack((points[0][0],) * 2), np.array([True, False]), values, values, DT)  # type: ignore[index]
    assert reach.hands()[0] == pytest.approx(points[0][0], abs=2e-3)  # type: ignore[index]

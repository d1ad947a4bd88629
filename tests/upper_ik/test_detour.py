"""Looking ahead: postures to start from, the search for a better one, and the detour of an arm to it."""

import dataclasses

import numpy as np
import pytest

from hugwbc import rotations
from hugwbc.errors import ModelError
from hugwbc.robot import Capsule, load_robot
from hugwbc.upper_ik import ArmIK, detour
from hugwbc.upper_ik.arm_solver import ArmIKConfig
from hugwbc.upper_ik.descent import Descent, Goal
from hugwbc.upper_ik.detour import Detours, Scout, posture_table, seeds

DT = 0.02
BODY = load_robot().nominal
START = np.array([0.0, 0.1, 0.0, 0.0, 0.0, -0.1, 0.0, 0.0])
FORWARD = np.array([-1.2, 0.2, 0.0, 0.6, 0.0, -0.1, 0.0, 0.0])
MIRROR = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 1.0]])
AHEAD = np.array([0.3, 0.25, 0.2]) * MIRROR


def test_the_table_holds_free_postures_and_where_they_put_the_hand():
    ik, table = ArmIK(load_robot()), posture_table(load_robot())
    for index in range(0, len(table.q), 100):
        q = np.concatenate((table.q[index], np.zeros(4)))
        assert ik.hands(q, 0.0)[0] == pytest.approx(table.hands[index], abs=1e-9)
        assert ik.clearance(q)[0] > 0.01
        assert np.all((q >= ik.lower) & (q <= ik.upper))


@pytest.mark.parametrize("arm", [0, 1])
def test_candidates_put_the_hand_near_the_point_on_a_turned_waist_too(arm):
    ik, waist = ArmIK(load_robot()), 0.7
    point = rotations.rotation_z(waist) @ np.array([0.3, -0.3 if arm else 0.3, 0.2])
    candidates = posture_table(load_robot()).candidates(arm, point, waist, np.zeros(4), 3)
    for posture in candidates:
        q = np.zeros(8)
        q[4 * arm : 4 * arm + 4] = posture
        assert np.linalg.norm(ik.hands(q, waist)[arm] - point) < 0.15
    for first, second in ((0, 1), (0, 2), (1, 2)):
        assert np.abs(candidates[first] - candidates[second]).max() >= 0.8, "three that differ from each other"


def test_known_postures_touch_nothing_and_are_mirror_images():
    ik, robot = ArmIK(load_robot()), load_robot()
    for left, right in zip(*seeds(robot), strict=True):
        q = np.concatenate((left, right))
        for arm in (slice(0, 4), slice(4, 8)):
            alone = np.zeros(8)
            alone[arm] = q[arm]
            assert ik.clearance(alone).min() > 0.01
        assert ik.hands(q, 0.0)[0] * [1.0, -1.0, 1.0] == pytest.approx(ik.hands(q, 0.0)[1], abs=1e-9)
        assert np.all((q >= robot.lower[robot.arms]) & (q <= robot.upper[robot.arms]))


def _search(scout, robot, goal, q, ticks=300):
    """Search for both arms until all is done; the number of ticks that took."""
    for tick in range(ticks):
        for arm in range(2):
            scout.search(arm, goal, q, robot.nominal)
        if scout.done.all():
            return tick
        scout.advance(Goal(goal), robot.nominal)
    raise AssertionError("the search does not end")


def test_a_dead_end_of_the_direct_way_is_left_for_a_better_posture(robot):
    """From postures all over the workspace: somewhere descent alone stays decimetres off, and the scout does not."""
    ik, rng = ArmIK(robot), np.random.default_rng(0)
    gained = []
    for _ in range(12):
        q, goal_q = rng.uniform(ik.lower, ik.upper), rng.uniform(ik.lower, ik.upper)
        if min(ik.clearance(q).min(), ik.clearance(goal_q).min()) < 0.02:
            continue
        goal = ik.hands(goal_q, 0.0).copy()
        scout = Scout(ArmIKConfig(), robot)
        _search(scout, robot, goal, q)
        best = np.linalg.norm(ik.hands(scout.q, 0.0) - goal, axis=1)
        assert np.all(best <= scout.direct + 0.01), "never worse than the direct way"
        gained.append(np.max(scout.direct - best))
    assert len(gained) >= 3 and max(gained) > 0.1


def test_a_target_that_moves_starts_the_search_over_and_one_that_creeps_does_not(robot):
    scout, q = Scout(ArmIKConfig(), robot), robot.nominal[robot.arms]
    _search(scout, robot, AHEAD, q)
    scout.search(0, AHEAD + np.array([0.03, 0.0, 0.0]), q, robot.nominal)
    assert scout.done.all()
    scout.search(0, AHEAD + np.array([0.06, 0.0, 0.0]), q, robot.nominal)
    assert scout.done.tolist() == [False, True] and scout.direct[0] == np.inf
    assert np.array_equal(scout.q[:4], q[:4]), "from where the arm is"


def make():
    config = ArmIKConfig()
    descent = Descent(config, load_robot())
    return config, descent, Detours(config, descent, load_robot())


def drive(detours, descent, start, posture, ticks=300):
    """Follow to the end; positions (n, 8)."""
    path = [start]
    while detours.active.any() and len(path) < ticks:
        path.append(detours.follow(path[-1], path[-1], posture, BODY, DT))
    return np.array(path)


def test_a_free_way_is_taken_straight_no_faster_than_joints_and_hand_may_go():
    config, descent, detours = make()
    detours.look(0, START, FORWARD, BODY)
    assert detours.active.tolist() == [True, False]
    assert detours.count == 1
    path = drive(detours, descent, START, FORWARD)
    assert path[-1] == pytest.approx(FORWARD, abs=0.03)
    along = (path[:, :4] - START[:4]) @ (FORWARD - START)[:4] / np.sum((FORWARD - START)[:4] ** 2)
    assert path[:, :4] == pytest.approx(START[:4] + along[:, None] * (FORWARD - START)[:4], abs=1e-9)
    assert np.all(path[:, 4:] == START[4:]), "the other arm stays on its own way"
    assert np.abs(np.diff(path, axis=0)).max() <= config.detour_speed * DT + 1e-9
    hands = np.array([descent.forward(q, BODY)[0].copy() for q in path])
    assert np.linalg.norm(np.diff(hands, axis=0), axis=1).max() <= config.hand_speed * DT * 1.05


def test_a_way_through_the_body_is_not_taken_and_one_around_it_is_found():
    """From in front of the chest to behind the back, with the elbow bent: the straight line cuts the trunk."""
    _, descent, detours = make()
    before = np.array([-0.9, -0.1, -1.2, 0.9, *START[4:]])
    behind = np.array([1.1, -0.2, -0.9, 0.4, *START[4:]])
    straight = [before + part * (behind - before) for part in np.linspace(0.0, 1.0, 30)]

    def clearance(q):
        descent.forward(q, BODY)
        return descent.clearance()[0]

    assert clearance(before) > 0.0
    assert clearance(behind) > 0.0
    assert min(map(clearance, straight)) < -0.01, "the straight way must be blocked"
    detours.look(0, before, behind, BODY)
    assert not detours.active.any()
    for _ in load_robot().arm_postures:
        if not detours.active[0]:
            detours.look(0, before, behind, BODY)
    assert detours.active[0]
    path = drive(detours, descent, before, behind)
    assert path[-1] == pytest.approx(behind, abs=0.03)
    assert min(map(clearance, path)) > -0.02


def test_a_detour_is_left_when_the_other_arm_has_come_into_its_way():
    """Where arms may not go they do not go: the clearance stays positive with the right arm across the route."""
    _, descent, detours = make()
    detours.look(0, START, FORWARD, BODY)
    assert detours.active[0]
    across = np.array([*START[:4], -1.6, -0.2, 1.0, 0.8])
    posture = np.array([*FORWARD[:4], *across[4:]])
    path = drive(detours, descent, across, posture)
    least = np.inf
    for q in path:
        descent.forward(q, BODY)
        least = min(least, *descent.clearance())
    assert least > 0.0
    assert not detours.active.any() and np.abs(path[-1] - posture).max() > 0.2
    detours.look(0, path[-1], posture, BODY)
    assert not detours.active.any(), "and is not taken again"


def test_arms_that_always_touch_something_are_refused_instead_of_tried_without_end(monkeypatch):
    monkeypatch.setattr(detour, "TRIES", 50)
    vast = {"torso_link": (Capsule((0.0, 0.0, 0.3), 0.9, 0.1),)}
    with pytest.raises(ModelError, match="h1 touches something in all of 50 random postures; give smaller"):
        posture_table(dataclasses.replace(load_robot(), capsules=vast))

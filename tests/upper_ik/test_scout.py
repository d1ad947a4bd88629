"""The search ahead of the arms: where the direct way ends, and what another posture reaches."""

import numpy as np
import pytest

from hugwbc.upper_ik import ArmIK
from hugwbc.upper_ik.config import ArmIKConfig
from hugwbc.upper_ik.scout import STARTS, Scout

MIRROR = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 1.0]])
AHEAD = np.array([0.3, 0.25, 0.2]) * MIRROR


def _search(scout, robot, goal, q, ticks=300):
    """Search for both arms until all is done; the number of ticks that took."""
    for tick in range(ticks):
        for arm in range(2):
            scout.search(arm, goal, q, robot.nominal)
        if scout.done.all():
            return tick
        scout.advance(goal, robot.nominal)
    raise AssertionError("the search does not end")


def test_a_target_that_the_direct_way_reaches_ends_the_search_there(robot):
    scout, q = Scout(ArmIKConfig()), robot.nominal[robot.arms]
    _search(scout, robot, AHEAD, q)
    assert np.all(scout.direct <= scout._descent.config.tolerance)
    assert ArmIK().hands(scout.q, 0.0) == pytest.approx(AHEAD, abs=0.01)


def test_out_of_reach_it_tries_every_start_and_keeps_the_best(robot):
    scout, q = Scout(ArmIKConfig()), robot.nominal[robot.arms]
    far = np.array([1.5, 0.2136, 0.4389]) * MIRROR
    _search(scout, robot, far, q)
    # 1.5 m ahead of the shoulders' height, whose arms are 0.613 m long.
    found = np.linalg.norm(ArmIK().hands(scout.q, 0.0) - far, axis=1)
    assert found == pytest.approx([1.5 - 0.613] * 2, abs=0.03)
    assert np.all(found <= scout.direct + 1e-6)
    assert all(len(starts) == 0 for starts in scout._starts) and STARTS > 0


def test_a_dead_end_of_the_direct_way_is_left_for_a_better_posture(robot):
    """From postures all over the workspace: somewhere descent alone stays decimetres off, and the scout does not."""
    ik, rng = ArmIK(), np.random.default_rng(0)
    gained = []
    for _ in range(12):
        q, goal_q = rng.uniform(ik.lower, ik.upper), rng.uniform(ik.lower, ik.upper)
        if min(ik.clearance(q).min(), ik.clearance(goal_q).min()) < 0.02:
            continue
        goal = ik.hands(goal_q, 0.0).copy()
        scout = Scout(ArmIKConfig())
        _search(scout, robot, goal, q)
        best = np.linalg.norm(ik.hands(scout.q, 0.0) - goal, axis=1)
        assert np.all(best <= scout.direct + 0.01), "never worse than the direct way"
        gained.append(np.max(scout.direct - best))
    assert len(gained) >= 3 and max(gained) > 0.1


def test_a_target_that_moves_starts_the_search_over_and_one_that_creeps_does_not(robot):
    scout, q = Scout(ArmIKConfig()), robot.nominal[robot.arms]
    _search(scout, robot, AHEAD, q)
    scout.search(0, AHEAD + np.array([0.03, 0.0, 0.0]), q, robot.nominal)
    assert scout.done.all()
    scout.search(0, AHEAD + np.array([0.06, 0.0, 0.0]), q, robot.nominal)
    assert scout.done.tolist() == [False, True] and scout.direct[0] == np.inf
    assert np.array_equal(scout.q[:4], q[:4]), "from where the arm is"


def test_a_reset_leaves_nothing_of_the_searches_before(robot):
    scout, q = Scout(ArmIKConfig()), robot.nominal[robot.arms]
    _search(scout, robot, np.array([1.5, 0.2136, 0.4389]) * MIRROR, q)
    scout.reset(q)
    assert np.array_equal(scout.q, q) and not scout.done.any()
    fresh = Scout(ArmIKConfig())
    assert _search(scout, robot, AHEAD, q) == _search(fresh, robot, AHEAD, q)
    assert np.array_equal(scout.q, fresh.q)

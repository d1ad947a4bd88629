"""Steps down the distance to the hand targets: how fast, how far, and within what."""

import math

import numpy as np
import pytest

from hugwbc.upper_ik.arm_solver import ArmIKConfig
from hugwbc.upper_ik.descent import Descent, Goal

CONFIG = ArmIKConfig()
DT = 0.02


@pytest.fixture
def descent(robot):
    descent = Descent(CONFIG, robot)
    descent.place(robot.nominal[robot.arms], robot.nominal)
    return descent


def test_a_hand_slows_down_so_that_it_could_stop_at_its_target(descent):
    """At a distance d it goes at most sqrt(2 a d), and never faster than the hand's speed."""
    goal = Goal(descent.hands + np.array([0.2, 0.0, 0.1]))
    for _ in range(60):
        before, distance = descent.hands, descent.residual
        descent.descend(goal, DT, 1)
        gone = np.linalg.norm(descent.hands - before, axis=1)
        if np.isfinite(distance).all():
            braking = np.sqrt(2.0 * CONFIG.hand_deceleration * distance)
            assert np.all(gone <= np.minimum(CONFIG.hand_speed, braking) * DT + 1e-4)
    assert np.all(descent.residual < 1e-3) and not descent.stalled.any()


def test_near_something_to_touch_it_goes_only_as_fast_as_it_can_stop(descent):
    room = 0.02
    stopping = math.sqrt(2.0 * CONFIG.collision_deceleration * room)
    inside = descent.stoppable(CONFIG.collision_margin + room)
    assert inside == pytest.approx(min(max(stopping, CONFIG.touch_speed), CONFIG.hand_speed))
    assert descent.stoppable(-0.1) == CONFIG.touch_speed
    assert descent.stoppable(10.0) == CONFIG.hand_speed


def test_next_to_something_a_target_that_moves_makes_the_hand_no_faster(descent, robot):
    q = robot.nominal[robot.arms].copy()
    q[2] = -0.55  # the left forearm is next to the chest
    descent.place(q, robot.nominal)
    room = descent.clearance()[0]
    assert CONFIG.collision_margin < room < 0.02
    before = descent.hands
    inward = before + np.array([[0.0, -0.1, 0.0], [0.0, 0.0, 0.0]])
    descent.descend(Goal(inward, speed=np.array([1.0, 0.0])), DT, 1)
    assert np.linalg.norm(descent.hands - before, axis=1)[0] <= descent.stoppable(room) * DT + 1e-6

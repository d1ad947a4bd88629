import numpy as np
import pytest

from hugwbc.robot import load_robot
from hugwbc.upper_ik.config import ArmIKConfig
from hugwbc.upper_ik.descent import Descent
from hugwbc.upper_ik.detour import WAYS, Detours

DT = 0.02
BODY = load_robot().nominal
START = np.array([0.0, 0.1, 0.0, 0.0, 0.0, -0.1, 0.0, 0.0])
FORWARD = np.array([-1.2, 0.2, 0.0, 0.6, 0.0, -0.1, 0.0, 0.0])


def make():
    config = ArmIKConfig()
    descent = Descent(config)
    return config, descent, Detours(config, descent)


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
    for _ in WAYS[1:]:
        if not detours.active[0]:
            detours.look(0, before, behind, BODY)
    assert detours.active[0]
    path = drive(detours, descent, before, behind)
    assert path[-1] == pytest.approx(behind, abs=0.03)
    assert min(map(clearance, path)) > -0.02


def test_what_is_forgotten_is_left():
    _, _, detours = make()
    detours.look(0, START, FORWARD, BODY)
    detours.forget(0)
    assert not detours.active.any()
    detours.look(0, START, FORWARD, BODY)
    assert detours.count == 2

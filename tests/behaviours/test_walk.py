"""Walks of a point that follows its commands, without physics."""

import dataclasses

import numpy as np
import pytest
from behaviour_helpers import view

from hugwbc.behaviours import Behaviour, BehaviourSource, Status, face, walk_to
from hugwbc.behaviours.walk import POSITION_TOLERANCE
from hugwbc.gait import Gait
from hugwbc.robot import load_robot

DT = 0.02


def _walk(jump: tuple[float, float]) -> tuple[np.ndarray, int]:
    """Walk without turning; each stop moves the robot by `jump` [m]. Return where it ends and the number of stops."""
    place, stops = np.zeros(2), 0
    now, walk = view(), BehaviourSource(lambda view: walk_to(view, (0.4, 0.2), 0.0))
    while True:
        before, action = now.last.command, walk.act(now)
        if walk.status is not Status.RUNNING:
            assert walk.status is Status.SUCCESS, walk.reason
            return place, stops
        command = action.command
        if before.gait is Gait.WALKING and command.gait is Gait.STANDING:
            place, stops = place + np.array(jump), stops + 1
        place = place + DT * np.array([command.v_x, command.v_y])
        now = view(now.time + DT, position=(*place.tolist(), 0.98), last=action)


@pytest.mark.parametrize("jump", [(0.08, 0.0), (-0.05, 0.06)])
def test_a_walk_aims_off_by_what_a_stop_has_moved_the_robot(jump: tuple[float, float]) -> None:
    place, stops = _walk(jump)
    assert np.hypot(*(place - (0.4, 0.2))) < 0.5 * POSITION_TOLERANCE
    assert stops == 2, "the first stop shows it, the second makes up for it"


def test_a_walk_whose_stops_move_nothing_stands_once() -> None:
    assert _walk((0.0, 0.0))[1] == 1


@pytest.mark.parametrize(("robot", "swing"), [(None, 0.15), ("h1", 0.15), ("g1", 0.12)])
def test_a_walk_has_the_swing_height_of_the_robot(robot: str | None, swing: float) -> None:
    now = view(robot=None if robot is None else load_robot(robot))
    action = next(walk_to(now, (0.4, 0.2)))
    assert action.command.gait is Gait.WALKING and action.command.l == pytest.approx(swing)


def _held(behaviour: Behaviour, times: tuple[float, float], felt: float = 0.0) -> tuple[BehaviourSource, float, float]:
    """Hold a robot between two times [s]; return its behaviour, the farthest x [m], and the last time [s]."""
    pose, farthest = np.zeros(3), 0.0
    now, walk = view(), BehaviourSource(behaviour)
    while (action := walk.act(now)) and walk.status is Status.RUNNING:
        speed = action.command.array()[:3] * (not times[0] < now.time < times[1])
        pose, farthest = pose + DT * speed, max(farthest, pose[0])
        now = view(now.time + DT, position=(pose[0], pose[1], 0.98), yaw=pose[2], last=action)
        force = np.full((2, 3), [0.5 * felt, 0.0, 0.0])
        velocity, rate = np.array([speed[0], speed[1], 0.0]), np.array([0.0, 0.0, speed[2]])
        state = dataclasses.replace(now.state, velocity=velocity, angular_velocity=rate)
        now = dataclasses.replace(now, state=state, hand_force=force)
    return walk, farthest, now.time


def test_a_walk_that_was_held_does_not_pass_its_goal() -> None:
    walk, farthest, _ = _held(lambda view: walk_to(view, (0.5, 0.0), 0.0, speed=0.1), (2.5, 5.4))
    assert walk.status is Status.SUCCESS, walk.reason
    assert farthest < 0.5 + 0.01, "what was learnt while it was held has made it too fast"


@pytest.mark.parametrize("times", [(2.5, 60.0), (0.0, 60.0)])
def test_a_walk_against_a_wall_ends_with_the_words_stuck(times: tuple[float, float]) -> None:
    walk, _, end = _held(lambda view: walk_to(view, (1.0, 0.0), 0.0, speed=0.2), times)
    assert walk.reason.startswith("walk to: stuck: has not moved for 3 s while commanded ")
    assert end < 6.0, "not the timeout of 45 s"


def test_a_robot_that_pushes_something_with_its_hands_pushes_on() -> None:
    """A door with a strong closer gives way after a while: it is walked against ever faster."""
    walk, _, _ = _held(lambda view: walk_to(view, (1.0, 0.0), 0.0, speed=0.2), (2.5, 9.0), felt=-20.0)
    assert walk.status is Status.SUCCESS, walk.reason


def test_a_turn_that_is_held_ends_with_the_words_stuck() -> None:
    walk, _, end = _held(lambda view: face(view, yaw=2.0), (2.2, 60.0))
    assert walk.reason.startswith("face: stuck: has not turned for 3 s while commanded ") and end < 7.0


def test_a_walk_that_keeps_its_yaw_goes_sideways_instead_of_turning_to_face_its_way() -> None:
    def asked(keep_yaw: bool):
        return BehaviourSource(lambda view: walk_to(view, (0.0, 1.0), keep_yaw=keep_yaw)).act(view()).command

    assert asked(False).omega > 0.3 and asked(False).v_y == 0.0
    assert asked(True).omega == 0.0 and asked(True).v_y > 0.1
    walk, farthest, _ = _held(lambda view: walk_to(view, (-1.0, 1.0), keep_yaw=True), (0.0, 0.0))
    assert walk.status is Status.SUCCESS and farthest < 0.05, "it never walked ahead"

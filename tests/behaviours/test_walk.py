"""Walks of a point that follows its commands, without physics."""

import dataclasses

import numpy as np
import pytest
from behaviour_helpers import view

from hugwbc import rotations
from hugwbc.behaviours import Behaviour, BehaviourSource, Course, Status, View, face, walk_to
from hugwbc.behaviours.source import CommandRamp
from hugwbc.behaviours.walk import POSITION_TOLERANCE
from hugwbc.commands import Command
from hugwbc.gait import Gait
from hugwbc.robot import load_robot
from hugwbc.stride import MidStance

DT = 0.02


def _walks(
    jump: tuple[float, float, float],
    *goals: tuple[float, float],
    felt: bool = True,
    stepping: float = 0.0,
    known: bool = False,
) -> list[list[float]]:
    """Walk to goals with heading 0, and return the times of the stops on the way to each [s].

    Each stop moves the robot by `jump`, heading frame [m, m, rad], mirrored if it is on the right foot; the controller
    may know it. The feet take turns every quarter of a second if the robot goes as fast as `stepping` [m/s], and their
    forces may be felt.
    """

    def course(view: View) -> Course:
        for x, y in goals:
            stops.append([])
            view = yield from walk_to(view, (x, y), 0.0)
            error = np.hypot(*(view.position[:2] - (x, y)))
            assert error < (0.5 if len(stops[-1]) > 1 else 1.0) * POSITION_TOLERANCE, error
        return view

    stops: list[list[float]] = []
    pose, speed, now, walk = np.zeros(3), np.zeros(3), view(), BehaviourSource(course)
    left, moment = True, MidStance()
    while walk.status is Status.RUNNING:
        before = walk.action.command
        left = now.time % 0.5 < 0.25 if np.hypot(*speed[:2]) >= stepping else left
        force = np.zeros((2, 3))
        force[0 if left else 1, 2] = 500.0
        turn = rotations.rotation_z(pose[2])
        velocity, rate = turn @ np.array([speed[0], speed[1], 0.0]), np.array([0.0, 0.0, speed[2]])
        sensed = {"velocity": velocity, "angular_velocity": rate, "foot_force": force if felt else None}
        state = dataclasses.replace(now.state, **sensed)
        told = {"stop": np.array(jump if known else (0.0, 0.0, 0.0))}
        told |= {"mid_stance": moment(now.time, state.foot_force, 0.5)}
        walk.see(dataclasses.replace(now, state=state, **told))
        speed = walk.action.command.array()[:3]
        moved = DT * speed
        if before.gait is Gait.WALKING and walk.action.command.gait is Gait.STANDING:
            stops[-1].append(now.time)
            moved = moved + np.array(jump) * (1.0 if left else (1.0, -1.0, -1.0))
        pose = pose + np.array([*(turn[:2, :2] @ moved[:2]), moved[2]])
        now = view(now.time + DT, position=(pose[0], pose[1], 0.98), yaw=pose[2])
    assert walk.status is Status.SUCCESS, walk.reason
    return stops


@pytest.mark.parametrize("jump", [(0.08, 0.0, 0.0), (-0.05, 0.06, 0.0), (0.07, -0.03, 0.1)])
def test_walks_aim_off_by_what_stops_have_moved_the_robot(jump: tuple[float, float, float]) -> None:
    stops = _walks(jump, (0.4, 0.2), (1.0, 0.2), (0.5, -0.3))
    assert list(map(len, stops)) == [2, 1, 1], "the first stop shows it, all others make up for it"
    stance = np.concatenate(stops) % 0.5
    assert ((stance > 0.09) & (stance < 0.16)).all(), "on the left foot: one on the right moves the robot otherwise"


def test_the_first_walk_aims_off_by_what_the_controller_knows_of_its_stops() -> None:
    assert list(map(len, _walks((0.07, -0.03, 0.1), (0.4, 0.2), (1.0, 0.2), known=True))) == [1, 1]


def test_a_robot_that_does_not_step_on_the_spot_still_stops() -> None:
    """Some people's policies stand still where they are told to walk at 0 m/s."""
    assert list(map(len, _walks((0.0, 0.0, 0.0), (0.4, 0.2), stepping=0.02))) == [1]


def test_walks_aim_off_where_the_forces_on_the_feet_are_not_known() -> None:
    assert list(map(len, _walks((0.08, 0.0, 0.0), (0.4, 0.2), (1.0, 0.2), felt=False))) == [2, 1]


def test_a_walk_whose_stops_move_nothing_stands_once() -> None:
    assert list(map(len, _walks((0.0, 0.0, 0.0), (0.4, 0.2)))) == [1]


@pytest.mark.parametrize(("robot", "swing"), [(None, 0.15), ("h1", 0.15), ("g1", 0.12)])
def test_a_walk_has_the_swing_height_of_the_robot(robot: str | None, swing: float) -> None:
    now = view(robot=None if robot is None else load_robot(robot))
    action = next(walk_to(now, (0.4, 0.2)))
    assert action.command.gait is Gait.WALKING and action.command.l == pytest.approx(swing)


def _held(behaviour: Behaviour, times: tuple[float, float], felt: float = 0.0) -> tuple[BehaviourSource, float, float]:
    """Hold a robot between two times [s]; return its behaviour, the farthest x [m], and the last time [s]."""
    pose, farthest = np.zeros(3), 0.0
    now, walk = view(), BehaviourSource(behaviour)
    while walk.status is Status.RUNNING:
        walk.see(now)
        speed = walk.action.command.array()[:3] * (not times[0] < now.time < times[1])
        pose, farthest = pose + DT * speed, max(farthest, pose[0])
        now = view(now.time + DT, position=(pose[0], pose[1], 0.98), yaw=pose[2])
        force = np.full((2, 3), [0.5 * felt, 0.0, 0.0])
        velocity, rate = np.array([speed[0], speed[1], 0.0]), np.array([0.0, 0.0, speed[2]])
        state = dataclasses.replace(now.state, velocity=velocity, angular_velocity=rate)
        now = dataclasses.replace(now, state=state, hand_force=force)
    return walk, farthest, now.time


def test_a_walk_that_was_held_does_not_pass_its_goal() -> None:
    walk, farthest, _ = _held(lambda view: walk_to(view, (0.5, 0.0), 0.0, speed=0.1), (2.5, 5.4))
    assert walk.status is Status.SUCCESS, walk.reason
    assert farthest < 0.5 + 0.01, "what was learnt while it was held has made it too fast"


def test_half_a_turn_is_not_done_at_once() -> None:
    """Noise changes the sign of the angle that is left, whose mean is then zero."""
    now = view()
    turn = face(now, yaw=np.pi, stand=False)
    next(turn)
    for tick in range(1, 50):
        turn.send(view(DT * tick, yaw=0.01 * (-1) ** tick))
    with pytest.raises(StopIteration):
        for tick in range(50, 500):
            turn.send(view(DT * tick, yaw=(-1) ** tick * (np.pi - 0.01)))


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


def test_a_walk_begins_with_the_lag_that_the_last_one_has_shown() -> None:
    """A point that walks ahead by 0.06 m/s slower than it is told."""
    lags = []

    def course(view: View) -> Course:
        for x in (0.5, 1.0):
            lags.append(float(view.lag[0]))
            view = yield from walk_to(view, (x, 0.0), 0.0)
        return view

    pose, now, walk = 0.0, view(), BehaviourSource(course)
    while walk.status is Status.RUNNING:
        walk.see(now)
        command = walk.action.command
        speed = (command.v_x - 0.06) * (command.gait is Gait.WALKING)
        pose += DT * speed
        now = view(now.time + DT, position=(pose, 0.0, 0.98))
        now = dataclasses.replace(now, state=dataclasses.replace(now.state, velocity=np.array([speed, 0.0, 0.0])))
    assert walk.status is Status.SUCCESS, walk.reason
    assert lags == [0.0, pytest.approx(0.06, abs=0.01)]


def test_a_robot_that_lags_is_kept_in_its_place_until_it_stands() -> None:
    """Without the lag in its command it would go back by 0.16 m/s while it steps on the spot before a stand."""
    ramp, lag, at = CommandRamp(), np.array([0.16, 0.0, 0.0]), []
    walk = Command(v_x=0.36, gait=Gait.WALKING)
    for tick in range(200):
        command = ramp(walk if tick < 100 else Command(), DT, lag)
        if tick >= 100:
            at.append(command.v_x)
        if command.gait is Gait.STANDING:
            break
    assert command == Command() and min(at[:-1]) == pytest.approx(lag[0])
    assert 0.5 < DT * len(at) < 1.1, "it slows down, steps on for a while, and stands"


@pytest.mark.parametrize("gait", [Gait.JUMPING, Gait.HOPPING_LEFT])
def test_a_robot_that_lags_in_walks_stands_after_a_leap(gait) -> None:
    ramp, lag, ticks = CommandRamp(), np.array([0.15, 0.0, 0.0]), 0
    leap = Command(v_x=0.3, gait=gait)
    for _ in range(100):
        ramp(leap, DT, lag)
    while ramp(Command(), DT, lag).gait is not Gait.STANDING:
        ticks += 1
        assert DT * ticks < 2.0

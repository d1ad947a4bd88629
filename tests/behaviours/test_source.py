"""A behaviour as a source of commands: soft changes, the end, and errors that stop nothing."""

import dataclasses

import numpy as np
import pytest
from behaviour_helpers import view

from hugwbc.behaviours import Action, BehaviourSource, Failure, Status, retry, wait
from hugwbc.behaviours.source import ACCELERATION, FARTHEST, RAN_AWAY, STEP_OUT
from hugwbc.commands import Command
from hugwbc.gait import Gait
from hugwbc.scripts.view import Grip
from hugwbc.targets import HandTargets


def march(view, end: Exception | None = None):
    """Walk fast for a second with the hands on targets, then end at once as told."""
    while view.time < 1.0:
        hands = HandTargets.of((1.3, 0.2, 1.0), (1.3, -0.2, 1.0), "world")
        view = yield Action(Command(v_x=0.5, omega=0.3, gait=Gait.WALKING), hands, doing="march")
    if end is not None:
        raise end
    return view


def _played(source: BehaviourSource, seconds: float = 5.0) -> list[Command]:
    """Play a behaviour for a robot that is as fast as it is told."""
    commands = []
    for tick in range(round(seconds / 0.02)):
        now, (v_x, v_y, omega, *_) = view(0.02 * tick, position=(1.0, 0.0, 0.98)), source.action.command.array()
        moves = {"velocity": np.array([v_x, v_y, 0.0]), "angular_velocity": np.array([0.0, 0.0, omega])}
        source.see(dataclasses.replace(now, state=dataclasses.replace(now.state, **moves)))
        commands.append(source.command_at(0.02 * tick))
    return commands


def test_a_walk_starts_and_stops_softly_and_steps_on_before_it_stands() -> None:
    source = BehaviourSource(march)
    commands = _played(source)
    speed = np.array([command.array()[:3] for command in commands])
    gaits = [command.gait for command in commands]
    step = np.abs(np.diff(speed, axis=0)).max(axis=0)
    assert step[[0, 2]] == pytest.approx(ACCELERATION[[0, 2]] * 0.02) and step[1] == 0.0
    assert speed.max(axis=0)[0] == pytest.approx(0.5)
    stood = gaits.index(Gait.STANDING, 10)
    slow = int(np.argmax(np.abs(speed[50:, 0]) <= 0.1)) + 50
    assert 0.02 * (stood - slow) == pytest.approx(STEP_OUT, abs=0.05)
    assert not speed[stood:].any()
    assert source.done and source.status is Status.SUCCESS and source.ending == "done"


def test_at_the_end_the_hands_stay_with_the_robot() -> None:
    source = BehaviourSource(march)
    _played(source)
    hands = source.hands_at(5.0)
    assert hands is not None and hands.left is not None and hands.frame == "heading"
    np.testing.assert_allclose(hands.left, [0.3, 0.2, 0.02], atol=1e-9)


@pytest.mark.parametrize("end", [Failure("out of breath"), ValueError("a mistake")])
def test_a_failure_and_an_error_end_it_and_stop_nothing(end: Exception) -> None:
    source = BehaviourSource(lambda view: march(view, end))
    commands = _played(source)
    assert source.status is Status.FAILURE
    assert str(end) in source.reason and str(end) in source.ending
    assert commands[-1].gait is Gait.STANDING and source.done


def yields_a_step(view):
    yield wait(view, 1.0)


def keeps_a_step(view):
    view = wait(view, 1.0)
    view = yield from wait(view, 1.0)  # pyright: ignore[reportArgumentType]


def retries_a_step(view):
    yield from retry(view, wait(view, 1.0))  # pyright: ignore[reportArgumentType]


def yields_nothing(view):
    return None


@pytest.mark.parametrize("mistaken", [yields_a_step, keeps_a_step, retries_a_step, yields_nothing])
def test_a_step_that_is_not_run_says_how_to_run_it(mistaken) -> None:
    source = BehaviourSource(mistaken)
    commands = _played(source)
    assert source.status is Status.FAILURE and "yield from STEP(view" in source.reason
    assert commands[-1].gait is Gait.STANDING


@pytest.mark.parametrize(("parts", "reason"), [
    ({"command": {"v_x": 0.3}}, "command is no Command"),
    ({"hands": np.zeros((2, 3))}, "hands are neither HandTargets nor None"),
    ({"grips": Grip("left", "cup")}, "grips are no tuple of Grip"),
    ({"grips": ("left", "cup")}, "grips are no tuple of Grip"),
])  # fmt: skip
def test_an_action_of_wrong_parts_ends_it(parts, reason) -> None:
    def mistaken(view):
        while True:
            yield Action(**parts)

    source = BehaviourSource(mistaken)
    assert _played(source, 0.1)[-1].gait is Gait.STANDING
    assert source.status is Status.FAILURE and source.reason == f"it yielded an Action whose {reason}"


def test_it_begins_again_after_a_restart() -> None:
    source = BehaviourSource(lambda view: march(view, Failure("tired")))
    _played(source)
    source.restart()
    assert source.status is Status.RUNNING and source.reason == ""
    assert _played(source, 0.5)[-1].v_x > 0.2
    assert source.doing == "march"


def test_numbers_that_are_not_finite_do_not_reach_the_robot_and_end_it() -> None:
    def broken(view):
        yield Action()
        while True:
            yield Action(Command(v_x=float("nan"), omega=float("inf"), gait=Gait.WALKING))

    source = BehaviourSource(broken)
    source.see(view())
    assert source.ending == "not done: was still running", "no words say at what"
    assert all(np.isfinite(command.array()).all() for command in _played(source, 1.0))
    assert source.status is Status.FAILURE and "a command that is not finite: Command(v_x=nan" in source.reason


@pytest.mark.parametrize(("way", "status"), [(1.04, Status.FAILURE), (0.8 * FARTHEST, Status.SUCCESS)])
def test_a_behaviour_whose_robot_runs_away_while_told_to_stand_has_failed(way: float, status: Status) -> None:
    source = BehaviourSource(lambda view: wait(view, 4.0))
    for time in np.arange(0.0, 4.5, 0.02):
        source.see(view(time, position=(np.interp(time, [2.0, 3.3], [1.3, 1.3 - way]), 0.0, 0.98)))
    assert source.status is status
    assert source.reason == (f"{RAN_AWAY}, by 1.04 m" if status is Status.FAILURE else "")


def test_a_walk_is_not_running_away() -> None:
    source = BehaviourSource(march)
    for time in np.arange(0.0, 5.0, 0.02):
        walked = 0.5 * min(time, 2.5)  # it walks, steps out and comes to rest
        source.see(view(time, position=(walked, 0.0, 0.98)))
    assert source.status is Status.SUCCESS


@pytest.mark.parametrize(("broken", "let_go", "reason"), [
    (True, False, "a force broke the grip of the right hand on 'cup'"),
    (False, False, ""),
    (True, True, ""),
])  # fmt: skip
def test_a_grip_that_a_force_broke_is_told_in_the_end(broken: bool, let_go: bool, reason: str) -> None:
    def take(view):
        view = yield Action(grips=(Grip("right", "cup"),))
        view = yield from wait(view, 0.5)
        if let_go:
            view = yield Action(grips=(Grip("right", None),))
        return (yield from wait(view, 1.0))

    source = BehaviourSource(take)
    for time in np.arange(0.0, 2.0, 0.02):
        held = "cup" if time > 0.03 and not (broken and time > 0.8) else None
        source.see(view(time, held=(None, held)))
    assert source.reason == reason and source.status is (Status.FAILURE if reason else Status.SUCCESS)

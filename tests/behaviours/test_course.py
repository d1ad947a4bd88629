"""Behaviours made of others, their ends and their reasons."""

import math
from functools import partial

import numpy as np
import pytest
from behaviour_helpers import objects, view

from hugwbc.behaviours import (
    Action,
    Behaviour,
    BehaviourSource,
    BoxGrip,
    Course,
    Failure,
    Status,
    View,
    doing,
    glide,
    grip,
    lift,
    parallel,
    press,
    pull,
    reach,
    release,
    retry,
    seen,
    squeeze,
    stand,
    step,
    wait,
    wait_until,
    walk_to,
    wipe,
)
from hugwbc.commands import Command
from hugwbc.errors import ConfigError, HugwbcError
from hugwbc.extensions import run_file
from hugwbc.gait import Gait
from hugwbc.targets import HandTargets


@step
def count(view: View, ticks: int, *, fails: bool = False, v_x: float = 0.1, timeout: float = 9.0) -> Course:
    """Run for a number of ticks, then fail if told to."""
    for tick in range(ticks):
        hands = HandTargets.of((v_x, 0, 0), None)
        view = yield Action(Command(v_x=v_x, gait=Gait.WALKING), hands, progress=f"{tick} of {ticks}")
    if fails:
        raise Failure("too far")
    return view


def run(behaviour: Behaviour, ticks: int = 200, **more: object) -> tuple[list[Action], BehaviourSource]:
    """Run to the end at 50 Hz, without soft starts; return the actions."""
    source, actions = BehaviourSource(behaviour), []
    for tick in range(ticks):
        actions.append(source.act(view(0.02 * tick, **more)))
        if source.status is not Status.RUNNING:
            return actions, source
    raise AssertionError("does not end")


def test_no_tick_is_lost_between_steps_and_the_robot_then_stands() -> None:
    def both(view: View) -> Course:
        view = yield from count(view, 2, v_x=0.1)
        return (yield from count(view, 1, v_x=0.2))

    actions, source = run(both)
    assert [action.command.v_x for action in actions] == [0.1, 0.1, 0.2, 0.0]
    assert actions[-1].command.gait is Gait.STANDING
    assert source.ending == "done"


def test_a_failure_names_the_step_once() -> None:
    def outer(view: View) -> Course:
        return (yield from step(lambda view: count(view, 1, fails=True))(view))

    assert run(outer)[1].reason == "count: too far"


def test_a_step_ends_at_its_timeout_and_says_how_far_it_was() -> None:
    assert run(lambda view: count(view, 100, timeout=0.1))[1].reason == "count: timeout of 0.1 s: 5 of 100"
    waiting = lambda view: wait_until(view, lambda view: False, "a bell", timeout=1.0)  # noqa: E731
    assert run(waiting)[1].reason == "wait until: timeout of 1 s: a bell: 0.0 of 0 s"

    @step
    def job(view: View, *, timeout: float = 1.0) -> Course:
        view = yield from doing("count", count(view, 3))
        return (yield from doing("glide", glide(view, np.full((2, 3), 1.0), speed=0.1)))

    assert run(job)[1].reason == "job: timeout of 1 s: still at glide"


def test_what_the_robot_is_at_is_the_step_or_what_is_said() -> None:
    assert {action.doing for action in run(lambda view: count(view, 3))[0][:-1]} == {"count"}
    assert {action.doing for action in run(lambda view: doing("add", count(view, 3)))[0][:-1]} == {"add"}


def test_legs_and_hands_at_the_same_time() -> None:
    actions, _ = run(lambda view: parallel(view, count(view, 3, v_x=0.1), count(view, 1, v_x=0.5)))
    assert [action.command.v_x for action in actions] == [0.1, 0.1, 0.1, 0.0]
    assert actions[0].hands is not None and actions[0].hands.left is not None
    np.testing.assert_allclose(actions[0].hands.left, [0.5, 0, 0])
    failing = lambda view: parallel(view, count(view, 3), count(view, 1, fails=True))  # noqa: E731
    assert len(run(failing)[0]) == 2 and run(failing)[1].reason == "count: too far"


def test_retries_are_counted() -> None:
    actions, source = run(lambda view: retry(view, partial(count, ticks=1, fails=True), times=3))
    assert source.reason == "count: too far (tried 3 times)" and len(actions) == 6
    assert run(lambda view: retry(view, partial(count, ticks=2)))[1].status is Status.SUCCESS


def test_a_condition_has_to_hold_without_a_break() -> None:
    holds = lambda view: 0.2 <= view.time < 0.24 or view.time > 0.25  # noqa: E731
    actions, _ = run(lambda view: wait_until(view, holds, "time", hold=0.1))
    assert len(actions) == 13 + 5 + 1


def test_waiting_takes_its_time() -> None:
    assert len(run(lambda view: wait(view, 0.5))[0]) == 26


@pytest.mark.parametrize(("hold", "travel"), [(0.0, None), (0.0, 0.012), (4.0, 0.012)])
def test_a_press_lasts_from_when_the_object_has_given_way(hold: float, travel: float | None) -> None:
    source = BehaviourSource(lambda view: press(view, "bell", hold=hold, travel=travel))
    farthest, pressed = 0.0, 0
    for time in np.arange(0.0, 20.0, 0.02):
        given = 0.02 if farthest > 0.5 else 0.0
        pressed += given > 0.0
        action = source.act(view(float(time), objects=objects(bell=(0.5 + given, -0.2, 1.1))))
        if source.status is not Status.RUNNING:
            break
        assert action.hands is not None and action.hands.right is not None
        farthest = max(farthest, action.hands.right[0] + 0.04)
    assert source.status is Status.SUCCESS, source.reason
    assert farthest > 0.5 and 0.02 * pressed > hold


def test_an_object_that_is_not_there() -> None:
    def look(now: View) -> Course:
        return (yield Action(Command(h=float(seen(now, "crate").position[2]))))

    assert run(look)[1].reason == "object 'crate' is not seen; there are: none"
    there = objects(cup=(1.0, 0.0, 0.5))
    assert there.get("crate") is None and there.get("crate", 3) == 3 and there.get("cup").position[0] == 1.0
    assert "desk" in run(look, objects=objects(desk=(1.0, 0.0, 0.0)))[1].reason


@pytest.mark.parametrize(
    ("begin", "words"),
    [
        (lambda view: walk_to(view), "give one of them"),
        (lambda view: walk_to(view, before="desk", yaw=1.0), "give turn"),
        (lambda view: walk_to(view, (1.0, 0.0), turn=1.0), "aside and turn are relative to an object; give before"),
        (lambda view: walk_to(view, (1.0, 0.0), speed=3.0), "walk_to.speed is 3.0; it should be less"),
        (lambda view: walk_to(view, (1.0, 0.0), 90.0), "walk_to.yaw is 90"),
        (lambda view: walk_to(view, (1.0, 0.0), timeout=0.0), "walk_to.timeout is 0"),
        (lambda view: squeeze(view, "box", force=-1.0), "squeeze.force is -1"),
        (lambda view: lift(view, "box", math.nan), "lift.height is nan"),
        (lambda view: pull(view, "box", -0.3), "pull.distance is -0.3"),
        (lambda view: wait(view, math.nan), "seconds is nan"),
        (lambda view: wait(view, -1.0), "wait.seconds is -1.0; it should be greater"),
        (lambda view: grip(view, "bell", "left"), "grip.grips.0 is 'bell'; it should be"),
        (lambda view: retry(view, stand, times=0), "times is 0"),
        (lambda view: release(view, apart=math.inf), "release.apart is inf"),
        (lambda view: press(view, "bell", "both"), "Valid: left, right"),
        (lambda view: wipe(view, np.zeros((2, 3)), "both"), "Valid: left, right"),
        (lambda view: wipe(view, np.zeros((2, 3)), force=math.nan), "wipe.force is nan"),
        (lambda view: wipe(view, np.zeros((2, 3)), speed=-0.1), "wipe.speed is -0.1"),
        (lambda view: wipe(view, np.zeros((2, 2))), r"give finite points x, y, z, shape \(n, 3\)"),
    ],
)
def test_arguments_out_of_range_are_refused_before_the_first_tick(begin, words: str) -> None:
    with pytest.raises((HugwbcError, TypeError), match=words):
        next(begin(view()))


def test_an_unknown_argument_is_told_with_the_valid_ones() -> None:
    with pytest.raises(TypeError, match=r"count: .*'tick'; its arguments are view, ticks, fails, v_x, timeout"):
        count(view(), 3, tick=3)  # pyright: ignore[reportCallIssue]


def test_a_hand_target_out_of_the_world_is_refused_with_its_distance() -> None:
    far = lambda view: reach(view, left=(3.0, 0.0, 1.0), frame="world")  # noqa: E731
    assert run(far)[1].reason == "reach: the left hand's target is 3.0 m away (limit 1.5 m); walk there"


def test_a_box_that_the_hands_have_lost_is_not_put_down() -> None:
    put = partial(BoxGrip(0.3).put, name="box", goal=np.array([0.35, 0.0, 0.95]), yaw=0.0)
    held, lost = objects(box=(0.3, 0.0, 1.0)), objects(box=(0.3, 0.0, 0.6))
    assert run(put, objects=held)[1].status is Status.SUCCESS
    assert run(put, objects=lost)[1].reason == "'box' is 40 cm from the hands: it slipped out of them"


@pytest.mark.parametrize(("short", "nearer"), [(0.05, False), (0.15, True)])
def test_a_robot_whose_hands_end_far_from_a_box_comes_nearer(short: float, nearer: bool) -> None:
    """The robot stands where it should; only its hands are short of the box."""
    points = [(0.385 - short, side, 0.9) for side in (0.2, -0.2)]
    source, walked = BehaviourSource(partial(BoxGrip(0.3).take, name="box")), False
    for tick in range(1500):
        action = source.act(view(0.02 * tick, objects=objects(box=(0.41, 0.0, 0.9)), hands=points))
        walked = walked or action.command.v_x > 0.0
    assert walked == nearer


@pytest.mark.parametrize(
    "forgotten", [partial(count, ticks=3), partial(wait, seconds=1.0), partial(retry, behaviour=stand)]
)
def test_a_step_that_was_made_but_never_run_is_told_where_it_was_made(forgotten) -> None:
    def forgets(view: View) -> Course:
        forgotten(view)
        return (yield from count(view, 2))

    words = rf"write `view = yield from {forgotten.func.__name__}\(view, ...\)`"
    with pytest.warns(RuntimeWarning, match=words) as told:
        actions, source = run(forgets)
    assert len(told) == 1 and len(actions) == 3 and source.status is Status.SUCCESS
    assert told[0].filename == __file__


POSTPONED = """
from __future__ import annotations
from typing import Annotated
import numpy as np
from pydantic import Field
from hugwbc.behaviours import Course, View, step, wait
Share = Annotated[float, Field(ge=0, le=1)]
seen = []

@step
def nod(view: View, share: Share, at: np.ndarray = np.zeros(3), *names: str, places: list[str] = [], **more: float
        ) -> Course:
    seen.append((share, at.tolist(), names, list(places), more))
    places.append("kept")
    return (yield from wait(view, 0.1))
"""


def test_a_step_may_have_any_signature_of_python(tmp_path) -> None:
    (tmp_path / "own.py").write_text(POSTPONED)
    own = run_file(tmp_path / "own.py", "step")
    for _ in range(2):
        next(own.nod(view(), 0.5, np.array([1.0, 2.0, 3.0]), "a", fast=2.0))
    assert own.seen == [(0.5, [1.0, 2.0, 3.0], ("a",), [], {"fast": 2.0})] * 2
    with pytest.raises(ConfigError, match=r"nod\.share is 2"):
        own.nod(view(), 2.0)
    with pytest.raises(ConfigError, match=r"fast"):
        own.nod(view(), 0.5, fast="very")

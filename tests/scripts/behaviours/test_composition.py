"""Behaviours made of others, their ends and their reasons."""

import numpy as np
import pytest
from behaviour_helpers import objects, view

from hugwbc.commands import Command
from hugwbc.errors import ConfigError
from hugwbc.gait import Gait
from hugwbc.scripts.behaviours import (
    Action,
    Behaviour,
    Contact,
    Failure,
    ForceAbove,
    Lifted,
    OnFailure,
    Parallel,
    Retry,
    Sequence,
    Status,
    WaitUntil,
)
from hugwbc.targets import HandTargets


class Count(Behaviour):
    """Runs for a number of ticks, then fails if told to."""

    def __init__(self, ticks: int, *, fails: bool = False, v_x: float = 0.1) -> None:
        self.ticks, self.fails, self.v_x, self.begun = ticks, fails, v_x, 0

    def course(self, view):
        self.begun += 1
        for _ in range(self.ticks):
            hands = HandTargets.of((self.v_x, 0, 0), None)
            view = yield Action(Command(v_x=self.v_x, gait=Gait.WALKING), hands)
        if self.fails:
            raise Failure("counted too far")
        return view


def _run(behaviour: Behaviour, ticks: int = 100) -> list[Action]:
    """Run to the end at 50 Hz and return the actions."""
    actions = []
    behaviour.begin(view())
    for tick in range(ticks):
        actions.append(behaviour.update(view(0.02 * tick)))
        if behaviour.status is not Status.RUNNING:
            return actions
    raise AssertionError("does not end")


def test_a_sequence_loses_no_tick_between_its_steps() -> None:
    actions = _run(Sequence(Count(2, v_x=0.1), Count(1, v_x=0.2)))
    assert [action.command.v_x for action in actions] == [0.1, 0.1, 0.2, 0.0]
    assert actions[-1].command.gait is Gait.STANDING


def test_a_failure_ends_a_sequence_and_names_the_step() -> None:
    after = Count(1)
    behaviour = Sequence(Count(1), Count(1, fails=True), after)
    _run(behaviour)
    assert behaviour.status is Status.FAILURE
    assert behaviour.reason == "count: counted too far"
    assert after.begun == 0


def test_a_behaviour_can_begin_again() -> None:
    behaviour = Sequence(Count(1, fails=True))
    for _ in range(2):
        _run(behaviour)
        assert behaviour.status is Status.FAILURE
    behaviour.begin(view())
    assert (behaviour.status, behaviour.reason) == (Status.RUNNING, "")


def test_legs_and_hands_at_the_same_time() -> None:
    actions = _run(Parallel(Count(3, v_x=0.1), Count(1, v_x=0.5)))
    assert [action.command.v_x for action in actions[:3]] == [0.1, 0.1, 0.1]
    assert actions[0].hands is not None and actions[0].hands.left is not None
    np.testing.assert_allclose(actions[0].hands.left, [0.5, 0, 0])
    failing = Parallel(Count(3), Count(1, fails=True))
    assert len(_run(failing)) == 2
    assert failing.reason == "count: counted too far"


def test_retries_are_counted_and_something_is_done_between_them() -> None:
    child, between = Count(1, fails=True), Count(1)
    behaviour = Retry(child, times=3, between=between)
    _run(behaviour)
    assert (child.begun, between.begun) == (3, 2)
    assert behaviour.reason == "count: counted too far (tried 3 times)"
    with pytest.raises(ConfigError, match="1 or more"):
        Retry(child, times=0)


def test_a_failure_that_is_recovered_and_one_that_is_tidied_up() -> None:
    recovered = OnFailure(Count(1, fails=True), Count(1))
    _run(recovered)
    assert (recovered.status, recovered.reason) == (Status.SUCCESS, "")
    tidied = OnFailure(Count(1, fails=True), Count(1), recovers=False)
    _run(tidied)
    assert (tidied.status, tidied.reason) == (Status.FAILURE, "count: counted too far")


def test_a_timeout_says_what_was_waited_for_and_how_far_it_was() -> None:
    behaviour = WaitUntil(ForceAbove(5.0), timeout=1.0)
    _run(behaviour)
    assert behaviour.reason == "wait_until: timeout of 1 s: no force on the hands is known"


def test_a_condition_has_to_hold_without_a_break() -> None:
    behaviour = WaitUntil(Contact("left"), timeout=9.0, hold=0.1)
    behaviour.begin(view())
    ended = None
    for tick in range(100):
        force = 10.0 if tick != 12 and tick >= 10 else 0.0
        behaviour.update(view(0.02 * tick, hand_force=np.array([[0, 0, force], [0, 0, 0.0]])))
        if behaviour.status is Status.SUCCESS:
            ended = tick
            break
    assert ended == 13 + 5


def test_a_lifted_object_and_one_that_is_not_there() -> None:
    behaviour = WaitUntil(Lifted("box", 0.05))
    behaviour.begin(view(objects=objects(box=(1.0, 0.0, 0.8))))
    behaviour.update(view(objects=objects(box=(1.0, 0.0, 0.8))))
    assert behaviour.status is Status.RUNNING
    behaviour.update(view(0.1, objects=objects(box=(1.0, 0.0, 0.86))))
    assert behaviour.status is Status.SUCCESS
    missing = WaitUntil(Lifted("crate", 0.05))
    missing.begin(view())
    missing.update(view())
    assert missing.reason == "wait_until: object 'crate' is not seen; there are: none"


def test_an_empty_sequence_is_refused() -> None:
    with pytest.raises(ConfigError, match="at least one step"):
        Sequence()

"""The chain of commands: what it clamps, which combinations it changes, what it leaves alone, and that it says so."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from hugwbc import Command, Gait, command_ranges, load_robot
from hugwbc.commands import COMMAND_NAMES, CommandChange, default_command, sample_all
from hugwbc.runtime.command_chain import CommandChain, feasible
from hugwbc.runtime.safety_report import SafetyLog
from tests.conftest import make_state, mirror_command

ROBOT, G1 = load_robot(), load_robot("g1")
STEPPING = [gait for gait in Gait if gait is not Gait.STANDING]


@pytest.mark.parametrize("gait", list(Gait))
def test_one_command_alone_is_never_changed(gait):
    for name in COMMAND_NAMES:
        for value in np.linspace(*command_ranges(gait)[name].finishing, 20):
            command = dataclasses.replace(Command(gait=gait), **{name: value})
            assert feasible(command, ROBOT) == (command, ())


@pytest.mark.parametrize("gait", STEPPING)
def test_of_one_command_alone_shorter_legs_step_faster_at_speed(gait):
    changed = set()
    for name in COMMAND_NAMES:
        for value in np.linspace(*command_ranges(gait, G1)[name].finishing, 20):
            _, changes = feasible(dataclasses.replace(default_command(gait, G1), **{name: value}), G1)
            changed |= {(name, change.name) for change in changes}
    assert changed == (set() if gait.hops else {("v_x", "f")}), "hops are slow"


@pytest.mark.parametrize("gait", STEPPING)
def test_what_the_guard_gives_is_valid_and_passes_it_unchanged(gait):
    rng = np.random.default_rng(1)
    for row in sample_all(gait, rng, 300):
        guarded, report = feasible(Command.from_array(row, gait), ROBOT)
        guarded.validate()
        assert feasible(guarded, ROBOT) == (guarded, ())
        changed = {name for name in COMMAND_NAMES if getattr(guarded, name) != row[COMMAND_NAMES.index(name)]}
        assert {change.name for change in report} == changed
        assert all(change.used == getattr(guarded, change.name) for change in report)


def test_limits_by_hand():
    deep = Command(h=-0.25, l=0.3, gait=Gait.WALKING)
    guarded, report = feasible(deep, ROBOT)
    assert guarded == dataclasses.replace(deep, l=0.15)  # 0.35 - 0.25 is less than what is always left
    assert report == (CommandChange("l", 0.3, 0.15, "is not possible with h = -0.25 m and f = 2 Hz"),)
    assert str(report[0]) == "l = 0.3 is not possible with h = -0.25 m and f = 2 Hz: using 0.15"
    assert feasible(Command(h=-0.15, l=0.3, gait=Gait.WALKING), ROBOT)[0].l == pytest.approx(0.2)
    assert feasible(Command(f=3.5, l=0.35, gait=Gait.WALKING), ROBOT)[0].l == pytest.approx(1.9 / 3.5**2)
    # Steps of 0.3 m at most below 2 Hz: 1.08 m/s needs 1.8 Hz, 1.5 m/s needs 2 Hz.
    assert feasible(Command(v_x=1.08, f=1.5, gait=Gait.WALKING), ROBOT)[0].f == pytest.approx(1.8)
    assert feasible(Command(v_x=1.5, f=1.5, gait=Gait.WALKING), ROBOT)[0].f == pytest.approx(2.0)
    turning = feasible(Command(v_x=2.0, omega=-1.0, gait=Gait.WALKING), ROBOT)[0]
    assert turning.omega == pytest.approx(-0.6) and turning.v_x == 2.0
    aside = feasible(Command(v_x=1.2, v_y=-0.6, gait=Gait.WALKING), ROBOT)[0]
    assert aside.v_y == pytest.approx(-0.6 * math.sqrt(1.0 - 0.6**2))
    assert feasible(Command(v_x=-0.6, v_y=0.6, gait=Gait.WALKING), ROBOT)[0].v_y == 0.0


def test_a_robot_that_does_not_walk_backward_or_aside():
    only_ahead = {name: {"finishing": (0.0, end)} for name, end in (("v_x", 1.0), ("v_y", 0.0))}
    robot = dataclasses.replace(ROBOT, commands=only_ahead)
    for speed in (0.0, 0.6):
        command, _ = Command(v_x=speed, v_y=0.3, gait=Gait.WALKING).clamp(robot)
        assert feasible(command, robot)[0] == Command(v_x=speed, gait=Gait.WALKING)
    assert Command(v_x=-0.2, gait=Gait.WALKING).clamp(robot)[0] == Command(gait=Gait.WALKING)


def test_the_guard_keeps_to_the_ranges_of_the_robot():
    own = {"f": {"finishing": (1.5, 1.8)}, "l": {"finishing": (0.2, 0.35)}}
    robot = dataclasses.replace(ROBOT, commands=own)
    fast = Command(v_x=2.0, f=1.6, l=0.3, h=-0.3, gait=Gait.WALKING)
    guarded, _ = feasible(fast, robot)
    assert (guarded.f, guarded.l) == (1.8, 0.2)
    guarded.validate(robot)


def test_the_guard_is_the_same_in_a_mirror():
    rng = np.random.default_rng(2)
    for row in sample_all(Gait.WALKING, rng, 100):
        command = Command.from_array(row, Gait.WALKING)
        assert feasible(mirror_command(command), ROBOT)[0] == mirror_command(feasible(command, ROBOT)[0])


def chained(*commands):
    """Return what becomes of commands in succession, the chain, and its report."""
    log = SafetyLog()
    chain = CommandChain(log, ROBOT)
    return [chain(command, make_state(), 0.02, mid_stance=True) for command in commands], chain, log.report()


def test_out_of_range_commands_are_clamped_counted_and_never_passed_on():
    far = (Command(v_x=9.0, h=math.nan, gait=Gait.WALKING), Command(v_x=-9.0, gait=Gait.WALKING))
    passed, _, report = chained(*far)
    assert [command.v_x for command in passed] == [2.0, -0.6]
    assert passed[0].h == 0.0
    assert report.commands_clamped == {"v_x": 2, "h": 1}
    assert "outside -0.6 to 2" in report.messages[0]


def test_combinations_that_the_legs_do_not_allow_are_changed_counted_and_explained():
    asked = Command(v_x=1.5, f=1.5, l=0.3, h=-0.25, gait=Gait.WALKING)
    passed, chain, report = chained(asked, asked)
    assert passed[-1] == dataclasses.replace(asked, f=2.0, l=0.15)
    assert chain.command == asked, "errors are measured against what was asked"
    assert report.commands_guarded == {"f": 2, "l": 2} and report.commands_clamped == {}
    chain.reset()
    assert chain.command == Command(), "a robot that has been stood up again is not asked for anything yet"
    assert any("f = 1.5 is not possible at 1.5 m/s" in message for message in report.messages)


def test_a_walk_that_brakes_in_another_posture_does_not_lift_its_feet_too_high():
    high, low = Command(v_x=0.5, l=0.3, gait=Gait.WALKING), Command(h=-0.3)
    passed, _, report = chained(high, low, low)
    assert [(one.gait, one.l) for one in passed] == [(Gait.WALKING, 0.3), (Gait.WALKING, 0.15), (Gait.WALKING, 0.15)]
    assert report.commands_guarded == {"l": 2} and report.braked == 2


@settings(max_examples=200)
@given(
    values=st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=8, max_size=8),
    gait=st.sampled_from(list(Gait)),
)
def test_any_eight_numbers_reach_the_controller_in_range(values, gait):
    (passed,), _, _ = chained(Command(**dict(zip(COMMAND_NAMES, values, strict=True)), gait=gait))
    passed.validate()

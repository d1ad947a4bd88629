"""Commands: the paper's ranges, validation messages, clamping and sampling."""

import dataclasses
import math
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
import torch
from hypothesis import given, strategies as st

from hugwbc.commands import (
    COMMAND_NAMES,
    Command,
    CommandChange,
    CommandRange,
    command_ranges,
    default_command,
    sample_all,
)
from hugwbc.errors import CommandError, UnknownNameError
from hugwbc.gait import Gait
from hugwbc.robot import load_robot

# The paper's table of commands, typed in from the paper: default, initial range, finishing range.
PAPER = {
    "v_x": (0.0, (-0.6, 0.6), (-0.6, 2.0)),
    "v_y": (0.0, (-0.6, 0.6), (-0.6, 0.6)),
    "omega": (0.0, (-0.6, 0.6), (-1.0, 1.0)),
    "f": (2.0, (1.5, 3.5), (1.5, 3.5)),
    "l": (0.15, (0.1, 0.35), (0.1, 0.35)),
    "h": (0.0, (-0.3, 0.0), (-0.3, 0.0)),
    "p": (0.0, (0.0, 0.4), (0.0, 0.4)),
    "w": (0.0, (-1.0, 1.0), (-1.0, 1.0)),
}


@pytest.mark.parametrize("gait", [Gait.WALKING, Gait.JUMPING])
def test_general_ranges_are_the_papers(gait: Gait) -> None:
    ranges = command_ranges(gait)
    assert {n: (r.default, r.initial, r.finishing) for n, r in ranges.items()} == PAPER
    assert tuple(ranges) == COMMAND_NAMES == ("v_x", "v_y", "omega", "f", "l", "h", "p", "w")


@pytest.mark.parametrize("gait", [Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT])
def test_hopping_commands_velocities_and_height_only(gait: Gait) -> None:
    ranges = command_ranges(gait)
    assert [ranges[n].finishing for n in ("v_x", "v_y", "omega", "h")] == [(-0.6, 0.6)] * 3 + [(-0.3, 0.0)]
    assert [ranges[n].finishing for n in ("f", "l", "p", "w")] == [(2.0, 2.0), (0.15, 0.15), (0.0, 0.0), (0.0, 0.0)]


@pytest.mark.parametrize("gait", list(Gait))
def test_ranges_of_the_h1_are_the_papers(gait: Gait) -> None:
    for name in ("h1", "h1-2023"):
        assert command_ranges(gait, load_robot(name)) == command_ranges(gait)


def test_ranges_grow_with_the_leg() -> None:
    """A G1's leg is 0.6366 m, the paper's robot's 0.8 m: heights in proportion, speeds at the same Froude number."""
    robot = dataclasses.replace(load_robot("g1"), commands={})  # its table has ranges of its own
    ranges = command_ranges(Gait.WALKING, robot)
    share = 0.6366 / 0.8
    assert ranges["v_x"].finishing == pytest.approx((-0.6 * share**0.5, 2.0 * share**0.5), abs=0.005)
    assert ranges["l"].finishing == pytest.approx((0.1 * share, 0.35 * share), abs=0.005)
    assert ranges["h"].initial == pytest.approx((-0.3 * share, 0.0), abs=0.005)
    assert [ranges[name].finishing for name in ("f", "p", "w", "omega")] == [
        PAPER[name][2] for name in ("f", "p", "w", "omega")
    ]
    hopping = command_ranges(Gait.HOPPING_LEFT, robot)
    assert hopping["v_x"].finishing == pytest.approx((-0.54, 0.54)) and hopping["l"].finishing == (0.12, 0.12)


def test_a_table_may_have_ranges_of_its_own() -> None:
    own = {"v_x": {"finishing": (-0.4, 1.0)}, "l": {"finishing": (0.03, 0.08)}}
    own = dataclasses.replace(load_robot("g1"), commands=own)
    assert default_command(Gait.WALKING, own).l == 0.08, "the end of the range that is nearest to the usual default"
    ranges = command_ranges(Gait.WALKING, own)
    assert ranges["v_x"] == CommandRange(0.0, (-0.4, 0.54), (-0.4, 1.0)), "a training begins within the table's range"
    assert ranges["l"].initial == (0.08, 0.08)
    assert command_ranges(Gait.HOPPING_LEFT, own)["v_x"].finishing == (-0.4, 0.54), "nor do hops leave it"
    assert Command(v_x=1.5, gait=Gait.WALKING).clamp(own)[0].v_x == 1.0
    with pytest.raises(CommandError, match=r"valid: -0\.4 to 1 m/s"):
        Command(v_x=1.5, gait=Gait.WALKING).validate(own)
    assert np.all(sample_all(Gait.WALKING, np.random.default_rng(1), 50, own)[:, 0] <= 1.0)


def test_the_waists_range_bounds_w() -> None:
    robot = load_robot("g1")
    lower, upper = robot.lower.copy(), robot.upper.copy()
    lower[robot.waist], upper[robot.waist] = -0.001, 0.4
    for commands in ({}, {"w": {"finishing": (-0.9, 0.9)}}):
        narrow = dataclasses.replace(robot, lower=lower, upper=upper, commands=commands)
        assert command_ranges(Gait.WALKING, narrow)["w"] == CommandRange(0.0, (-0.001, 0.4), (-0.001, 0.4))


def test_array_round_trip() -> None:
    command = Command(v_x=0.5, v_y=-0.1, omega=0.2, f=2.5, l=0.2, h=-0.1, p=0.3, w=-0.4, gait=Gait.WALKING)
    np.testing.assert_array_equal(command.array(), [0.5, -0.1, 0.2, 2.5, 0.2, -0.1, 0.3, -0.4])
    assert Command.from_array(command.array(), Gait.WALKING) == command
    with pytest.raises(ValueError, match="zip"):
        Command.from_array(np.zeros(7), Gait.WALKING)


def test_from_mapping_fills_in_defaults_and_refuses_unknown_names() -> None:
    assert Command.from_mapping({"v_x": 0.3}, Gait.WALKING) == Command(v_x=0.3, gait=Gait.WALKING)
    with pytest.raises(UnknownNameError, match=r"unknown command 'vx'.*Did you mean 'v_x'.*Valid: v_x, v_y, omega"):
        Command.from_mapping({"vx": 0.3}, Gait.WALKING)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_validate_refuses_what_is_not_finite(value: float) -> None:
    with pytest.raises(CommandError, match=r"command h is (nan|inf|-inf); give a finite number from -0.3 to 0.0 m"):
        Command(h=value).validate()


def test_validate_says_what_is_wrong_what_is_valid_and_what_to_do() -> None:
    with pytest.raises(CommandError) as caught:
        Command(v_x=2.5, gait=Gait.WALKING).validate()
    message = str(caught.value)
    assert "v_x = 2.5 m/s is out of range for the walking gait" in message
    assert "valid: -0.6 to 2 m/s" in message
    assert "clamp" not in message, "whoever writes a script cannot call anything"
    with pytest.raises(CommandError, match="standing gait; valid: 0 to 0 m/s"):
        Command(v_x=0.1, gait=Gait.STANDING).validate()


def test_clamp_moves_to_the_nearest_bound_and_nan_to_the_default() -> None:
    clamped, report = Command(v_x=9.0, omega=-5.0, f=math.nan, h=-math.inf, gait=Gait.WALKING).clamp()
    assert clamped == Command(v_x=2.0, omega=-1.0, f=2.0, h=-0.3, gait=Gait.WALKING)
    assert len(report) == 4
    assert report[0] == CommandChange("v_x", 9.0, 2.0, "is outside -0.6 to 2")
    assert str(report[0]) == "v_x = 9 is outside -0.6 to 2: using 2"


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=8, max_size=8), st.sampled_from(list(Gait)))
def test_clamp_always_gives_a_valid_command(values: list[float], gait: Gait) -> None:
    clamped, report = Command.from_array(np.array(values), gait).clamp()
    clamped.validate()
    assert clamped.clamp() == (clamped, ())
    assert bool(report) == (clamped.array().tolist() != values)


def test_sample_all_is_valid_uniform_independent_and_seeded() -> None:
    for gait in Gait:
        for row in sample_all(gait, np.random.default_rng(1), 50):
            Command.from_array(row, gait).validate()
    values = sample_all(Gait.WALKING, np.random.default_rng(1), 20_000)
    np.testing.assert_array_equal(values, sample_all(Gait.WALKING, np.random.default_rng(1), 20_000))
    low, high = np.array([PAPER[n][2] for n in COMMAND_NAMES]).T
    # The mean of 20,000 uniform draws: standard error 0.29 / 141 = 0.2 % of the range; 1 % is five of them.
    np.testing.assert_allclose((values.mean(0) - low) / (high - low), 0.5, atol=0.01)
    off_diagonal = np.corrcoef(values.T) - np.eye(8)
    assert np.abs(off_diagonal).max() < 0.04


@pytest.mark.parametrize(
    "stored", ["walking", 1, 1.0, np.int8(1), np.float32(1), np.array(1), torch.tensor(1), np.str_("walking")]
)
def test_a_gait_is_understood_by_its_name_and_as_data_sets_store_it(stored) -> None:
    assert Command(gait=stored).gait is Gait.WALKING


@pytest.mark.parametrize("stored", ["walkng", 7, -1, 1.5, b"walking", None, True, [1], math.nan, 10**400])
def test_what_is_no_gait_is_refused(stored) -> None:
    with pytest.raises(UnknownNameError, match="gait"):
        Command(gait=stored)


@pytest.mark.parametrize(
    "value", [np.float16(0.5), np.array(0.5), torch.tensor(0.5, requires_grad=True), Fraction(1, 2), Decimal("0.5")]
)
def test_numbers_of_other_libraries_become_floats(value) -> None:
    command = Command(v_x=value, gait=Gait.WALKING)
    assert type(command.v_x) is float and command.clamp() == (command, ()) and command.v_x == 0.5
    assert math.isnan(Command(v_x=np.float32("nan")).v_x), "NaN is for the control loop to replace"


@pytest.mark.parametrize("value", ["0.5", b"0.5", None, 10**400, [0.5], np.zeros(2), True, 1j])
def test_what_is_no_number_is_refused(value) -> None:
    with pytest.raises(CommandError, match=r"command v_x is .*; give a number"):
        Command(v_x=value)

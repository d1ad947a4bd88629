import math

import numpy as np
import pytest

from hugwbc.errors import TargetError, UnknownNameError
from hugwbc.targets import HandTargets


def test_of_takes_any_sequence_and_keeps_a_copy():
    left = [0.3, 0.2, 0.1]
    targets = HandTargets.of(left, (0.3, -0.2, 0.1), "world")
    left[0] = 9.0
    assert targets.array().tolist() == [[0.3, 0.2, 0.1], [0.3, -0.2, 0.1]]
    assert targets.frame == "world"
    assert targets.is_usable


@pytest.mark.parametrize(
    "bad", [(0.3, math.nan, 0.1), (0.3, 0.2, math.inf), (0.3, 0.2, 1e300), (0.3, 0.2), "here", [[0.3, 0.2, 0.1]]]
)
def test_of_refuses_what_is_not_three_finite_numbers(bad):
    with pytest.raises(TargetError, match=r"right hand target is .*three finite numbers x, y, z in metres"):
        HandTargets.of((0.3, 0.2, 0.1), bad)


def test_of_refuses_an_unknown_frame():
    with pytest.raises(UnknownNameError, match="Did you mean 'pelvis'"):
        HandTargets.of((0.3, 0.2, 0.1), (0.3, -0.2, 0.1), "pelvi")


def test_plain_constructor_carries_anything_and_tells():
    assert not HandTargets(np.array([0.3, math.nan, 0.1]), np.zeros(3)).is_usable
    assert not HandTargets(np.zeros(2), np.zeros(3)).is_usable


def test_a_hand_may_have_no_target_but_not_both():
    targets = HandTargets.of(None, (0.3, -0.2, 0.1))
    assert targets.given.tolist() == [False, True]
    assert np.isnan(targets.array()[0]).all()
    assert targets.is_usable
    with pytest.raises(TargetError, match="neither hand has a target"):
        HandTargets.of(None, None)


@pytest.mark.parametrize("left", [np.array(["a", "b", "c"]), np.array([None, None, None]), "abc", 1.0])
def test_whatever_arrives_is_usable_or_not_and_never_raises(left):
    assert not HandTargets(left, None).is_usable


def test_targets_in_a_frame_that_nobody_knows_are_not_usable():
    assert not HandTargets(np.zeros(3), None, "wolrd").is_usable
    assert HandTargets(np.zeros(3), None, "heading").is_usable

import math

import numpy as np
import pytest

from hugwbc import load_robot, rotations
from hugwbc.errors import TargetError, UnknownNameError
from hugwbc.hand_wrench import HEAVIEST, STRONGEST, HandWrench
from hugwbc.targets import HandTargets, squeeze


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


def test_a_hand_may_have_no_target_but_not_both():
    targets = HandTargets.of(None, (0.3, -0.2, 0.1))
    assert targets.given.tolist() == [False, True]
    assert np.isnan(targets.array()[0]).all()
    assert targets.is_usable
    with pytest.raises(TargetError, match="neither hand has a target"):
        HandTargets.of(None, None)


def test_forces_stiffness_and_payload_are_checked_and_kept():
    hands = HandTargets.of((0.3, 0.2, 0.1), (0.3, -0.2, 0.1), left_force=[15, 0, 0], stiffness=400, payload=(3, 0))
    assert hands.is_usable
    assert hands.wrench.force.tolist() == [[15.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    assert hands.wrench.stiffness == 400.0
    assert hands.wrench.payload is not None and hands.wrench.payload.tolist() == [3.0, 0.0]


@pytest.mark.parametrize(
    "bad, message",
    [
        ({"left_force": (math.nan, 0, 0)}, "left hand force is .*three finite numbers"),
        ({"left_force": (STRONGEST, STRONGEST, 0)}, "at most 200 N"),
        ({"left_force": 15.0}, "left hand force is 15.0"),
        ({"stiffness": 1.0}, "stiffness is 1.0; give a number in newtons per metre from 50 to 5000"),
        ({"stiffness": math.nan}, "stiffness is nan"),
        ({"payload": (-1.0, 0.0)}, "payload is .*each from 0 to 20 kg"),
        ({"payload": (HEAVIEST + 1, 0.0)}, "payload is"),
        ({"payload": 3.0}, "payload is 3.0"),
        ({"right_force": (10, 0, 0)}, "right hand has no target, but its force is given"),
        ({"right_direction": (1, 0, 0)}, "right hand has no target, but its direction is given"),
        ({"right_orientation": "level"}, "right hand has no target, but its orientation is given"),
    ],
)
def test_of_refuses_loads_out_of_range_and_without_a_target(bad, message):
    with pytest.raises(TargetError, match=message):
        HandTargets.of((0.3, 0.2, 0.1), None, **bad)


NAN_POINT = np.array([0.3, math.nan, 0.1])


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("left", [NAN_POINT, np.zeros(2), np.array(["a", "b", "c"]), np.array([None, None, None]), "abc", 1.0]),
        ("frame", ["wolrd"]),
        ("wrench", [None, HandWrench(NAN_POINT), HandWrench(np.zeros(2)), HandWrench(np.full((2, 3), math.inf))]),
        ("wrench", [HandWrench(stiffness=wrong) for wrong in (math.inf, "soft", -1.0)]),
        ("sequence", ["7", math.nan, True]),
        ("orientation_weight", [0.0, -1.0, math.nan, "much"]),
        ("wrench", [HandWrench(payload=wrong) for wrong in (np.array([1.0, math.nan]), np.zeros(3))]),
    ],
)
def test_whatever_arrives_is_usable_or_not_and_never_raises(name, values):
    sound = {"left": np.zeros(3), "right": np.zeros(3), "frame": "heading"}
    assert HandTargets(**sound).is_usable
    assert not any(HandTargets(**(sound | {name: value})).is_usable for value in values)


def test_squeezing_forces_point_at_each_other_and_balance():
    left, right = squeeze((0.3, 0.2, 0.1), (0.3, -0.2, 0.1), 30.0)
    assert left.tolist() == [0.0, 30.0, 0.0], "on the left hand, outwards"
    assert np.allclose(left + right, 0.0)
    with pytest.raises(TargetError, match="line between the hand targets"):
        squeeze((0.3, 0.2, 0.1), (0.3, 0.2, 0.1), 30.0)
    with pytest.raises(TargetError, match="squeezing force is -1"):
        squeeze((0.3, 0.2, 0.1), (0.3, -0.2, 0.1), -1.0)
    with pytest.raises(TargetError, match="squeezing force is '30 N'"):
        squeeze((0.3, 0.2, 0.1), (0.3, -0.2, 0.1), "30 N")


def test_a_target_out_of_any_reach_is_refused_with_its_distance() -> None:
    with pytest.raises(TargetError, match=r"the left hand target is 37\.4 m from the pelvis; give metres"):
        HandTargets.of((30, 20, 10), None)
    HandTargets.of((30, 20, 1), None, "world")


def test_an_orientation_is_a_quaternion_or_level_and_turns_with_its_frame() -> None:
    """A quarter turn: the x axis of the other frame is the y axis of this one."""
    quarter = rotations.from_yaw_pitch_roll(0.5 * math.pi, 0.0, 0.0)
    hands = HandTargets.of((0.3, 0.2, 0.1), (0.3, -0.2, 0.1), left_orientation=2.0 * quarter, right_orientation="level")
    np.testing.assert_allclose(hands.left_orientation, quarter)
    assert hands.right_orientation is not None and not hands.right_orientation.any() and hands.is_usable
    there = hands.turned(rotations.to_matrix(quarter), hands.array(), "heading")
    np.testing.assert_allclose(rotations.to_matrix(there.left_orientation), np.eye(3), atol=1e-12)
    np.testing.assert_array_equal(there.right_orientation, np.zeros(4))
    for wrong in ("flat", (1, 0, 0), (0, 0, 0, 0), (math.nan, 0, 0, 1)):
        with pytest.raises(TargetError, match=r"left orientation is .* or 'level'"):
            HandTargets.of((0.3, 0.2, 0.1), None, left_orientation=wrong)
    with pytest.raises(TargetError, match="orientation_weight is 2"):
        HandTargets.of((0.3, 0.2, 0.1), None, orientation_weight=2.0)


def test_arms_refuse_what_they_have_too_few_joints_for() -> None:
    small, large = load_robot("h1"), load_robot("g1")
    for orientation, needed in (("level", 5), ((1, 0, 0, 0), 6)):
        hands = HandTargets.of(None, (0.3, -0.2, 0.1), right_orientation=orientation)
        hands.check(large)
        with pytest.raises(
            TargetError, match=f"right_orientation takes an arm of {needed} joints .* h1 has 4: left_sh"
        ):
            hands.check(small)
    joints = HandTargets(None, None, joints=np.zeros(8))
    joints.check(small)
    with pytest.raises(TargetError, match="14 for the joints"):
        joints.check(large)
    with pytest.raises(TargetError, match="or a frame other than pelvis, heading, steady, world"):
        HandTargets(np.zeros(3), None, "torso").check(small)  # type: ignore[arg-type]

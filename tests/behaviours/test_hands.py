"""What a pressing hand is asked for."""

import numpy as np
import pytest
from behaviour_helpers import objects, view

from hugwbc import Command, Gait, load_robot
from hugwbc.behaviours import Action, BoxGrip, Failure, lift, press, reach, release
from hugwbc.behaviours.hands import _MOST_MORE, Pressing, crouch, squat, stature
from hugwbc.commands import default_command
from hugwbc.targets import HandTargets

UP = np.array([0.0, 0.0, 1.0])


def asked_after(seconds: float, felt: float | None) -> float:
    """Ask for 15 N for a time, while the right hand feels a force upwards [N]."""
    force = None if felt is None else np.array([[0.0, 0.0, 99.0], [0.0, 0.0, felt]])
    pressing = Pressing(view(0.0, hand_force=force), 1, UP, 15.0)
    for time in np.arange(0.02, seconds, 0.02):
        pressing.asked(view(float(time), hand_force=force))
    return pressing.asked(view(seconds, hand_force=force))


def test_a_hand_that_feels_too_little_is_asked_for_more():
    assert asked_after(0.5, 15.0) == pytest.approx(15.0)
    assert asked_after(0.5, 10.0) == pytest.approx(20.0)
    assert asked_after(0.5, 20.0) == pytest.approx(10.0)
    assert asked_after(0.5, None) == 15.0


def test_what_is_asked_for_has_bounds_and_keeps_its_sign():
    assert asked_after(20.0, 0.0) == 15.0 + _MOST_MORE
    assert 0.0 < asked_after(20.0, 99.0) < 15.0


def test_robots_crouch_in_proportion_to_their_shoulders():
    g1 = load_robot("g1")
    size = stature(g1)
    assert size == pytest.approx(0.737, abs=0.001) and stature(load_robot()) == stature(None) == 1.0
    for height in (0.6, 1.0, 1.2):
        for posture in (squat, crouch):
            mine, like = posture(height * size, g1), posture(height)
            assert (mine.h, mine.p) == pytest.approx((size * like.h, like.p), abs=1e-12)
    # A button at the height of its shoulders is no reason for a G1 to crouch.
    bell = view(position=(0.0, 0.0, 0.757), objects=objects(bell=(0.4, -0.15, 0.85)), robot=g1)
    assert next(press(bell, "bell")).command.h == 0.0


def test_postures_have_the_defaults_of_the_robot():
    """A swing height of the H1's is beyond the range of a small robot."""
    g1 = load_robot("g1")
    own = default_command(Gait.STANDING, g1)
    assert own.l != Command().l
    box = view(objects=objects(box=(0.5, 0.0, 0.6)), robot=g1)
    asked = [squat(2.0, g1), crouch(2.0, g1), next(BoxGrip(0.3).take(box, "box")).command]
    assert asked == [own] * 3


@pytest.mark.filterwarnings("error")
def test_hands_without_a_target_are_not_lifted_and_let_go_at_once():
    resting = view(last=Action(hands=HandTargets(None, None)), objects=objects(box=(0.5, 0.0, 0.6)))
    with pytest.raises(Failure, match="the hands have no targets"):
        next(lift(resting, "box"))
    letting_go = release(resting)
    next(letting_go)
    with pytest.raises(StopIteration):
        letting_go.send(resting)


def test_directions_are_unit_vectors():
    """A short one would not be recorded."""
    action = next(reach(view(), left=(0.3, 0.2, 0.1), left_direction=(0.3, 0.0, -0.4)))
    assert action.hands is not None and action.hands.left_direction == pytest.approx([0.6, 0.0, -0.8])

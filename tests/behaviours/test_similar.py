"""A behaviour for a robot of other lengths: the physics of similar bodies of the same density."""

import dataclasses

import numpy as np
import pytest

from hugwbc import Command, Gait
from hugwbc.behaviours import BehaviourSource, Failure
from hugwbc.behaviours.similar import similar
from hugwbc.robot import load_robot
from hugwbc.scripts.view import Action, Grip, SeenObjects, View
from hugwbc.targets import HandTargets
from tests.conftest import make_state

SIZE = 0.5


def _view(**fields) -> View:
    state = make_state(position=(1.0, 2.0, 0.5), velocity=(0.2, 0.0, 0.0), hand_force=np.full((2, 3), 2.0))
    objects = SeenObjects(("box",), np.array([[2.0, 0.0, 0.4, 1.0, 0.0, 0.0, 0.0]]), age=0.02)
    return View(3.0, state, np.array([[0.2, 0.1, 0.6], [0.2, -0.1, 0.6]]), objects, state.hand_force, **fields)


def test_a_half_as_large_robot_sees_double_and_does_half() -> None:
    """Lengths and speeds by 1/2, forces of the same density by 1/8, stiffness by 1/4; angles and times stay."""
    seen = []

    def behaviour(view: View):
        while True:
            seen.append(view)
            targets = HandTargets.of(view.hands[0] + 0.1, None, left_force=(8.0, 0, 0), stiffness=400.0, frame="world")
            targets = dataclasses.replace(targets, orientation_weight=0.04)
            command = Command(v_x=0.4, omega=0.3, h=-0.2, p=0.1, l=0.2, gait=Gait.WALKING)
            view = yield Action(command, targets, (Grip("left", "box", breaking_force=80.0),), "walk")

    course = similar(behaviour, SIZE, load_robot("h1"))(_view(robot=load_robot("g1"), hand_tip=0.05))
    action = next(course)
    assert action.command == Command(v_x=0.2, omega=0.3, h=-0.1, p=0.1, l=0.1, gait=Gait.WALKING)
    np.testing.assert_allclose(action.hands.left, [0.25, 0.15, 0.65])
    assert action.hands.right is None and action.hands.wrench.stiffness == 100.0 and action.doing == "walk"
    assert action.hands.orientation_weight == 0.01, "in square metres"
    assert action.hands.wrench.force[0, 0] == 1.0 and action.grips[0].breaking_force == 10.0
    course.send(_view(last=action))
    first, second = seen
    np.testing.assert_allclose(first.position, [2.0, 4.0, 1.0])
    np.testing.assert_allclose(first.hands[1], [0.4, -0.2, 1.2])
    np.testing.assert_allclose(first.objects["box"].position, [4.0, 0.0, 0.8])
    assert (first.hand_force == 16.0).all() and (first.state.hand_force == 16.0).all()
    assert first.hand_tip == 0.1 and first.hand_half_width == 0.06
    assert first.time == 3.0 and first.objects["box"].age == 0.02
    assert first.robot is load_robot("h1"), "its commands have the defaults of the robot that it was made for"
    assert second.last.command.v_x == pytest.approx(0.4), "its own last request comes back as it was asked for"


@pytest.mark.parametrize(
    ("words", "said"),
    [("the hand is 8 cm away", "the hand is 8 cm away, in lengths of h1"), ("it waited for 8 s", "it waited for 8 s")],
)
def test_a_failure_says_whose_lengths_it_tells(words, said) -> None:
    def behaviour(view: View):
        yield Action()
        raise Failure(words)

    source = BehaviourSource(similar(behaviour, SIZE, load_robot("h1")))
    for _ in range(2):
        source.see(_view())
    assert source.reason == said


def test_the_same_size_is_the_same_behaviour() -> None:
    def behaviour(view: View):
        yield Action()
        return view

    assert similar(behaviour, 1.0) is behaviour

import dataclasses

import numpy as np
import pytest

from hugwbc import Command, Gait, load_robot
from hugwbc.behaviours import Action, BehaviourSource, Grip, View
from hugwbc.gym.episode import HAND_SPEED, FollowWish
from hugwbc.gym.task_action import GRIPS, ActionLayout, Wish
from hugwbc.targets import HandTargets
from tests.conftest import make_state

HANDS = np.array([[1.3, 2.2, 1.1], [1.3, 1.8, 1.1]])


def view(time: float = 0.0, yaw: float = 0.0, held: tuple[str | None, str | None] = (None, None)) -> View:
    """A robot at (1, 2), with its hands in front of it for a heading of 0."""
    state = make_state(yaw=yaw, position=(1.0, 2.0, 1.0), velocity=np.zeros(3), time=time)
    return View(time=time, state=state, hands=HANDS, held=held)


@pytest.mark.parametrize("grip", [*GRIPS, None])
def test_what_is_asked_for_comes_back(grip):
    layout = ActionLayout(grip, load_robot())
    wish = Wish(
        Command(v_x=0.3, v_y=-0.1, omega=0.5, h=-0.2, p=0.1, w=-0.4, gait=Gait.WALKING),
        np.array([True, False]),
        np.array([[0.4, 0.3, -0.2], [0.2, -0.5, 0.1]]),
        25.0,
        np.array([False, True]),
    )
    action = layout.encode(wish)
    back = layout.decode(action)
    assert action.dtype == np.float32 and np.abs(action).max() <= 1.0
    np.testing.assert_allclose(back.command.array(), wish.command.array(), atol=1e-6)
    np.testing.assert_allclose(back.points, wish.points, atol=1e-6)
    assert back.command.gait is Gait.WALKING and back.used.tolist() == [True, False]
    assert back.squeeze == pytest.approx(25.0 if grip == "squeeze" else 0.0, abs=1e-4)
    assert back.grips.tolist() == [False, grip == "attach"]


def test_at_rest_the_robot_stands_upright_with_free_arms():
    layout = ActionLayout(None, load_robot())
    wish = layout.decode(layout.rest)
    assert wish.command == Command() and not wish.used.any()


def test_a_robot_that_may_not_pitch_rests_upright():
    layout = ActionLayout(None, dataclasses.replace(load_robot(), commands={"p": {"finishing": (0.0, 0.0)}}))
    assert np.isfinite(layout.rest).all() and layout.decode(layout.rest).command == Command()


@pytest.mark.parametrize("robot", ["h1", "g1"])
@pytest.mark.parametrize("seed", range(20))
def test_every_action_is_a_valid_command(seed, robot):
    robot = load_robot(robot)
    layout = ActionLayout("squeeze", robot)
    action = np.random.default_rng(seed).uniform(-1.0, 1.0, len(layout.names))
    wish = layout.decode(action)
    assert wish.command.validate(robot) is wish.command and wish.squeeze >= 0.0
    assert layout.decode(layout.rest).squeeze == 0.0


def test_a_g1_crouches_as_low_as_it_can_and_walks_with_its_own_swing_height():
    """Its ranges and defaults are smaller than an H1's; 0 remains a velocity of 0."""
    layout = ActionLayout(None, load_robot("g1"))
    action = np.zeros(len(layout.names))
    action[[layout.names.index("walk"), layout.names.index("h")]] = 1.0, -1.0
    command = layout.decode(action).command
    assert (command.v_x, command.h, command.l) == pytest.approx((0.0, -0.24, 0.12))


@pytest.mark.parametrize(
    ("given", "reached"), [((0.0, 1.0), (0.0, 0.6)), ((-0.4, 0.0), (-0.4, 0.0)), ((0.7, 1.0), (0.7, 0.7))]
)
def test_a_robot_that_walks_one_way_only_can_be_told_to(given, reached):
    layout = ActionLayout(None, dataclasses.replace(load_robot(), commands={"v_x": {"finishing": given}}))
    action = layout.rest.copy()
    action[layout.names.index("walk")], found = 1.0, []
    for end in (-1.0, 1.0):
        action[layout.names.index("v_x")] = end
        found.append(layout.decode(action).command.v_x)
    assert found == pytest.approx(reached) and layout.decode(layout.rest).command == Command()


def test_hands_go_to_their_targets_no_faster_than_they_may():
    behaviour = FollowWish(lambda side: None)
    source = BehaviourSource(behaviour.course)
    assert source.act(view()).hands is None
    behaviour.wish = Wish(used=np.array([True, False]), points=np.array([[0.5, 0.2, 0.1], [0.0, 0.0, 0.0]]))
    hands = source.act(view(0.1)).hands
    assert hands is not None and hands.frame == "heading" and hands.right is None
    np.testing.assert_allclose(hands.left, [0.3 + 0.1 * HAND_SPEED, 0.2, 0.1], atol=1e-9)
    hands = source.act(view(5.0)).hands
    assert hands is not None
    np.testing.assert_allclose(hands.left, [0.5, 0.2, 0.1])
    behaviour.wish = Wish()
    assert source.act(view(5.1)).hands is None and np.isnan(behaviour.points).all()


def test_hands_are_at_their_targets_when_the_next_action_comes():
    behaviour = FollowWish(lambda side: None)
    source = BehaviourSource(behaviour.course)
    source.act(view())
    reached = []
    for tick in range(50):  # of 0.02 s: an action every fifth, 16 mm on
        if tick % 5 == 0:
            points = np.array([[0.3 + 0.016 * (1 + tick // 5), 0.2, 0.1], [0.0, 0.0, 0.0]])
            behaviour.wish = Wish(used=np.array([True, False]), points=points)
        hands = source.act(view(0.02 * (tick + 1))).hands
        assert hands is not None and hands.left is not None
        reached.append(hands.left[0])
    np.testing.assert_allclose(np.diff(reached) / 0.02, 0.16, rtol=1e-6)


def test_hands_squeeze_along_the_line_between_them():
    behaviour = FollowWish(lambda side: None)
    source = BehaviourSource(behaviour.course)
    points = np.array([[0.3, 0.2, 0.1], [0.3, -0.2, 0.1]])
    behaviour.wish = Wish(used=np.array([True, True]), points=points, squeeze=30.0)
    hands = source.act(view()).hands
    assert hands is not None and hands.together
    np.testing.assert_allclose(hands.wrench.force, [[0.0, 30.0, 0.0], [0.0, -30.0, 0.0]], atol=1e-9)
    behaviour.wish = Wish(used=np.array([True, True]), points=np.array([points[0], points[0]]), squeeze=30.0)
    hands = source.act(view(9.0)).hands
    assert hands is not None and not hands.wrench.force.any(), "no line between hands at one place"


def test_a_gripper_takes_hold_once_and_has_to_be_opened_first_after_its_grip_broke():
    behaviour = FollowWish(lambda side: ("tray", False))
    source = BehaviourSource(behaviour.course)
    behaviour.wish = Wish(grips=np.array([True, False]))
    assert source.act(view(0.1)).grips == (Grip("left", "tray"),)
    assert source.act(view(0.2, held=("tray", None))).grips == ()
    assert source.act(view(0.3)).grips == (), "it broke"
    behaviour.wish = Wish()
    assert source.act(view(0.4)).grips == ()
    behaviour.wish = Wish(grips=np.array([True, True]))
    first, second = source.act(view(0.5, held=(None, None))).grips
    assert first == Grip("left", "tray") and second == Grip("right", "tray", hook=True), "as in carry_tray"
    (second,) = source.act(view(0.6, held=("tray", None))).grips
    assert second == Grip("right", "tray", hook=True), "the second hand on it may turn"
    behaviour.wish = Wish()
    assert source.act(view(0.7, held=("tray", None))).grips == (Grip("left", None),)


def test_a_behaviours_action_becomes_a_wish_in_the_heading_frame():
    squeezed = HandTargets.of((1.0, 2.4, 1.2), None, "world")
    wish = Wish.of(Action(Command(h=-0.1), squeezed, (Grip("right", "box"),)), view(yaw=np.pi / 2))
    np.testing.assert_allclose(wish.points[0], [0.4, 0.0, 0.2], atol=1e-9)
    assert wish.used.tolist() == [True, False] and wish.grips.tolist() == [False, True] and wish.command.h == -0.1
    assert Wish.of(Action(), view(held=("box", None))).grips.tolist() == [True, False]
    assert Wish.of(Action(grips=(Grip("left", None),)), view(held=("box", None))).grips.tolist() == [False, False]

"""Steps in the default arena, with sensors of a robot: short runs of the learned controller."""

import math

import numpy as np
import pytest
from behaviour_helpers import objects, view

from hugwbc import load_robot, rotations
from hugwbc.behaviours import (
    Action,
    Behaviour,
    BehaviourSource,
    Course,
    Grip,
    Status,
    View,
    fetch_cup,
    grip,
    lift,
    place,
    press,
    reach,
    release,
    squeeze,
    stand,
    walk_to,
    wipe,
)
from hugwbc.runtime import UpperBodySource, load_controller, rollout
from hugwbc.sim import Simulation
from hugwbc.sim.scenes import Box, Button, Scene, Table, load_scene
from hugwbc.targets import HandTargets


def _play(
    behaviour: Behaviour, scene: Scene, seed: int, seconds: float, controller: str = "learned"
) -> tuple[BehaviourSource, Simulation]:
    source, simulation = BehaviourSource(behaviour), Simulation(scene=scene, seed=seed)
    trace = rollout(
        load_controller(controller),
        source,
        simulation,
        UpperBodySource(load_robot()),
        duration=seconds,
        until=lambda: source.done,
    )
    assert not trace.fell and trace.problems == ()
    return source, simulation


BELL = Scene((Button(name="bell", position=(0.55, -0.2), height=1.1),))
CUBE = Scene((Box(name="cube", position=(3.0, 0.0), size=(0.1, 0.1, 0.1), mass=0.5),))


def test_a_button_is_pressed() -> None:
    source, _ = _play(lambda view: press(view, "bell", travel=0.012), BELL, seed=1, seconds=10.0)
    assert source.status is Status.SUCCESS, source.reason


def test_a_button_that_is_too_stiff_fails_with_what_happened() -> None:
    scene = Scene((Button(name="bell", position=(0.55, -0.2), height=1.1, force=200.0),))
    source, _ = _play(lambda view: press(view, "bell", travel=0.018, timeout=6.0), scene, seed=1, seconds=9.0)
    assert source.status is Status.FAILURE
    assert source.reason.startswith("press: 'bell' has given way by")


def test_hands_reach_and_move_on_while_the_body_stands_lower() -> None:
    def steps(view: View) -> Course:
        view = yield from reach(view, left=(0.35, 0.25, 0.1), right=(0.35, -0.25, 0.1))
        view = yield from reach(view, left=(0.35, 0.25, 0.2), right=(0.35, -0.25, 0.2))
        view = yield from stand(view, 0.5, h=-0.05)
        return (yield from reach(view, right=(0.35, -0.25, 0.3)))

    source, simulation = _play(steps, CUBE, seed=2, seconds=15.0)
    assert source.status is Status.SUCCESS, source.reason
    state = simulation.state()
    assert state.position is not None
    hands = np.array([simulation.hand_position(side) for side in ("left", "right")]) - state.position
    np.testing.assert_allclose(
        hands @ rotations.rotation_z(state.yaw), [[0.35, 0.25, 0.2], [0.35, -0.25, 0.3]], atol=0.05
    )


def test_a_hand_that_stays_keeps_how_it_is_turned() -> None:
    """A tray that it holds would tilt."""
    before = HandTargets.of((0.3, 0.2, 0.1), None, left_direction=(1, 0, 0), left_orientation="level")
    known = view(yaw=0.5, last=Action(hands=before))
    for frame, turned in (("heading", 0.0), ("world", 0.5)):
        hands = next(reach(known, right=(0.3, -0.2, 0.2), frame=frame, right_direction=(0, 0, 1))).hands
        assert hands is not None and hands.right_orientation is None
        np.testing.assert_allclose(hands.left_direction, [math.cos(turned), math.sin(turned), 0.0], atol=1e-12)
        np.testing.assert_array_equal(hands.left_orientation, np.zeros(4))
        np.testing.assert_allclose(hands.right_direction, [0.0, 0.0, 1.0])


def test_the_hand_that_does_not_wipe_keeps_its_target_as_it_is_turned() -> None:
    before = HandTargets.of((0.3, 0.2, 0.1), (0.3, -0.2, 0.1), left_orientation="level", right_direction=(1, 0, 0))
    known = view(yaw=0.5, last=Action(hands=before))
    path = np.array([[0.4, -0.1, 1.0], [0.5, -0.1, 1.0]])
    hands = next(wipe(known, path)).hands
    assert hands is not None and hands.frame == "world" and hands.right_direction is None
    np.testing.assert_array_equal(hands.left_orientation, np.zeros(4))
    np.testing.assert_allclose(hands.left, known.position + rotations.rotation_z(0.5) @ (0.3, 0.2, 0.1))
    np.testing.assert_allclose(hands.right, path[0])
    np.testing.assert_array_equal(hands.wrench.force, [[0.0, 0.0, 0.0], [0.0, 0.0, 15.0]])


def test_a_gripper_out_of_reach_fails_by_its_timeout() -> None:
    source, _ = _play(lambda view: grip(view, Grip("left", "cube")), CUBE, seed=0, seconds=5.0)
    assert source.reason == "grip: timeout of 0.5 s: the left hand is not within 3 cm of 'cube'"


@pytest.mark.slow
def test_a_walk_ends_where_it_should() -> None:
    scene = Scene((Button(name="bell", position=(2.0, 0.0), height=1.05),))
    source, simulation = _play(lambda view: walk_to(view, before="bell", distance=0.5), scene, seed=0, seconds=35.0)
    assert source.status is Status.SUCCESS, source.reason
    x, y = simulation.qpos[:2]
    assert math.hypot(x - 1.5, y) < 0.06  # 5 cm as it is seen
    assert abs(math.degrees(float(rotations.yaw_of(simulation.qpos[3:7])))) < 4.0


def test_a_hand_on_top_of_a_cup_rises_when_it_lets_go() -> None:
    known = {"hands": ((0.3, 0.2, 1.0), (0.4, -0.2, 0.93)), "objects": objects(cup=(0.4, -0.2, 0.85))}
    asked = Action(hands=HandTargets(None, (0.4, -0.2, 0.93), "world"))
    source = BehaviourSource(release)
    rights = []
    for tick in range(100):
        asked = source.act(view(0.02 * tick, held=(None, None if tick else "cup"), last=asked, **known))
        if asked.hands is None:  # the controller has the arms again
            break
        rights.append(asked.hands.right)
    path = np.array(rights)
    rising = path[path[:, 2] < 1.0]
    assert len(rising) > 5 and path[:, 2].max() == pytest.approx(1.01, abs=5e-3)
    np.testing.assert_allclose(rising[:, :2], np.tile([0.4, -0.2], (len(rising), 1)), atol=1e-3)


@pytest.mark.slow
def test_a_cup_is_fetched_from_a_shelf() -> None:
    source, simulation = _play(fetch_cup, load_scene("cupboard"), seed=3, seconds=90.0, controller="qp")
    assert source.status is Status.SUCCESS, source.reason
    cup, pose = simulation.objects["cup"], simulation.state()
    assert cup.position[2] == pytest.approx(0.85, abs=0.01) and cup.tilt < 0.05
    assert pose.position is not None and math.hypot(pose.position[0] - 0.2, pose.position[1] - 2.0) < 0.06
    assert abs(math.degrees(float(pose.yaw)) - 90.0) < 4.0


@pytest.mark.parametrize(
    ("sag", "reason"),
    [((0.0, 0.025, 0.0), "hand met nothing at 'box'"), ((-0.03, 0.0, 0.0), "'box' is out of reach: the")],
)
def test_a_squeeze_beside_nothing_fails(sag: tuple[float, float, float], reason: str) -> None:
    """The hands stay behind their targets; from 20 cm apart on, those that are too far away do not follow further."""
    stop = 0.2 if sag[0] else 0.0
    source, asked, hands = BehaviourSource(squeeze_box), Action(), np.array([(0.3, 0.3, 1.0), (0.3, -0.3, 1.0)])
    for tick in range(1000):
        asked = source.act(view(0.02 * tick, hands=hands, last=asked, objects=objects(box=(0.6, 0.0, 1.0))))
        if source.done:
            break
        if asked.hands is not None:
            points = asked.hands.array() + np.array([sag, (sag[0], -sag[1], sag[2])])
            if np.abs(points[:, 1]).max() < stop:
                points[:, 0] -= 0.05
            hands = np.array([points[0], points[1]])
            hands[:, 1] = [max(points[0, 1], stop), min(points[1, 1], -stop)]
    assert source.status is Status.FAILURE and reason in source.reason


def squeeze_box(view: View) -> Course:
    """Squeeze the box."""
    return (yield from squeeze(view, "box"))


@pytest.mark.slow
def test_a_box_is_lifted_by_friction_and_set_down() -> None:
    scene = Scene(
        (
            Table(name="desk", position=(0.68, 0.0), size=(0.5, 1.2), height=0.75),
            Box(name="box", on="desk", position=(-0.22, 0.0), yaw=0.1, size=(0.25, 0.28, 0.2), mass=1.0, friction=0.7),
        )
    )
    heights = []

    def steps(view: View) -> Course:
        view = yield from squeeze(view, "box", force=40.0, whole_body=True)
        view = yield from lift(view, "box", 0.12)
        heights.append(view.objects["box"].position[2])
        return (yield from place(view, "box"))

    source, simulation = _play(steps, scene, seed=0, seconds=30.0)
    assert source.status is Status.SUCCESS, source.reason
    assert heights[0] > 0.93
    box = simulation.objects["box"]
    assert box.position[2] == pytest.approx(0.85, abs=0.01) and box.tilt < 0.02
    assert np.linalg.norm(box.position[:2] - [0.46, 0.0]) < 0.06

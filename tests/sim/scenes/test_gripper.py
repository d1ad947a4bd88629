"""The idealised gripper: when it holds, what it carries, when it breaks."""

import numpy as np
import pytest

from hugwbc import JointCommand, load_robot, rotations
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.sim import Scene, Simulation
from hugwbc.sim.scenes import Box, Drawer, Step, Wall

HOLD = JointCommand.position(load_robot(), load_robot().nominal)
MASS = 0.5  # [kg]


def beside_the_hand(gap: float) -> Simulation:
    """A robot with a box that begins a gap ahead of the surface of its left hand, on nothing."""
    hand = Simulation().hand_position("left")
    at = (hand[0] + 0.04 + gap + 0.05, hand[1], hand[2] - 0.05)
    return Simulation(scene=Scene((Box(name="parcel", position=at, size=(0.1, 0.1, 0.1), mass=MASS),)))


def test_it_measures_from_surface_to_surface() -> None:
    assert beside_the_hand(0.02).gripper.distance("parcel", "left") == pytest.approx(0.02, abs=1e-4)
    assert beside_the_hand(0.02).gripper.distance("parcel", "right") > 0.3


@pytest.mark.parametrize(("gap", "holds"), [(0.025, True), (0.035, False)])
def test_it_reaches_three_centimetres(gap: float, holds: bool) -> None:
    simulation = beside_the_hand(gap)
    assert simulation.gripper.attach("parcel", "left") == holds
    assert simulation.gripper.held("left") == ("parcel" if holds else None)
    assert simulation.gripper.held("right") is None


def in_hand(simulation: Simulation) -> np.ndarray:
    """Where the box is in the left forearm's axes."""
    arm = simulation.data.body("left_elbow_link")
    return arm.xmat.reshape(3, 3).T @ (simulation.objects["parcel"].position - arm.xpos)


def test_what_it_holds_follows_the_hand_and_pulls_at_it() -> None:
    simulation = beside_the_hand(0.02)
    assert simulation.gripper.attach("parcel", "left")
    before, forces = in_hand(simulation), []
    for _ in range(150):
        simulation.step(HOLD, 0.002)
        forces.append(simulation.state().hand_force[0, 2])
    assert np.linalg.norm(in_hand(simulation) - before) < 2e-3 and simulation.gripper.broken == 0
    assert np.mean(forces[50:]) == pytest.approx(-MASS * 9.81, rel=0.25)
    assert not simulation.objects["parcel"].hand_force.any()  # that is contact alone
    height = simulation.objects["parcel"].position[2]
    simulation.gripper.release("left")
    assert simulation.gripper.held("left") is None and not simulation.gripper.force.any()
    simulation.step(HOLD, 0.3)
    assert simulation.objects["parcel"].position[2] < height - 0.3


def test_a_hook_lets_the_hand_turn() -> None:
    simulation = beside_the_hand(0.02)
    assert simulation.gripper.attach("parcel", "left", hook=True)
    hand = simulation.hand_position("left") - simulation.objects["parcel"].position
    simulation.step(HOLD, 0.4)  # it swings down below the hand, like a pendulum
    parcel = simulation.objects["parcel"]
    now = rotations.rotate_inverse(parcel.orientation, simulation.hand_position("left") - parcel.position)
    assert parcel.tilt > 0.5 and simulation.gripper.broken == 0
    np.testing.assert_allclose(now, hand, atol=3e-3)


@pytest.mark.parametrize(("pull", "breaks"), [(30.0, False), (55.0, True)])
def test_it_breaks_at_its_force(pull: float, breaks: bool) -> None:
    simulation = beside_the_hand(0.02)
    assert simulation.gripper.attach("parcel", "left", breaking_force=45.0)
    simulation.apply_force(np.array([0.0, 0.0, MASS * 9.81]), 1.0, "parcel")
    largest = 0.0
    for step in range(100):  # rising slowly, because what is pulled at once rings
        simulation.apply_force(np.array([pull * min(1.0, step / 60), 0.0, MASS * 9.81]), 1.0, "parcel")
        simulation.step(HOLD, 0.002)
        largest = max(largest, float(np.linalg.norm(simulation.gripper.force[0])))
    assert (simulation.gripper.held("left") is None) == breaks
    assert simulation.gripper.broken == int(breaks)
    assert largest <= 45.0 and largest > 0.6 * min(pull, 45.0)


def test_a_reset_opens_the_hands() -> None:
    simulation = beside_the_hand(0.02)
    simulation.gripper.attach("parcel", "left")
    simulation.reset()
    assert simulation.gripper.held("left") is None and not simulation.data.eq_active.any()


def test_it_pulls_a_drawer_open() -> None:
    hand = Simulation().hand_position("left")
    ahead = 0.04 + 0.015 + 0.068 + 0.2  # the hand, a gap, the handle and half the drawer
    drawer = Drawer(name="drawer", position=(hand[0] + ahead, hand[1]), height=hand[2], resistance=12.0)
    simulation = Simulation(scene=Scene((drawer,)))
    # Firmly, because the robot comes down on its feet first, by 3 mm.
    assert simulation.gripper.attach("drawer", "left", 2000.0, hook=True)
    before, forces = simulation.hand_position("left")[0], []
    for _ in range(150):
        simulation.apply_force(np.array([-40.0, 0.0, 0.0]), 1.0, "left_elbow_link")
        simulation.step(HOLD, 0.002)
        forces.append(simulation.state().hand_force[0, 0])
    opened = simulation.objects["drawer"].travel
    assert opened > 0.02 and opened == pytest.approx(before - simulation.hand_position("left")[0], abs=2e-3)
    assert simulation.gripper.broken == 0 and 12.0 < np.mean(forces) < 20.0  # the slides' friction, and it speeds up


def test_bad_grips_are_refused() -> None:
    hand = Simulation().hand_position("left")
    scene = Scene((
        Box(name="parcel", position=(2.0, 0.0), size=(0.1, 0.1, 0.1)),
        Wall(name="wall", position=(hand[0] + 0.2, 0.0)),
    ))  # fmt: skip
    gripper = Simulation(scene=scene).gripper
    with pytest.raises(UnknownNameError, match=r"unknown object that can be gripped 'wall'\. Valid: parcel"):
        gripper.attach("wall", "left")
    with pytest.raises(UnknownNameError, match="unknown hand 'middle'"):
        gripper.attach("parcel", "middle")
    for force in (0.0, -1.0, float("nan")):
        with pytest.raises(ConfigError, match="give a force above 0 N"):
            gripper.attach("parcel", "left", breaking_force=force)
    assert not gripper.attach("parcel", "left")
    assert Simulation().gripper is None


def test_a_turned_object_keeps_its_turn() -> None:
    simulation = beside_the_hand(0.02)
    joint = simulation.model.joint("parcel").qposadr[0]
    simulation.data.qpos[joint + 3 : joint + 7] = rotations.from_yaw_pitch_roll(0.3, 0.2, 0.1)
    simulation.push(np.zeros(3))  # brings what is derived up to date
    assert simulation.gripper.attach("parcel", "left")
    hand = simulation.model.body("left_elbow_link").id

    def relative() -> np.ndarray:
        turn = rotations.conjugate(simulation.data.xquat[hand])
        return rotations.multiply(turn, simulation.objects["parcel"].orientation)

    before = relative()
    for _ in range(50):
        simulation.step(HOLD, 0.002)
    assert abs(relative() @ before) == pytest.approx(1.0, abs=1e-3)


def test_what_sleeps_is_woken_by_a_grip() -> None:
    hand = Simulation().hand_position("left")
    stool = Step(name="stool", position=(hand[0] + 0.2, hand[1]), size=(0.2, 0.2, hand[2] - 0.05))
    box = Box(name="parcel", on="stool", position=(-0.1, 0.0), size=(0.1, 0.1, 0.1), mass=0.3)
    simulation = Simulation(scene=Scene((stool, box)))
    raised = np.zeros(3)
    while simulation.data.ntree_awake > 1 and simulation.time < 1.0:
        simulation.step(HOLD, 0.002)
    assert simulation.data.ntree_awake == 1
    assert simulation.gripper.distance("parcel", "left") < 0.03 and simulation.gripper.attach("parcel", "left")
    start = simulation.objects["parcel"].position
    for _ in range(150):
        simulation.apply_force(np.array([0.0, 0.0, 25.0]), 1.0, "left_elbow_link")
        simulation.step(HOLD, 0.002)
        raised = simulation.objects["parcel"].position - start
    assert simulation.gripper.held("left") == "parcel" and raised[2] > 0.03


def test_a_hand_that_presses_on_what_it_holds_does_not_tear_itself_off() -> None:
    simulation = beside_the_hand(0.02)
    simulation.data.qpos[simulation.model.joint("parcel").qposadr[0]] -= 0.022  # the forearm is in the box by 2 mm
    simulation.push(np.zeros(3))  # brings what is derived up to date
    assert simulation.gripper.attach("parcel", "left", breaking_force=1000.0)
    largest = 0.0
    for _ in range(100):
        simulation.step(HOLD, 0.002)
        largest = max(largest, float(np.linalg.norm(simulation.gripper.force[0])))
    assert largest > 1000.0 and simulation.gripper.held("left") == "parcel" and simulation.gripper.broken == 0

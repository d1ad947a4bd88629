"""What a behaviour sees: the estimate without its drift, objects without their noise, and the grippers."""

import dataclasses

import numpy as np
import pytest

from hugwbc import rotations
from hugwbc.commands import Command
from hugwbc.deploy.capture import Capture, CapturedWorld
from hugwbc.errors import ConfigError
from hugwbc.robot import load_robot
from hugwbc.runtime.controllers import HoldController, load_controller
from hugwbc.runtime.loop import ControlLoop
from hugwbc.runtime.sight import SeenRobot, Sight, carry_out
from hugwbc.scripts.view import Grip, View
from hugwbc.sim import Simulation
from hugwbc.sim.scenes import Box, Scene
from hugwbc.sim.scenes.objects import Picture
from hugwbc.state import RobotState
from hugwbc.upper_ik import UpperBodySource
from tests.conftest import make_state


def _state(time: float, position: np.ndarray, yaw: float, velocity: np.ndarray) -> RobotState:
    return make_state(yaw=yaw, pitch=0.1, roll=0.05, position=position, velocity=velocity, time=time)


def test_the_drift_of_an_estimate_is_taken_off() -> None:
    """A walk at 0.4 m/s; the estimate turns by 3 degrees, runs 5 % long, and starts in the wrong place."""
    rng, seen = np.random.default_rng(0), SeenRobot()
    errors, turns = [], []
    for tick in range(1000):
        t = 0.01 * tick
        true, drift = np.array([0.4 * t, 0.1 * t, 0.98]), 0.005 * t
        turn = rotations.rotation_z(drift)
        estimate = _state(t, turn @ (1.05 * true) + [0.1, -0.1, 0.02], 0.3 + drift, turn @ np.array([0.4, 0.1, 0.0]))
        late = max(t - 0.03, 0.0)
        noisy = rotations.from_yaw_pitch_roll(0.3 + 0.0087 * rng.normal(), 0.1, 0.05)
        place = np.array([0.4 * late, 0.1 * late, 0.98]) + 0.005 * rng.normal(size=3)
        picture = Picture(late, t - late, np.zeros((0, 7)), np.concatenate((place, noisy)))
        corrected = seen.corrected(estimate, picture)
        if t > 2.0:
            assert corrected.position is not None and corrected.velocity is not None
            errors.append(np.linalg.norm(corrected.position - true))
            turns.append(abs(float(rotations.wrap_angle(corrected.yaw - 0.3))))
            np.testing.assert_allclose(corrected.velocity, [0.4, 0.1, 0.0], atol=0.01)
            assert rotations.pitch_of(corrected.orientation) == pytest.approx(0.1, abs=1e-6)
    assert np.max(errors) < 0.012 and np.mean(errors) < 0.007
    assert np.max(turns) < 0.006


def test_without_a_motion_capture_or_a_position_the_estimate_stays() -> None:
    state = _state(0.0, np.zeros(3), 0.0, np.zeros(3))
    assert SeenRobot().corrected(state, None) is state
    blind = dataclasses.replace(state, position=None)
    assert SeenRobot().corrected(blind, Picture(0.0, 0.0, np.zeros((0, 7)), np.ones(7))) is blind


class Watcher:
    """A seeing source that keeps its views and asks for one grip."""

    def __init__(self, *grips: Grip) -> None:
        self.views: list[View] = []
        self.grips: tuple[Grip, ...] = grips

    def restart(self) -> None:
        self.views.clear()

    def see(self, view: View) -> None:
        self.views.append(view)

    def command_at(self, t: float) -> Command:
        return Command()

    def hands_at(self, t: float) -> None:
        return None


def _scene(**place: object) -> Scene:
    return Scene((Box(name="cube", size=(0.1, 0.1, 0.1), mass=0.5, **place),))  # type: ignore[arg-type]


def test_a_view_is_near_the_truth_in_a_scene() -> None:
    watcher = Watcher()
    simulation = Simulation(scene=_scene(position=(1.0, 0.5)), seed=4)
    loop = ControlLoop(load_controller("learned"), watcher, simulation, UpperBodySource(load_robot()))
    loop.reset()
    truth = simulation.state()
    for tick in range(50):
        truth = simulation.state()
        command = loop.decide(tick * loop.period)
        if tick < 49:
            loop.step(command, loop.period)
    view = watcher.views[-1]
    assert len(watcher.views) == 50
    assert truth.position is not None and view.state.position is not None
    assert np.linalg.norm(view.position - truth.position) < 0.01
    assert np.linalg.norm(view.objects["cube"].position - simulation.objects["cube"].position) < 0.006
    assert 0.0 < view.objects["cube"].age < 0.05
    hands = np.array([simulation.hand_position(side) for side in ("left", "right")])
    assert np.linalg.norm(view.hands - hands, axis=1).max() < 0.03
    assert view.held == (None, None)


def test_a_source_that_would_see_and_lacks_a_part_of_it_is_refused() -> None:
    watcher = Watcher()
    del watcher.grips
    with pytest.raises(ConfigError, match="this lacks grips"):
        ControlLoop(HoldController(load_robot()), watcher, Simulation())


def test_objects_that_come_and_go_are_told_apart() -> None:
    """A motion capture may lose an object, find another one, or list them in another order."""
    near, far = np.array([1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]), np.array([5.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    world = CapturedWorld()
    sight = Sight(world, load_robot())
    for time, seen in enumerate(({"a": near, "b": far}, {"b": far, "a": near}, {"a": near}, {"c": far, "a": near})):
        state = _state(float(time), np.zeros(3), 0.0, np.zeros(3))
        world.take(Capture(float(time), near, tuple(seen), np.array(list(seen.values())), (None, None)))
        objects = sight.look(float(time), state).objects
        assert {name: thing.position[0] for name, thing in objects.items()} == {n: pose[0] for n, pose in seen.items()}


def test_a_late_picture_with_other_objects_does_not_rename_those_of_the_last_good_one() -> None:
    near, far = np.array([1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]), np.array([5.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    world = CapturedWorld()
    sight, places = Sight(world, load_robot()), []
    for now, taken, seen in ((1.0, 1.0, {"a": near, "b": far}), (1.3, 1.01, {"b": far}), (1.31, 1.31, {"b": far})):
        world.take(Capture(taken, near, tuple(seen), np.array(list(seen.values())), (None, None)))
        objects = sight.look(now, _state(now, np.zeros(3), 0.0, np.zeros(3))).objects
        places.append({name: thing.position[0] for name, thing in objects.items()})
    assert places == [{"a": 1.0, "b": 5.0}, {"a": 1.0, "b": 5.0}, {"b": 5.0}]


def test_a_capture_that_falls_silent_shows_its_age_and_then_nothing() -> None:
    told: list[str] = []
    world = CapturedWorld(told.append)
    sight, pose = Sight(world, load_robot()), np.array([1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    for tick in range(200):
        now = 0.01 * tick
        if now <= 1.0:
            trembling = pose + 1e-4 * np.sin(tick) * np.eye(7)[0]  # equal poses would be frozen ones
            world.take(Capture(now, trembling, ("box",), pose[None], (None, None)))
        world.advance(now)
        objects = sight.look(now, _state(now, np.zeros(3), 0.0, np.zeros(3))).objects
        assert ("box" in objects) == (now <= 1.505)
        if "box" in objects:
            assert objects["box"].age == pytest.approx(max(now - 1.0, 0.0), abs=1e-9)
    assert len(told) == 1 and "silent" in told[0]


def test_with_exact_sensors_a_view_is_the_truth() -> None:
    watcher, simulation = Watcher(), Simulation(sensing="exact", scene=_scene(position=(1.0, 0.5)))
    loop = ControlLoop(HoldController(load_robot()), watcher, simulation, UpperBodySource(load_robot()))
    loop.reset()
    loop.decide(0.0)
    view = watcher.views[-1]
    np.testing.assert_array_equal(view.position, simulation.qpos[:3])
    np.testing.assert_array_equal(view.objects["cube"].position, simulation.objects["cube"].position)
    assert view.hand_force is not None


def test_grips_are_carried_out_and_seen() -> None:
    watcher = Watcher(Grip("left", "cube"))
    simulation = Simulation(sensing="exact", scene=_scene(position=(0.41, 0.21, 1.0)))
    loop = ControlLoop(HoldController(load_robot()), watcher, simulation, UpperBodySource(load_robot()))
    loop.reset()
    for tick in range(2):
        loop.decide(tick * loop.period)
    assert watcher.views[-1].held == ("cube", None)
    watcher.grips = (Grip("left", None),)
    loop.decide(0.04)
    watcher.grips = ()
    loop.decide(0.06)
    assert watcher.views[-1].held == (None, None)


def test_a_grip_that_cannot_be_raises_nothing_and_is_noted() -> None:
    simulation = Simulation(sensing="exact", scene=_scene(position=(1.0, 0.5)))
    carry_out([Grip("left", "cube")], simulation)
    assert simulation.objects.problems == []  # out of reach
    for _ in range(2):
        carry_out([Grip("left", "crate")], simulation)
    assert len(simulation.objects.problems) == 1 and "crate" in simulation.objects.problems[0]
    carry_out([Grip("left", "cube")], Simulation(sensing="exact"))

"""What rows measure, by hand, on records and states that are made up."""

import dataclasses
import math
import types

import numpy as np
import pytest

from hugwbc import Command, Gait, load_robot, rotations
from hugwbc.evaluation import metrics
from hugwbc.evaluation.experiments import behaviours, forces, stops
from hugwbc.evaluation.experiments.estimation import EstimateErrors
from hugwbc.evaluation.experiments.faults import GroundSpeeds
from hugwbc.evaluation.plans import Plan
from hugwbc.runtime.controllers import HoldController
from tests.conftest import make_state

ROBOT = load_robot()


def test_a_stop_lasts_until_the_pelvis_is_slow_for_good(monkeypatch, synthetic_trace):
    trace = synthetic_trace(Command(v_x=0.6, gait=Gait.WALKING), duration=8.0)
    speed = np.where(trace.time < 5.0, 0.6, 0.0)
    speed[(trace.time >= 5.4) & (trace.time < 5.5)] = 0.2
    trace.measured[:, 0], trace.qpos[1:, 0] = speed, np.cumsum(speed[:-1]) * 0.02
    monkeypatch.setattr(stops, "simulate", lambda *_: trace)
    plan = Plan(0, tags={"way": "forwards", "at": 4.0})
    row = stops.episode(HoldController(ROBOT), stops.StopsSettings(), plan)
    assert row["stop_s"] == pytest.approx(1.5) and row["moved"] == pytest.approx(0.6 + 0.02)
    trace.measured[-1, 0] = 0.2
    assert stops.episode(HoldController(ROBOT), stops.StopsSettings(), plan)["stop_s"] is None


def test_hands_below_their_targets_sag(monkeypatch, synthetic_trace):
    trace = synthetic_trace(duration=6.0)
    stand = np.concatenate(([0.0, 0.0, 0.98, 1.0, 0.0, 0.0, 0.0], ROBOT.nominal))
    trace = dataclasses.replace(trace, qpos=np.tile(stand, (len(trace.time), 1)))
    hands = metrics.places(trace, ["left_hand", "right_hand"], trace.time >= 0.0)
    trace = dataclasses.replace(trace, hand_target_world=hands + np.array([0.0, 0.0, 0.02]))
    monkeypatch.setattr(forces, "play", lambda *_: trace)
    settings = forces.CarrySettings()
    row = forces.carry_episode(HoldController(ROBOT), settings, forces.carry_plan(settings)[0])
    assert row["sag"] == pytest.approx(0.02)


def test_pressing_too_hard_and_too_softly_are_errors_alike(monkeypatch, synthetic_trace):
    trace = synthetic_trace(duration=2.0)

    def play(controller, settings, plan, source, simulation, duration, on_step):
        for tick in range(round(duration / 0.002)):
            time = 0.002 * tick
            steady = time > forces.BEGIN + forces.PRESSURE / 100.0 + forces.STEADY
            force = (forces.PRESSURE + (-3.0 if tick % 2 else 5.0)) * steady  # before that, nothing counts
            state = make_state(time=time, hand_force=np.array([[-force, 7.0, 7.0], [9.0, 0.0, 0.0]]))
            on_step(state, state)
        return trace

    monkeypatch.setattr(forces, "simulation_of", lambda *_: None)
    monkeypatch.setattr(forces, "play", play)
    row = forces.press_episode(HoldController(ROBOT), forces.PressSettings(), Plan(0))
    assert row["error"] == pytest.approx(4.0, abs=0.01)


def test_arrival_is_measured_at_the_true_pelvis(monkeypatch):
    state, row = make_state(position=(1.3, -0.4, 0.98), yaw=-3.1), {"success": True}
    monkeypatch.setattr(behaviours, "play", lambda *_: (row, types.SimpleNamespace(state=lambda: state)))
    plan = Plan(0, tags={"x": 1.0, "y": 0.0, "yaw": 3.1})
    found = behaviours.arrive_episode(HoldController(ROBOT), behaviours.ArriveSettings(), plan)
    assert found["distance"] == pytest.approx(0.5)
    assert found["angle"] == pytest.approx(math.degrees(2.0 * math.pi - 6.2))
    row["success"] = False
    assert behaviours.arrive_episode(HoldController(ROBOT), behaviours.ArriveSettings(), plan)["distance"] is None


def test_the_speed_at_the_ground_is_that_of_pelvis_or_trunk():
    simulation = types.SimpleNamespace(robot=ROBOT, ground_height=lambda xy: 0.0)
    watch = GroundSpeeds(simulation, 1.0)  # type: ignore[arg-type]

    def step(time, links, pelvis, trunk, height=0.3):
        simulation.links_on_ground, simulation.trunk_velocity = links, np.array([0.0, 0.0, -trunk])
        watch(make_state(position=(0.0, 0.0, height), velocity=(0.0, 0.0, -pelvis), time=time), None)  # type: ignore[arg-type]
        return watch.touch_speed

    assert step(1.1, ("left_ankle_link",), 2.0, 2.0) is None, "a foot"
    assert step(1.15, ("left_knee_link",), 2.0, 2.0, height=0.98) is None, "it stands"
    assert step(1.2, ("left_knee_link",), 0.8, 3.0) == pytest.approx(0.8)
    assert step(1.3, ("left_knee_link", "torso_link"), 0.5, 1.5) == pytest.approx(1.5)
    assert step(1.4, ("torso_link",), 5.0, 5.0) == pytest.approx(1.5), "it lies there already"
    assert not watch.before
    watch = GroundSpeeds(simulation, 1.0)  # type: ignore[arg-type]
    assert step(0.9, ("left_knee_link",), 1.0, 1.0) is None and watch.before


def test_errors_of_an_estimate_are_of_its_own_time_and_in_the_heading_frame():
    """The robot faces the world's y axis: a tilt about y is a roll, and motion along x goes to the right."""
    covariance = np.diag([0.01**2] * 3 + [0.1**2] * 3)
    estimator = types.SimpleNamespace(contact=np.array([True, False]), covariance=lambda: covariance)
    errors = EstimateErrors(estimator)  # type: ignore[arg-type]

    def truth(time):
        feet = np.array([[0.0, 0.0, 300.0], [0.0, 0.0, 0.0]])
        place, velocity = (time, 0.0, 1.0), (0.5 * time, 0.2, 0.0)
        return make_state(yaw=np.pi / 2, position=place, velocity=velocity, foot_force=feet, time=time)

    tilt = rotations.from_axis_angle(np.array([0.0, 1.0, 0.0]), 0.02)
    for time in 1.0 + 0.002 * np.arange(4):
        then = truth(time - 0.004)
        estimate = dataclasses.replace(
            then,
            orientation=rotations.multiply(tilt, then.orientation),
            velocity=then.velocity + np.array([0.1, 0.0, 0.0]),
            position=then.position + np.array([0.3, 0.0, 0.0]),
        )
        errors(truth(time), estimate)
    found = errors.record(0.0)
    np.testing.assert_allclose(found["time"], [1.0, 1.002])
    np.testing.assert_allclose(found["tilt"], [[0.02, 0.0]] * 2, atol=1e-5)
    np.testing.assert_allclose(found["velocity"], [[0.0, -0.1, 0.0]] * 2, atol=1e-9)
    np.testing.assert_allclose(found["position"], [[0.3, 0.0, 0.0]] * 2, atol=1e-9)
    np.testing.assert_allclose(found["yaw"], 0.0, atol=1e-9)
    assert found["nees"][0] == pytest.approx(5.0, rel=1e-3) and np.isnan(found["nees"][1])
    assert found["inferred"][0].tolist() == found["touching"][0].tolist() == [True, False]

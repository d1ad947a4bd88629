"""The protocol of faults: its plans, its figures, and a short walk with each kind of end."""

import dataclasses
import types

import numpy as np
import pytest

from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.protocols.faults import FAULTS, FOR_GOOD, FaultEpisode, FaultsConfig, FaultsProtocol, GroundWatch
from hugwbc.sim import Simulation


def episode(fault, touch_speed, *, fell):
    return FaultEpisode(
        fault,
        (),
        fell=fell,
        refused=3,
        lowered=fell,
        touch_speed=touch_speed,
        first_touch_speed=touch_speed,
        highest_speed=1.5,
    )


def test_every_fault_meets_the_same_walks():
    settings = FaultsConfig(episodes=2)
    plans = FaultsProtocol().plans(settings)
    assert [plan.label for plan in plans] == [name for name in FAULTS for _ in range(2)]
    by_fault = {name: [p for p in plans if p.label == name] for name in FAULTS}
    starts = {tuple(p.stage.start for p in found) for found in by_fault.values()}
    assert len(starts) == 1 and all(3.0 <= start < 4.0 for start in starts.pop())
    gone = by_fault["IMU gone for 200 ms"][0]
    assert gone.conditions.declared_faults[0].start == gone.stage.start
    stuck = [p.conditions.declared_faults[0].joint for p in by_fault[FOR_GOOD[1]]]
    assert stuck == ["left_hip_pitch_joint", "right_hip_pitch_joint"]
    assert by_fault["latency of 40 ms"][0].conditions.latency == 0.04
    dead = [p.conditions.declared_faults[0].joint for p in by_fault["motor of an arm dead"]]
    assert dead == ["left_shoulder_pitch_joint", "right_shoulder_pitch_joint"]
    assert by_fault["10 kg on the torso"][0].conditions.payload == 10.0


def test_faults_are_chosen_by_words():
    settings = FaultsConfig(episodes=1, only=("for good", "motor of"))
    assert [p.label for p in FaultsProtocol().plans(settings)] == [
        "motor of an arm dead",
        "motor of a leg dead",
        *FOR_GOOD,
    ]
    with pytest.raises(ConfigError, match=r"no fault has 'engine' in its name.*IMU gone for 200 ms"):
        FaultsConfig(only=("engine",))


def test_what_counts_is_a_fall_or_the_speed_at_the_ground():
    rows = [episode("none", None, fell=False), episode("none", 2.0, fell=True)]
    rows += [episode(FOR_GOOD[0], speed, fell=True) for speed in (0.8, 1.2, None)]
    figures = FaultsProtocol().summarise(FaultsConfig(episodes=2), rows)["faults"]
    assert (figures["none"].held, figures["none"].episodes, figures["none"].touch_speed) == (1, 2, 2.0)
    good = figures[FOR_GOOD[0]]
    assert (good.held, good.highest_touch_speed) == (1, 1.2) and good.touch_speed == pytest.approx(1.0)


def test_the_watch_notes_the_highest_speed_at_which_a_link_touches_first():
    simulation = types.SimpleNamespace(
        links_on_ground=("left_ankle_link",),
        link_names=Simulation(sensing="exact").link_names,
        trunk_velocity=np.array([0.0, -3.0, -4.0]) / 2.0,
    )
    state = dataclasses.replace(Simulation(sensing="exact").state(), time=1.0)

    def watch_at(watch, speed, height):
        state.velocity[:], state.position[2] = (speed, 0.0, 0.0), height
        watch(state, state)

    watch = GroundWatch(simulation, start=0.5)
    watch_at(watch, 0.6, 0.7)
    assert watch.touch_speed is None
    simulation.links_on_ground = ("left_ankle_link", "right_knee_link")
    watch_at(watch, 0.9, 0.5)
    watch_at(watch, 1.3, 0.4)
    assert (watch.touch_speed, watch.highest_speed) == (0.9, 1.3), "a link that lies on the ground touches it no more"
    simulation.links_on_ground = ("right_knee_link", "left_knee_link")
    watch_at(watch, 1.2, 0.3)
    assert watch.touch_speed == 1.2, "a fall from one knee counts"
    simulation.links_on_ground = ("right_knee_link", "left_knee_link", "torso_link")
    watch_at(watch, 0.1, 0.2)
    assert watch.touch_speed == pytest.approx(2.5), "a trunk that turns about a slow pelvis"
    assert watch.first_touch_speed == 0.9


def test_settings_without_the_sensors_of_an_h1_are_refused():
    with pytest.raises(ConfigError, match="sensors of an H1"):
        FaultsConfig(conditions=Conditions(sensing="exact"))
    with pytest.raises(ConfigError, match="duration"):
        FaultsConfig(duration=5.0)
    with pytest.raises(UnknownNameError, match="imu-gone"):
        Conditions(faults=("gone@1",))

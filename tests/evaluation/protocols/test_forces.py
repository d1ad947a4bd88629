"""The protocol of forces: its settings, its judge by hand, and short runs of each part."""

import dataclasses
import json

import numpy as np
import pytest

from hugwbc.cli import main
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.protocols import forces
from hugwbc.evaluation.protocols.forces import BEGIN, ForcesConfig, ForcesProtocol
from hugwbc.gait import Gait
from hugwbc.robot import load_robot
from hugwbc.runtime.controllers import HoldController, load_controller
from hugwbc.state import RobotState


def test_settings_refuse_nonsense():
    with pytest.raises(UnknownNameError, match="part of the forces protocol"):
        ForcesConfig(part="lift")
    with pytest.raises(ConfigError, match="force is -1"):
        ForcesConfig(force=-1.0)
    with pytest.raises(ConfigError, match="gait is jumping"):
        ForcesConfig(gait=Gait.JUMPING)
    with pytest.raises(ConfigError, match="leave the intervention at none"):
        ForcesConfig(conditions=Conditions(intervention="noise"))


def test_only_carrying_loads_the_hands():
    assert ForcesConfig(load=2.0).loaded().conditions.hand_payload == 2.0
    assert ForcesConfig(part="pull").loaded().conditions.hand_payload == 0.0


def test_the_commands_and_targets_of_the_parts():
    walk = forces._Source(ForcesConfig(gait=Gait.WALKING, v_x=0.4))
    assert walk.command_at(0.5).gait is Gait.STANDING
    assert walk.command_at(5.0).v_x == 0.4
    press = forces._Source(ForcesConfig(part="press", force=15.0, gait=Gait.WALKING))
    assert press.command_at(5.0).gait is Gait.STANDING
    before, hands = press.hands_at(BEGIN - 0.1), press.hands_at(BEGIN)
    assert before is not None and before.left_force is None
    assert hands is not None and hands.left_force is not None and hands.left_force.tolist() == [15.0, 0.0, 0.0]


def test_the_hands_sway_in_the_steady_frame_and_with_stiff_arms():
    settings = ForcesConfig(part="sway", v_x=0.5)
    assert settings.walks
    hands = forces._Source(settings).hands_at(5.0)
    stiff = forces._Source(settings, np.zeros(8)).hands_at(5.0)
    assert hands is not None and hands.frame == "steady"
    assert stiff is not None and stiff.left is None and stiff.joints is not None


def test_the_acceleration_of_a_hand_that_is_shaken():
    watch = forces._HandWatch(load_robot())
    for tick in range(2000):
        time = forces.SWAYED_FROM - 1.0 + 0.002 * tick
        shaken = np.array([0.5 * time, 0.01 * np.sin(2.0 * np.pi * 2.0 * time), 1.0])
        watch(dataclasses.replace(state(time), position=shaken), state(time))
    # A sine of 1 cm at 2 Hz has an acceleration of 1.58 m/s^2, and 1 / sqrt(2) of it on average.
    assert watch.acceleration() == pytest.approx(0.01 * (4.0 * np.pi) ** 2 / np.sqrt(2.0), rel=0.01)
    assert len(watch.points) == 150


@pytest.mark.slow
def test_steady_hands_are_far_stiller_than_stiff_arms():
    settings = ForcesConfig(part="sway", v_x=0.5, episodes=1, seed=7)
    result = ForcesProtocol().run(lambda: load_controller("learned"), settings)
    assert result.falls == 0 and result.ratio is not None and result.ratio < 0.6


def state(time, force=None):
    return RobotState(
        q=np.zeros(19), dq=np.zeros(19), orientation=np.array([1.0, 0, 0, 0]), angular_velocity=np.zeros(3),
        position=np.array([0.1 * time, 0.0, 1.0]), hand_force=force, time=time,
    )  # fmt: skip


def test_the_press_is_judged_by_the_contact_force():
    watch = forces._Watch(ForcesConfig(part="press", force=20.0), None)
    touching = np.array([[-17.0, 5.0, 0.0], [0.0, 0.0, 0.0]])
    for time in (1.0, 4.1, 4.3, 5.0):
        watch(state(time, touching), state(time, touching + np.array([[0.0, 3.0, 0.0], [0.0, 0.0, 4.0]])))
    assert watch.misses == [pytest.approx(3.0)] * 2, "from a second after the force has risen"
    assert np.mean(watch.squares) == pytest.approx(0.5 * (9.0 + 16.0))
    assert watch.end[0] - watch.begun[0] == pytest.approx(0.09)


def test_a_press_has_a_wall_to_press():
    settings = ForcesConfig(part="press")
    assert forces._simulation(settings, (0, 0), 1.0).scene is not None
    assert forces._simulation(dataclasses.replace(settings, part="pull"), (0, 0), 1.0).scene is None


def test_the_load_is_the_truth_of_carrying():
    watch = forces._Watch(ForcesConfig(load=2.0), None)
    watch(state(5.0), dataclasses.replace(state(5.0), hand_force=np.tile((0.0, 0.0, -19.62), (2, 1))))
    assert watch.squares == [pytest.approx(0.0)]


def test_a_robot_that_falls_has_no_figures():
    result = ForcesProtocol().run(HoldController, ForcesConfig(part="carry", episodes=1, load=5.0))
    assert result.falls == 1 and result.sag is None
    assert "falls: 1 of 1" in ForcesProtocol().describe(result)


@pytest.mark.slow
def test_the_learned_controller_carries_and_is_pushed(monkeypatch):
    walk = ForcesConfig(gait=Gait.WALKING, episodes=1, seed=1)
    result = ForcesProtocol().run(lambda: load_controller("learned"), walk)
    assert result.falls == 0
    assert result.sag is not None and abs(result.sag) < 0.03
    assert result.estimate_error is not None and result.estimate_error < 12.0
    monkeypatch.setattr(forces, "DIRECTIONS", (0,))
    pushed = ForcesProtocol().run(lambda: load_controller("learned"), ForcesConfig(part="push", episodes=1, seed=1))
    assert pushed.rows[-1].fell or pushed.change["0"] == forces.PUSH_MOST
    assert pushed.median_change == pushed.change["0"]


def test_the_command_writes_the_figures(tmp_path, monkeypatch):
    monkeypatch.setattr(forces, "DIRECTIONS", (0, 180))
    path = tmp_path / "forces.json"
    words = ["evaluate", "forces", "--controller", "hold", "--part", "pull", "--force", "60", "--episodes", "1"]
    assert main([*words, "--json", str(path)]) == 0
    figures = json.loads(path.read_text())
    assert figures["part"] == "pull" and set(figures["held"]) == {"0", "180"} and figures["falls"] == 2

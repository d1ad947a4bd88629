import dataclasses
import json

import numpy as np
import pytest

from hugwbc.cli import main
from hugwbc.errors import ConfigError
from hugwbc.evaluation import metrics
from hugwbc.evaluation.protocols.hands import HIGH, LOW, HandsConfig, HandsProtocol, hands_script, reachable_targets
from hugwbc.gait import Gait
from hugwbc.mbc import WholeBodyController
from hugwbc.robot import load_robot
from hugwbc.runtime.controllers import HoldController


def test_jitter_by_hand():
    t = np.arange(0.0, 1.0, 0.1)
    assert metrics.jitter(np.stack((2.0 * t**3, t**2), axis=1), 0.1) == pytest.approx((12.0**2 + 0.0) / 2)
    gap = np.array([[np.nan]] + [[s**3] for s in t])
    assert metrics.jitter(gap, 0.1) == pytest.approx(36.0)
    assert np.isnan(metrics.jitter(gap[:4], 0.1))


def test_targets_are_reachable_in_front_of_each_hand_and_the_same_for_a_seed():
    pairs, again = (reachable_targets(4, np.random.default_rng(1), load_robot()) for _ in range(2))
    assert np.array_equal(pairs, again)
    left, right = pairs[:, 0], pairs[:, 1] * [1.0, -1.0, 1.0]
    assert np.all((left >= LOW) & (left <= HIGH) & (right >= LOW) & (right <= HIGH))
    assert np.linalg.norm(left - [0.0, 0.2136, 0.4389], axis=1).max() < 0.64, "no farther than the arm is long"


def test_a_walk_starts_from_a_stand():
    script = hands_script(HandsConfig(gait=Gait.WALKING, v_x=0.4, duration=4.0), np.random.default_rng(0))
    assert script.command_at(0.5).gait is Gait.STANDING
    assert script.command_at(3.0).v_x == 0.4
    assert script.hands_at(0.0) is not None and script.duration == 4.0


def test_the_qp_standing_is_within_the_figures_and_a_falling_robot_is_told():
    config = HandsConfig(gait=Gait.STANDING, episodes=1, duration=3.0, settle=2.0)
    result = HandsProtocol().run(WholeBodyController, config)
    assert result.fell == 0 and result.controller == "qp" and result.v_x == 0.0
    assert result.hand_error_m["mean"] < 0.015 and result.hand_error_m["p95"] < 0.04  # type: ignore[operator]
    assert result.joint_error_rad < 0.05  # type: ignore[operator]
    assert result.saturated_ticks == 0
    assert result.hand_error_m["reachable_fraction"] == result.rows[0].reachable_fraction == 1.0
    assert result.hand_error_m["all_mean"] == result.rows[0].hand_error_all_m == result.hand_error_m["mean"]
    fallen = HandsProtocol().run(HoldController, config)
    assert fallen.fell == 1
    assert fallen.hand_error_m["mean"] is None and fallen.jitter is None


def test_the_hands_are_those_of_the_robot_that_is_asked_for(monkeypatch):
    from hugwbc.evaluation.conditions import Conditions
    from hugwbc.evaluation.protocols import hands

    robots = []

    class Source(hands.UpperBodySource):
        def __init__(self, *, robot):
            robots.append(robot.name)
            super().__init__(robot=robot)

    monkeypatch.setattr(hands, "UpperBodySource", Source)
    conditions = Conditions(robot="h1-2023", told="h1")
    config = HandsConfig(gait=Gait.STANDING, episodes=1, duration=0.4, settle=0.1, conditions=conditions)
    HandsProtocol().run(HoldController, config)
    HandsProtocol().run(HoldController, dataclasses.replace(config, conditions=Conditions(robot="h1-2023")))
    assert robots == ["h1", "h1-2023"]


def test_the_command_writes_the_figures(tmp_path, capsys):
    path = tmp_path / "hands.json"
    words = ["evaluate", "hands", "--controller", "hold", "--gait", "standing"]
    assert main([*words, "--episodes", "1", "--duration", "0.6", "--settle", "0.1", "--json", str(path)]) == 0
    figures = json.loads(path.read_text())
    assert {"hand_error_m", "fell", "saturated_ticks", "jitter", "joint_error_rad"} <= set(figures)
    assert figures["settle"] == 0.1 and figures["conditions"]["sensing"] is None
    assert {"all_mean", "all_p95", "reachable_fraction"} <= set(figures["hand_error_m"])
    out = capsys.readouterr().out
    assert "hand error p95 [cm]" in out and "hand error mean, all targets [cm]" in out
    assert "part of targets that the IK calls reachable" in out


def test_bad_settings_are_refused():
    with pytest.raises(ConfigError, match="give 0 <= settle < duration"):
        HandsConfig(gait=Gait.STANDING, duration=1.0)
    with pytest.raises(ConfigError, match="episodes is 0"):
        HandsConfig(gait=Gait.STANDING, episodes=0)

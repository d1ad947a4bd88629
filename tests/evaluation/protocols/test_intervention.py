import dataclasses

import numpy as np
import pytest

from hugwbc import Command, Gait
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.intervals import Estimate
from hugwbc.evaluation.protocols.episodes import Run
from hugwbc.evaluation.protocols.intervention import (
    InterventionConfig,
    InterventionJudge,
    InterventionProtocol,
    InterventionResult,
)
from hugwbc.runtime.controllers import HoldController

NOISE = Conditions(intervention="noise")


def test_every_intervention_has_the_same_commands_and_its_own_arms():
    config = InterventionConfig(Gait.STANDING, episodes=11, seed=2, duration=0.4, settle=0.1)
    seen = []
    result = InterventionProtocol().run(HoldController, config, seen.append)
    assert config.samples == result.episodes == 3 and result.rows == tuple(seen) and len(seen) == 9
    commands = {
        kind: [(row.command, row.value) for row in seen if row.intervention == kind]
        for kind in ("none", "noise", "motion")
    }
    assert commands["none"] == commands["noise"] == commands["motion"]
    assert [name for name, _ in commands["none"]] == ["h", "p", "w"]
    assert result.arm_error["none"] is None
    assert 0.0 < result.arm_error["noise"] != result.arm_error["motion"] > 0.0  # type: ignore[operator]
    for kind, errors in result.errors.items():
        rows = [row for row in seen if row.intervention == kind]
        assert errors == {f"E_{row.command}": row.error for row in rows}
    assert result.falls == dict.fromkeys(("none", "noise", "motion"), 0)
    assert result.paper["noise"] == {"E_h": 0.0291, "E_p": 0.0662, "E_w": 0.0605}
    other = InterventionProtocol().run(HoldController, dataclasses.replace(config, training="none"))
    assert other.paper["motion"]["E_p"] == 0.2571 and other.errors == result.errors


@pytest.mark.parametrize("speed", [0.5, 1.5])
def test_prescribed_errors_come_out(synthetic_trace, speed):
    walk = Command(gait=Gait.WALKING, v_x=speed)
    trace = synthetic_trace(walk, bias={"v_x": -0.07, "h": 0.4})
    row = InterventionJudge(1.0)(0, Run(EpisodePlan(walk, conditions=NOISE, label="v_x"), trace, 0.25))
    assert row.error == pytest.approx(0.07) and row.arm_error == 0.25 and row.intervention == "noise"
    trace = synthetic_trace(walk, frequency=walk.f + 0.3, apex=walk.l + 0.02)
    for name, error in (("f", 0.3), ("l", 0.02)):
        row = InterventionJudge(1.0)(0, Run(EpisodePlan(walk, conditions=NOISE, label=name), trace, np.nan))
        assert row.error == pytest.approx(error, abs=0.002) and row.arm_error is None


def test_bad_settings_are_refused():
    with pytest.raises(ConfigError, match="give 24 or more: 3 interventions and 8 commands"):
        InterventionConfig(Gait.WALKING, episodes=23)
    with pytest.raises(ConfigError, match="runs every intervention"):
        InterventionConfig(Gait.WALKING, conditions=NOISE)
    with pytest.raises(UnknownNameError, match="Did you mean 'noise'"):
        InterventionConfig(Gait.WALKING, training="noisy")


KINDS = ("none", "noise", "motion")
PAPER = {"noise": {"E_vx": 0.2, "v_x": 0.5}, "none": {}}


def test_interventions_stand_beside_the_paper(lines, standing):
    result = InterventionResult(
        training="noise",
        episodes=3,
        falls={"none": 0, "noise": 1, "motion": 0},
        errors={kind: {"E_h": 0.05, "E_p": None} for kind in KINDS},
        intervals={"none": {"E_h": Estimate(0.05, 0.04, 0.07, 3)}},
        arm_error={"none": None, "noise": 0.125, "motion": 0.2},
        paper={"none": {"E_h": 0.1, "E_p": 0.2}, "noise": {"E_h": 0.025}, "motion": {}},
        **standing,
    )
    none, noise, motion = InterventionProtocol().describe(result).split("arms: ")[1:]
    assert lines(none)["E_h"] == ["0.0500", "0.0400 to 0.0700", "0.1000", "0.500"]
    assert lines(none)["E_p"] == ["-", "-", "0.2000", "-"]
    assert lines(noise)["E_h"][-1] == "2.000" and lines(motion)["E_h"] == ["0.0500", "-", "-", "-"]
    assert "falls: 1 of 3 episodes (33.3 %) [6.1, 79.2]; arm joints 0.125 rad" in noise and "arm joints" not in none


def measured_under(training: str, gait: str = "walking") -> dict:
    """A result with one error under noise in an upright episode, ten in a fall, and one with free arms."""
    rows = [
        {"intervention": arms, "command": "v_x", "error": error, "fell": fell}
        for arms, error, fell in (("noise", 0.4, False), ("noise", 9.0, True), ("none", 0.1, False))
    ]
    errors = {arms: {"E_vx": 0.0} for arms in PAPER}
    return {"gait": gait, "training": training, "paper": PAPER, "rows": rows, "errors": errors}


def test_the_report_has_a_table_for_each_kind_of_arms():
    noise, falls, free, _ = InterventionProtocol().figures("qp", measured_under("noise"))
    assert noise.table == "Intervention, walking, arms moved by noise" and noise.unit == "m/s"
    assert noise.value == pytest.approx(4.7) and noise.paper == 0.2 and falls.value == 50.0
    assert free.value == 0.1 and free.paper is None
    assert {noise.reference, falls.reference} == {"trained with noise"}


def test_the_paper_stands_alone_where_nothing_of_its_training_was_measured():
    protocol = InterventionProtocol()
    measured = [(name, measured_under(name, "standing")) for name in ("noise", "motion", "none")]
    assert protocol.published(measured) == protocol.published([]) == []
    alone = protocol.published(measured[:1])
    assert {f.reference for f in alone} == {"trained with motions", "trained without intervention"}
    assert {f.controller for f in alone} == {""} and all(f.value is None and f.paper for f in alone)
    assert len(alone) == 2 * 3 * 3, "two trainings, three kinds of arms, three commands of standing"


def test_a_controller_is_compared_with_the_papers_policy_of_its_training():
    protocol, config = InterventionProtocol(), InterventionConfig(Gait.STANDING)
    trainings = [protocol.for_training(config, training).training for training in ("motion", None)]
    assert trainings == ["motion", "noise"]
    assert protocol.for_training(dataclasses.replace(config, training="none"), "motion").training == "none"

import pytest

from hugwbc import Gait, JointCommand
from hugwbc.commands import default_command
from hugwbc.errors import ConfigError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.intervals import Estimate
from hugwbc.evaluation.protocols.episodes import EpisodeSettings, run_episodes
from hugwbc.evaluation.protocols.foot_displacement import (
    FootDisplacementConfig,
    FootDisplacementProtocol,
    FootDisplacementResult,
)
from hugwbc.evaluation.protocols.intervention import InterventionJudge
from hugwbc.mbc import WholeBodyController
from hugwbc.runtime.controllers import HoldController


class LimpForTall(HoldController):
    """Falls where a pitch is commanded, and stands otherwise."""

    def act(self, state, command, upper_body):
        output = super().act(state, command, upper_body)
        stiff = float(command.p == 0.0)
        return JointCommand(output.q, output.dq, stiff * output.kp, stiff * output.kd, output.tau)


def test_falls_are_left_out_and_counted():
    config = FootDisplacementConfig(episodes=9, duration=1.2, settle=0.2)
    result = FootDisplacementProtocol().run(LimpForTall, config)
    assert result.falls == dict.fromkeys(("none", "noise", "motion"), 1) and result.episodes == 3
    for kind, lengths in result.displacement.items():
        assert lengths["p"] is None
        rows = {row.command: row.foot_travel for row in result.rows if row.intervention == kind}
        assert lengths["h"] == rows["h"] and lengths["w"] == rows["w"]
    assert result.paper["noise"] == {"h": 0.0339, "p": 0.0892, "w": 0.0199}


def test_a_qp_that_stands_still_does_not_move_its_feet():
    plan = EpisodePlan(default_command(Gait.STANDING), conditions=Conditions(), label="h")
    (row,) = run_episodes(WholeBodyController, [plan], InterventionJudge(1.0), EpisodeSettings(duration=2.0))
    assert not row.fell and row.foot_travel is not None and row.foot_creep is not None
    assert row.foot_travel - row.foot_creep == 0.0
    assert row.foot_travel < 0.002


def test_bad_settings_are_refused():
    with pytest.raises(ConfigError, match="the gait is walking"):
        FootDisplacementConfig(Gait.WALKING)
    with pytest.raises(ConfigError, match="give 9 or more: 3 interventions and 3 commands"):
        FootDisplacementConfig(episodes=8)


KINDS = ("none", "noise", "motion")


def test_foot_displacement_says_what_is_creep(lines, standing):
    table = {kind: {"h": 0.02, "p": None} for kind in KINDS}
    result = FootDisplacementResult(
        training="noise",
        episodes=2,
        falls=dict.fromkeys(KINDS, 1),
        displacement=table,
        intervals={kind: {"h": Estimate(0.02, 0.018, 0.023, 4)} for kind in KINDS},
        creep={kind: {"h": 0.015, "p": None} for kind in KINDS},
        paper={kind: {"h": 0.01, "p": 0.1} for kind in KINDS},
        **standing,
    )
    text = FootDisplacementProtocol().describe(result)
    assert lines(text)["noise, h"] == ["0.0200", "0.0180 to 0.0230", "0.0100", "2.000", "0.0150"]
    assert lines(text)["noise, p"] == ["-", "-", "0.1000", "-", "-"], "nobody was upright to creep"
    assert "in 9 s; falls: none 1 of 2 episodes (50.0 %) [9.5, 90.5], noise 1 of 2 episodes" in text


def measured_under(training: str) -> dict:
    """A result with one path under noise in an upright episode, a longer one in a fall, and one with free arms."""
    paper = {"noise": {"h": 0.5}, "none": {}}
    rows = [
        {"intervention": arms, "command": "h", "foot_travel": path, "fell": fell}
        for arms, path, fell in (("noise", 0.4, False), ("noise", 9.0, True), ("none", 0.1, False))
    ]
    return {"training": training, "paper": paper, "rows": rows, "displacement": {arms: {"h": 0.0} for arms in paper}}


def test_the_path_of_a_robot_that_fell_says_nothing():
    noise, falls, *_ = FootDisplacementProtocol().figures("qp", measured_under("noise"))
    assert noise.value == 0.4 and noise.paper == 0.5 and falls.value == 50.0
    assert {noise.reference, falls.reference} == {"trained with noise"}


def test_the_paper_stands_alone_where_nothing_of_its_training_was_measured():
    protocol = FootDisplacementProtocol()
    measured = [(name, measured_under(name)) for name in ("noise", "motion", "none")]
    assert protocol.published(measured) == protocol.published([]) == []
    alone = protocol.published(measured[:1])
    assert {f.reference for f in alone} == {"trained with motions", "trained without intervention"}
    assert {f.controller for f in alone} == {""} and all(f.value is None and f.paper for f in alone)
    assert len(alone) == 2 * 3 * 3, "two trainings, three kinds of arms, three commands of standing"

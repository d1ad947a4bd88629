import pytest

from hugwbc import Gait, JointCommand
from hugwbc.commands import default_command
from hugwbc.errors import ConfigError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.protocols import FootDisplacementConfig, run_foot_displacement
from hugwbc.evaluation.protocols.episodes import EpisodeSettings, run_episodes
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
    result = run_foot_displacement(LimpForTall, config)
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

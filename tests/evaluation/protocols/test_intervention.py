import dataclasses

import numpy as np
import pytest

from hugwbc import Command, Gait
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.protocols import InterventionConfig, run_intervention
from hugwbc.evaluation.protocols.episodes import Run
from hugwbc.evaluation.protocols.intervention import InterventionJudge
from hugwbc.runtime.controllers import HoldController

NOISE = Conditions(intervention="noise")


def test_every_intervention_has_the_same_commands_and_its_own_arms():
    config = InterventionConfig(Gait.STANDING, episodes=11, seed=2, duration=0.4, settle=0.1)
    seen = []
    result = run_intervention(HoldController, config, seen.append)
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
    other = run_intervention(HoldController, dataclasses.replace(config, training="none"))
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

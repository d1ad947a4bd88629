import dataclasses

import numpy as np
import pytest

from hugwbc import Command, Gait
from hugwbc.errors import ConfigError
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.figures import FALLS
from hugwbc.evaluation.intervals import Estimate
from hugwbc.evaluation.protocols.episodes import Run
from hugwbc.evaluation.protocols.ramp import RampConfig, RampJudge, RampProtocol, RampResult, ramp_schedule
from hugwbc.kinematics import MEASURED_NAMES
from hugwbc.runtime.controllers import HoldController

CONFIG = RampConfig(Gait.WALKING, duration=14.0, settle=4.0)


def test_the_ramp_goes_from_minimum_to_maximum():
    waist = ramp_schedule(CONFIG, "w")
    wanted = {0.5: 0.0, 2.0: -0.5, 3.5: -1.0, 4.0: -1.0, 9.0: 0.0, 14.0: 1.0}
    for t, w in wanted.items():
        command = waist.command_at(t)
        assert command.w == pytest.approx(w) and dataclasses.replace(command, w=0.0) == Command(gait=Gait.WALKING), t
    assert ramp_schedule(CONFIG, "p").command_at(9.0).p == pytest.approx(0.2)


def test_a_prescribed_lag_is_the_error(synthetic_trace):
    """A robot that is 0.3 s late is 0.06 rad off on a ramp of 2 rad in 10 s."""
    schedule, lag = ramp_schedule(CONFIG, "w"), 0.3
    time = np.arange(0.0, 14.0, 0.02)
    command = np.array([schedule.command_at(t).array() for t in time.tolist()])
    measured = np.zeros((time.size, 6))
    measured[:, MEASURED_NAMES.index("w")] = [schedule.command_at(t - lag).w for t in time.tolist()]
    trace = synthetic_trace(Command(gait=Gait.WALKING), duration=14.0)
    trace = dataclasses.replace(trace, command=command, measured=measured)
    plan = EpisodePlan(schedule, conditions=CONFIG.conditions, label="w")
    row = RampJudge(4.0)(0, Run(plan, trace, np.nan))
    # On the plateau before, the lag does not show for its first 0.3 s: half of it counts there.
    assert row.error == pytest.approx(0.2 * lag * (1.0 - 0.15 / 10.0), abs=1e-3)
    assert next(iter(row.curve)) == "-1.000" and list(row.curve)[-1] == "1.000" and len(row.curve) == 21
    assert row.curve["0.000"] == pytest.approx(-0.06)
    fallen = dataclasses.replace(
        trace, fell=True, survived_s=9.0, **{n: getattr(trace, n)[:450] for n in ("time", "command", "measured")}
    )
    assert list(RampJudge(4.0)(0, Run(plan, fallen, np.nan)).curve)[-1] == "-0.100"


def test_every_run_has_another_robot_and_both_commands_the_same_ones():
    result = RampProtocol().run(HoldController, RampConfig(Gait.STANDING, episodes=2, duration=3.4, settle=3.0))
    robots = [(row.payload, row.friction, row.gain) for row in result.rows]
    assert robots[:2] == robots[2:] and robots[0] != robots[1]
    assert all(-2.0 <= payload <= 4.0 and 0.4 <= friction <= 1.5 for payload, friction, _ in robots if friction)
    assert result.paper == {"E_p": 0.0712, "E_w": 0.0718}
    assert [row.command for row in result.rows] == ["p", "p", "w", "w"]


def test_bad_settings_are_refused():
    for changes, message in (
        ({"gait": Gait.HOPPING_LEFT}, "hopping does not command p and w"),
        ({"settle": 2.0}, "give 3.0 s or more"),
        ({"episodes": 0}, "give 1 or more"),
    ):
        with pytest.raises(ConfigError, match=message):
            RampConfig(**{"gait": Gait.WALKING, **changes})


def test_errors_stand_beside_the_paper(lines, walking):
    errors, paper = {"E_p": 0.05, "E_w": None}, {"E_p": 0.1, "E_w": 0.2}
    intervals = {"E_p": Estimate(0.05, 0.04, 0.07, 5)}
    text = RampProtocol().describe(
        RampResult(episodes=5, falls={"p": 1, "w": 0}, errors=errors, intervals=intervals, paper=paper, **walking)
    )
    assert lines(text)["E_p"] == ["0.0500", "0.0400 to 0.0700", "0.1000", "0.500"]
    assert "falls: p 1 of 5 runs (20.0 %) [3.6, 62.4], w 0 of 5 runs (0.0 %) [0.0, 43.4]" in text


def test_the_reports_figures_of_ramps():
    rows = [{"command": "p", "error": 0.1, "fell": False}, {"command": "w", "error": 0.3, "fell": False}]
    figures = RampProtocol().figures("qp", {"gait": "standing", "paper": {"E_p": 0.07}, "rows": rows})
    assert [(f.quantity, f.value, f.paper) for f in figures] == [
        ("E_p", 0.1, 0.07),
        ("E_w", 0.3, None),
        (FALLS, 0.0, None),
    ]

import dataclasses
import json

import numpy as np
import pytest

from hugwbc import Command, Gait
from hugwbc.errors import ConfigError
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.figures import FALLS
from hugwbc.evaluation.protocols import protocol as module
from hugwbc.evaluation.protocols.episodes import Run
from hugwbc.evaluation.protocols.heatmap import (
    HeatmapConfig,
    HeatmapEpisode,
    HeatmapJudge,
    HeatmapProtocol,
    HeatmapResult,
    OrthogonalRange,
    heatmap_plans,
    relative_maps,
)
from hugwbc.runtime.controllers import HoldController

STANDING = HeatmapConfig(Gait.STANDING, points=3)


def test_every_pair_is_scanned_over_both_ranges():
    plans = heatmap_plans(STANDING)
    assert len(plans) == STANDING.episodes == 3 * 3 + 3 * 9
    assert len(heatmap_plans(HeatmapConfig(Gait.WALKING, points=2))) == 8 * 2 + 28 * 4
    commands = [plan.command for plan in plans if plan.label == "p w"]
    assert [(c.p, c.w) for c in commands[:4]] == [(0.0, -1.0), (0.0, 0.0), (0.0, 1.0), (0.2, -1.0)]
    assert all(c.h == 0.0 for c in commands)
    assert [plan.command.h for plan in plans if plan.label == "h"] == pytest.approx([-0.3, -0.15, 0.0])


def run_of(monkeypatch, error, fell=lambda command: False):
    """The result of a robot with prescribed errors: error(name, command)."""

    def run_episodes(factory, plans, judge, settings, on_episode):
        return [
            HeatmapEpisode(
                "standing",
                {name: getattr(plan.command, name) for name in plan.label.split()},
                {name: error(name, plan.command) for name in ("h", "p", "w")},
                fell(plan.command),
                0,
            )
            for plan in plans
        ]

    monkeypatch.setattr(module, "run_episodes", run_episodes)
    return HeatmapProtocol().run(HoldController, STANDING)


def test_commands_that_do_not_matter_to_one_another_are_orthogonal(monkeypatch):
    result = run_of(monkeypatch, lambda name, command: 0.1 + abs(getattr(command, name)))
    assert result.single == pytest.approx({"h": 0.25, "p": 0.3, "w": 0.1 + 2.0 / 3.0})
    assert len(result.orthogonality) == 6
    assert all(entry.share == 1.0 and entry.worst == pytest.approx(1.0) for entry in result.orthogonality)
    (ranges,) = [entry for entry in result.orthogonality if (entry.tracked, entry.against) == ("h", "w")]
    assert (ranges.low, ranges.high) == (-1.0, 1.0)
    heat = result.maps[0]
    assert (heat.first, heat.second) == ("h", "p")
    np.testing.assert_allclose(np.array(heat.errors["h"], dtype=float), np.tile([[0.4], [0.25], [0.1]], 3))
    np.testing.assert_allclose(np.array(heat.errors["p"], dtype=float), np.tile([0.1, 0.3, 0.5], (3, 1)))
    assert json.loads(json.dumps(dataclasses.asdict(result)))["maps"][2]["second"] == "w"


def test_a_command_that_disturbs_another_is_orthogonal_up_to_its_share(monkeypatch):
    """The height error doubles at the largest pitch; a waist turned to the right makes the robot fall."""

    def error(name, command):
        return 0.1 * (2.0 if name == "h" and command.p == 0.4 else 1.0)

    result = run_of(monkeypatch, error, lambda command: command.w == -1.0 and command.p > 0.0)
    found = {(entry.tracked, entry.against): entry for entry in result.orthogonality}
    pitch = found["h", "p"]
    assert (pitch.low, pitch.high) == (0.0, 0.2) and pitch.share == pytest.approx(2 / 3)
    assert pitch.worst == pytest.approx(2.0)
    waist = found["p", "w"]
    assert (waist.low, waist.high) == (0.0, 1.0) and waist.worst is None
    assert found["w", "p"].low == 0.0 == found["w", "p"].high
    assert result.maps[2].falls == ((0, 0, 0), (1, 0, 0), (1, 0, 0)) and result.falls == 2
    assert result.maps[2].errors["w"][1] == (None, 0.1, 0.1)


def test_prescribed_errors_come_out(synthetic_trace):
    walk = Command(gait=Gait.WALKING, v_x=0.5, w=0.3)
    trace = synthetic_trace(walk, bias={"w": 0.1, "v_y": -0.2}, frequency=walk.f + 0.1)
    row = HeatmapJudge(1.0)(0, Run(EpisodePlan(walk, label="v_x w"), trace, np.nan))
    assert row.commands == {"v_x": 0.5, "w": 0.3}
    for name, error in (("w", 0.1), ("v_y", 0.2), ("v_x", 0.0), ("f", 0.1)):
        assert row.errors[name] == pytest.approx(error, abs=1e-9), name


def test_bad_settings_are_refused():
    with pytest.raises(ConfigError, match="give 2 or more values"):
        HeatmapConfig(Gait.WALKING, points=1)


def test_a_command_that_is_followed_exactly_alone_has_no_multiple_of_its_error(monkeypatch):
    """As of a robot that is made to: pairs that are exact as well are orthogonal, all others are not."""
    result = run_of(monkeypatch, lambda name, command: 0.1 * (name == "h" and command.w != 0.0))
    share = {(entry.tracked, entry.against): entry.share for entry in result.orthogonality}
    assert result.single == {"h": 0.0, "p": 0.0, "w": 0.0}
    assert share["p", "w"] == 1.0 and share["h", "p"] == 1.0 and share["h", "w"] == pytest.approx(1 / 3)


def test_orthogonal_ranges_stand_where_row_and_column_meet(lines, standing):
    ranges = (OrthogonalRange("h", "p", 0.0, 0.2, 0.5, 2.0), OrthogonalRange("p", "h", None, None, 0.0, None))
    values = {"h": [-0.3, 0.0], "p": [0.0, 0.4]}
    single = {"h": 0.01, "p": None}
    result = HeatmapResult(
        points=2, values=values, single=single, maps=(), orthogonality=ranges, episodes=8, falls=1, **standing
    )
    found = lines(HeatmapProtocol().describe(result))
    assert found["h"] == ["0.010", "0 to 0.2"] and found["p"] == ["-", "-"]


def test_maps_are_relative_to_the_error_alone_and_turned_for_the_second_command():
    errors = {"h": ((1.0, 2.0), (3.0, None)), "p": ((10.0, 20.0), (30.0, None))}
    result = {
        "gait": "standing",
        "single": {"h": 0.5, "p": 10.0},
        "maps": [{"first": "h", "second": "p", "errors": errors}],
        "orthogonality": [{"tracked": name, "share": share} for name, share in (("h", 0.5), ("h", 1.0), ("p", 0.0))],
        "rows": [{"fell": False}, {"fell": False}],
    }
    maps = relative_maps(result)
    np.testing.assert_array_equal(maps["h", "p"], [[2.0, 4.0], [6.0, np.nan]])
    np.testing.assert_array_equal(maps["p", "h"], [[1.0, 3.0], [2.0, np.nan]])
    figures = HeatmapProtocol().figures("qp", result)
    assert [(f.quantity, f.value) for f in figures] == [("error of h", 75.0), ("error of p", 0.0), (FALLS, 0.0)]

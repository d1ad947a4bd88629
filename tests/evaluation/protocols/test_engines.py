"""Both engines side by side: the same pushes in both, errors, ratios and falls by command."""

import dataclasses
import importlib.util

import pytest

from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.protocols.engines import COMMANDS, EnginesConfig, EnginesEpisode, EnginesProtocol, EnginesResult
from hugwbc.runtime.controllers import ControllerSpec

PROTOCOL = EnginesProtocol()


def _row(command, engine, v_x, fell=False):
    return EnginesEpisode(command, engine, {"v_x": v_x, "v_y": 0.1, "omega": 0.2}, fell, 0)


ROWS = [
    *(_row("walk", "mujoco", v_x) for v_x in (0.02, 0.04)),
    *(_row("walk", "physx", v_x, fell) for v_x, fell in ((0.06, False), (9.0, True))),
]


def test_ratios_are_of_the_episodes_without_a_fall(standing, lines):
    config = EnginesConfig(episodes=2, commands=("walk",))
    summary = PROTOCOL.summarise(config, ROWS)
    assert summary["falls"] == {"walk, mujoco": 0, "walk, physx": 1}
    assert summary["ratios"]["walk"]["v_x"].value == pytest.approx(2.0)
    result = EnginesResult(**{**standing, "rows": tuple(ROWS)}, **summary)
    text = PROTOCOL.describe(result)
    assert lines(text)["walk"][:2] == ["0.2000", "0.2000"]  # the last table's, of omega
    assert "0.0300  0.0600  2.000" in text and "falls, walk: mujoco 0, physx 1 of 2" in text
    figures = {f.quantity: f for f in PROTOCOL.figures("qp", dataclasses.asdict(result))}
    assert figures["E_v_x, ratio"].value == pytest.approx(2.0)
    assert (figures["E_v_x, mujoco"].value, figures["falls, physx"].value) == (pytest.approx(0.03), 50.0)


def test_both_engines_get_the_same_pushes_and_the_same_errors_of_the_sensors(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: object())
    config = EnginesConfig(episodes=3, conditions=Conditions())
    plans = PROTOCOL.plans(config)
    assert PROTOCOL.total(config) == len(plans) == 2 * 3 * len(COMMANDS)
    for one, other in zip(plans[::2], plans[1::2], strict=True):
        assert (one.commands, one.forces, one.draw) == (other.commands, other.forces, other.draw)
        assert (one.conditions.engine, other.conditions.engine) == ("mujoco", "physx")
    assert len({plan.forces for plan in plans}) == 3, "one for each number"
    with pytest.raises(ConfigError, match="firm ground only"):
        PROTOCOL.plans(EnginesConfig(conditions=Conditions(ground="soft")))
    with pytest.raises(UnknownNameError, match="'walk'"):
        EnginesConfig(commands=("wlk",))


def test_without_physx_the_report_says_what_is_missing(monkeypatch):
    from hugwbc.report.report_plan import ReportPlan

    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: None if name == "sapien" else found(name, *a))
    assert "pip install 'hugwbc[physx]'" in PROTOCOL.unavailable()
    plan = ReportPlan("quick", ("hold",))
    assert "engines" not in {cell.protocol for cell in plan.cells}
    assert any("'Both engines' is missing" in note for note in plan.report([]).notes)
    with pytest.raises(ConfigError, match="needs sapien"):
        ReportPlan("quick", ("hold",), protocols=("engines",))


def test_a_push_moves_a_stand_alike_in_both_engines():
    pytest.importorskip("sapien", reason="the second engine is an extra: pip install 'hugwbc[physx]'")
    conditions = Conditions(sensing="exact")
    # Long enough for the push. The errors before it are below 1 mm/s, and their ratio is the contacts' business.
    config = EnginesConfig(episodes=1, commands=("stand",), duration=3.0, conditions=conditions)
    result = PROTOCOL.run(ControllerSpec("qp").told(conditions.told_arena).build, config)
    assert [row.engine for row in result.rows] == ["mujoco", "physx"]
    assert result.falls == {"stand, mujoco": 0, "stand, physx": 0}
    mujoco, ratio = result.rows[0].errors["v_x"], result.ratios["stand"]["v_x"].value
    assert mujoco is not None and 0.002 < mujoco < 0.01, "the push is seen"
    assert ratio is not None and 0.75 < ratio < 1.33

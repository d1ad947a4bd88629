import dataclasses

import pytest

from hugwbc import Gait
from hugwbc.errors import ConfigError
from hugwbc.evaluation.protocols import protocol as module
from hugwbc.evaluation.protocols.episodes import run_episodes
from hugwbc.evaluation.protocols.robustness import (
    GRID,
    RobustnessConfig,
    RobustnessEpisode,
    RobustnessLevel,
    RobustnessProtocol,
    RobustnessResult,
    robustness_level,
)
from hugwbc.runtime.controllers import HoldController


def test_every_value_has_the_same_commands_and_its_own_conditions(monkeypatch):
    seen = []

    def some(factory, plans, judge, settings, on_episode):
        seen.extend(plans)
        kept = run_episodes(factory, plans[:6], judge, settings, on_episode)
        return kept + kept[:3] * (len(plans) // 3 - 2)

    monkeypatch.setattr(module, "run_episodes", some)
    config = RobustnessConfig(Gait.STANDING, samples=3, duration=0.2, settle=0.1)
    result = RobustnessProtocol().run(HoldController, config)
    assert len(seen) == config.episodes == 3 * (1 + sum(map(len, GRID.values())))
    commands = [plan.command for plan in seen]
    assert all(commands[start : start + 3] == commands[:3] for start in range(0, len(seen), 3))
    assert all(plan.conditions == config.conditions for plan in seen[:3])
    for plan in seen[3:]:
        factor, value, _ = plan.label.split()
        assert dataclasses.replace(config.conditions, **{factor: float(value)}) == plan.conditions
        assert plan.conditions != config.conditions
    assert [(row.factor, row.level) for row in result.rows[2:4]] == [("nominal", 0.0), ("payload", -2.0)]
    assert result.levels[0].ratio == 1.0 and result.levels[1].ratio != 1.0


def episode(error_name: str, error: float | None, fell: bool = False) -> RobustnessEpisode:
    return RobustnessEpisode(
        "walking",
        "h",
        0.0,
        error_name,
        error,
        fell,
        10.0,
        None,
        None,
        None,
        None,
        None,
        None,
        0,
        factor="gain",
        level=0.9,
    )


def test_the_ratio_is_that_of_the_same_commands():
    nominal = [episode("E_h", 0.1), episode("E_h", 0.3), episode("E_p", 0.2), episode("E_w", 0.5)]
    rows = [episode("E_h", 0.4), episode("E_h", 9.9, fell=True), episode("E_p", 0.2), episode("E_w", None, fell=True)]
    level = robustness_level(rows, nominal)
    assert (level.factor, level.level, level.falls, level.episodes) == ("gain", 0.9, 2, 4)
    assert level.errors["E_h"] == pytest.approx(0.4) and level.errors["E_w"] is None
    assert level.ratio == pytest.approx((4.0 + 1.0) / 2.0), "E_h of the first command alone, E_p, and no E_w"


def test_bad_settings_are_refused():
    with pytest.raises(ConfigError, match="needs at least 8"):
        RobustnessConfig(Gait.WALKING, samples=7)


def test_episodes_too_long_for_the_grounds_of_the_grid_are_refused():
    with pytest.raises(ConfigError, match="give up to 200 s"):
        RobustnessConfig(Gait.WALKING, duration=201.0)


def test_robustness_names_factor_value_and_unit(lines, walking):
    levels = [("nominal", 0.0, 1.0), ("terrain_roughness", 0.02, 1.5), ("gain", 0.9, None)]
    result = RobustnessResult(
        samples=8, levels=tuple(RobustnessLevel(f, v, 1, 8, {}, ratio) for f, v, ratio in levels), **walking
    )
    found = lines(RobustnessProtocol().describe(result))
    assert found["nominal"] == ["1 of 8 episodes (12.5 %) [2.2, 47.1]", "1.000"]
    assert found["roughness 0.02 m"] == ["1 of 8 episodes (12.5 %) [2.2, 47.1]", "1.500"] and found["gain 0.9"] == [
        "1 of 8 episodes (12.5 %) [2.2, 47.1]",
        "-",
    ]


def row(**fields):
    return {"fell": False, **fields}


def test_robustness_is_relative_to_the_unchanged_robot():
    levels = [("nominal", 0.0, 1.0), ("payload", 5.0, 1.5), ("friction", 0.2, None)]
    rows = [row(factor=factor, level=level) for factor, level, _ in levels]
    rows.append(row(factor="payload", level=5.0, fell=True))
    result = {
        "gait": "walking",
        "levels": [{"factor": factor, "level": level, "ratio": ratio} for factor, level, ratio in levels],
        "rows": rows,
    }
    figures = RobustnessProtocol().figures("qp", result)
    assert [(f.quantity, f.value) for f in figures] == [
        ("payload 5 kg", 1.5), ("friction 0.2", None), ("nominal", 0.0), ("payload 5 kg", 50.0), ("friction 0.2", 0.0)
    ]  # fmt: skip
    assert figures[0].table != figures[2].table

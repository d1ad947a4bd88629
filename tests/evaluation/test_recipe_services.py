import dataclasses
import pathlib
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.recipe_services import RecipeServices, executed_means, settings_of
from hugwbc.learned.policy import policy_file
from hugwbc.learned.recipe.recipe_records import CalibrationSettings
from hugwbc.mbc import WholeBodyController
from hugwbc.robot import load_robot

WALK = {"protocol": "single-command", "gait": "walking", "episodes": 8}


def test_a_table_is_the_settings_of_its_protocol() -> None:
    settings = settings_of({**WALK, "duration": 3.0, "intervention": "noise"}, 1007)
    assert (settings.episodes, settings.duration, settings.seed, settings.gait) == (8, 3.0, 1007, "walking")
    assert settings.conditions == Conditions(intervention="noise")


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        (
            {"protocol": "singel-command"},
            UnknownNameError,
            r"unknown experiment 'singel-command'\. Did you",
        ),
        ({"gait": "strolling"}, UnknownNameError, "unknown gait 'strolling'"),
        (
            {"episode": 8},
            UnknownNameError,
            r"setting of the single-command experiment 'episode'\. Did you mean 'episodes'",
        ),
        ({"seed": 4}, UnknownNameError, "'seed'"),
        ({"episodes": 2}, ConfigError, "episodes is 2; give 8 or more"),
        ({"episodes": "many"}, ConfigError, "episodes is 'many'; it should be a valid integer"),
        ({"episodes": 8.5}, ConfigError, "valid integer"),
        ({"strength": -1.0}, ConfigError, "strength"),
    ],
)
def test_a_table_that_cannot_be_run_is_refused(changes: dict, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        RecipeServices().check_table({**WALK, **changes})


def test_the_teacher_is_the_qp_of_the_robot() -> None:
    robot = load_robot("h1")
    teacher = RecipeServices().teacher(robot)(0.02)
    assert isinstance(teacher, WholeBodyController) and teacher.period == 0.02


def test_simulated_seconds_of_a_table() -> None:
    assert RecipeServices().simulated_seconds({**WALK, "duration": 4.0}) == 32.0


def test_a_table_is_run_and_its_episodes_are_kept(tmp_path: pathlib.Path) -> None:
    services, table, episodes = RecipeServices(), {**WALK, "duration": 1.5}, []

    def go() -> dict[str, Any]:
        return services.run_table(
            policy_file("h1"), table, seed=5, workers=1, folder=tmp_path, on_episode=lambda: episodes.append(1)
        )

    result = go()
    assert result["episodes"] == 8 and result["seed"] == 5 and len(episodes) == 8
    assert go() == result and len(episodes) == 8  # read, not run


def test_the_shipped_policy_executes_what_it_is_asked_for() -> None:
    settings = CalibrationSettings(duration=4.0)
    commands = [{"gait": "walking", "v_x": 0.5}, {"gait": "standing", "h": -0.2}]
    walk, stand = RecipeServices().executed(policy_file("h1"), commands, settings, 1)
    assert walk["v_x"] == pytest.approx(0.5, abs=0.1) and walk["l"] == pytest.approx(0.15, abs=0.06)
    assert stand["h"] == pytest.approx(-0.2, abs=0.05) and np.isnan(stand["l"])


def test_the_means_of_a_trace(synthetic_trace: Callable[..., Any]) -> None:
    trace = synthetic_trace()
    means = executed_means(trace)
    kept = trace.time >= 1.0
    assert means["v_x"] == pytest.approx(float(trace.measured[kept, 0].mean()))
    assert means["l"] > 0.0


def test_a_fall_executes_nothing(synthetic_trace: Callable[..., Any]) -> None:
    fallen = dataclasses.replace(synthetic_trace(), fell=True)
    assert all(np.isnan(value) for value in executed_means(fallen).values())

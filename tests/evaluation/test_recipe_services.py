import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hugwbc.commands import Command
from hugwbc.evaluation import recipe_services
from hugwbc.evaluation.metrics import executed_means
from hugwbc.evaluation.recipe_services import executed, stop
from hugwbc.gait import Gait
from hugwbc.learned.config import CalibrationConfig
from hugwbc.learned.policy import load_policy, policy_file


def test_the_shipped_policy_executes_what_it_is_asked_for() -> None:
    config = CalibrationConfig(policy=policy_file("h1"), duration=2.5)
    commands = [{"gait": "walking", "v_x": 0.5}, {"gait": "standing", "h": -0.2}]
    walk, stand = executed(policy_file("h1"), commands, config)
    assert walk["v_x"] == pytest.approx(0.5, abs=0.1) and walk["l"] == pytest.approx(0.15, abs=0.06)
    assert stand["h"] == pytest.approx(-0.2, abs=0.05) and np.isnan(stand["l"])


def test_a_stop_moves_the_shipped_policy_as_its_contract_says(monkeypatch) -> None:
    monkeypatch.setattr(recipe_services, "_RUNS", 1)
    policy = policy_file("h1")
    known = np.array(load_policy(policy).contract.stop)
    assert known[0] > 0.03, "it puts its feet ahead"
    found = np.array(stop(policy, CalibrationConfig(policy=policy, seed=3)))
    assert found == pytest.approx(known, abs=0.03)


def test_the_means_of_a_trace(synthetic_trace: Callable[..., Any]) -> None:
    walk = Command(v_x=0.4, gait=Gait.WALKING)
    trace = synthetic_trace(walk, bias={"v_x": 0.1}, frequency=2.2, apex=0.12)
    trace.measured[trace.time < 1.0] = 9.0
    means = executed_means(trace)
    assert [means["v_x"], means["f"], means["h"]] == pytest.approx([0.5, 2.2, walk.h])
    assert means["l"] == pytest.approx(0.12, abs=0.002)


def test_a_fall_executes_nothing(synthetic_trace: Callable[..., Any]) -> None:
    fallen = dataclasses.replace(synthetic_trace(), fell=True)
    assert all(np.isnan(value) for value in executed_means(fallen).values())

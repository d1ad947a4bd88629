import math

import pytest
import torch

from hugwbc.learned.config import CommandConfig, EnvConfig, TerrainConfig
from hugwbc.learned.policy import load_policy
from hugwbc.learned.policy.networks import Actor
from hugwbc.learned.rl.evaluator import FALL_COST, Evaluator


def still_actor() -> Actor:
    actor = Actor()
    for parameter in actor.policy[-1].parameters():
        torch.nn.init.zeros_(parameter)
    return actor


@pytest.fixture(scope="module")
def evaluator() -> Evaluator:
    return Evaluator(EnvConfig(), count=12, seconds=2.0, threads=1)


def test_equal_policies_get_equal_figures(evaluator: Evaluator) -> None:
    actor = load_policy("h1").actor
    first = evaluator.run(actor)
    other = evaluator.run(still_actor())
    assert evaluator.run(actor) == first
    assert list(first) == evaluator.names
    assert first["evaluation/score"] < other["evaluation/score"]


def test_the_shipped_policy_stays_up_after_nearly_all_random_starts() -> None:
    figures = Evaluator(EnvConfig(), count=96, seconds=2.0, threads=1).run(load_policy("h1").actor)
    assert (
        figures["evaluation/falls"] <= 0.08
    )  # of 192 robots nine fall within 5 s, of those with the nominal pose none


def test_score_by_hand(evaluator: Evaluator) -> None:
    # Two of three gaits have samples; the third's robots fell before any could be taken.
    gait = torch.tensor([0, 0, 1, 2])
    sums = torch.zeros(4, 6)
    sums[0, 0], sums[1, 0] = 3.0, 1.0  # v_x of the standing robots: 4 / 20 = 0.2, twice its scale
    sums[2] = torch.tensor([0.1, 0.1, 0.1, 0.05, 0.05, 0.05]) * 10  # walking: every error is its scale
    figures = evaluator._figures(gait, sums, torch.tensor([10.0, 10.0, 10.0, 0.0]), 0.25)
    assert figures["evaluation/standing/v_x"] == pytest.approx(0.2)
    assert math.isnan(figures["evaluation/jumping/h"])
    assert figures["evaluation/score"] == pytest.approx(FALL_COST * 0.25 + (2.0 / 6.0 + 1.0) / 2.0)


def test_errors_are_those_of_a_robot_that_stands_as_told() -> None:
    standing = CommandConfig(standing_fraction=1.0, walking_fraction=0.0, default_fraction=1.0)
    figures = Evaluator(EnvConfig(command=standing), count=4, seconds=2.0, threads=1).run(load_policy("h1").actor)
    assert figures["evaluation/falls"] == 0.0
    assert 0.0 < figures["evaluation/standing/v_x"] < 0.1
    assert figures["evaluation/standing/h"] < 0.1


def test_a_policy_for_rough_ground_is_judged_on_all_levels() -> None:
    terrain = TerrainConfig(roughness=0.02, levels=4)
    ground = Evaluator(EnvConfig(terrain=terrain), count=8, seconds=0.1, threads=1)._env.ground
    assert ground is not None and torch.bincount(ground.level).tolist() == [2] * 4

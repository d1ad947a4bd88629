import dataclasses
import math

import pytest
import torch

from hugwbc.gait import Gait
from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.env.running_statistics import TRACKING_MEMORY, Statistics

NOBODY = torch.zeros(8, dtype=torch.bool)
WALKING_PAIR = torch.tensor([Gait.WALKING] * 2 + [Gait.STANDING] * 6)


def add(statistics: Statistics, env: HumanoidEnv, error: float, gait: torch.Tensor, reward: float = 1.0) -> None:
    """Add a step on both feet in which the first robot turns too fast by an error and the others as commanded."""
    transition = env._transition(env.readings, NOBODY)
    yaw_rate = transition.command[:, 2].clone()
    yaw_rate[0] += error
    transition = dataclasses.replace(transition, yaw_rate=yaw_rate, gait=gait, foot_force=torch.full((8, 2, 3), 100.0))
    terms = {"alive": torch.full((8,), reward)}
    statistics.add(terms, torch.ones(8, 2), transition, torch.tensor([30]), NOBODY)


def test_errors_are_means_over_the_robots_of_a_gait_not_over_steps(small_env: HumanoidEnv) -> None:
    statistics = Statistics(NOBODY, small_env.robot.waist)
    add(statistics, small_env, 0.4, WALKING_PAIR)
    add(statistics, small_env, 0.4, torch.full((8,), int(Gait.STANDING)))  # nobody walks: says nothing
    figures = statistics.pop()
    assert figures["walking_error/omega"] == pytest.approx(0.2, abs=1e-6)


def test_what_nobody_did_is_unknown_not_zero(small_env: HumanoidEnv) -> None:
    statistics = Statistics(NOBODY, small_env.robot.waist)
    add(statistics, small_env, 0.4, WALKING_PAIR)
    figures = statistics.pop()
    assert math.isnan(figures["hopping_error/omega"]) and math.isnan(figures["held_foot_down"])
    assert math.isnan(statistics.pop()["episode_length"])
    add(statistics, small_env, 0.4, torch.full((8,), int(Gait.HOPPING_LEFT)))
    assert statistics.pop()["held_foot_down"] == 1.0


def test_a_robot_whose_physics_failed_spoils_no_average(small_env: HumanoidEnv) -> None:
    statistics = Statistics(NOBODY, small_env.robot.waist)
    add(statistics, small_env, math.nan, WALKING_PAIR, reward=math.nan)
    add(statistics, small_env, 0.4, WALKING_PAIR, reward=3.0)
    figures = statistics.pop()
    assert figures["reward/alive"] == 3.0
    # Three samples: of the second robot, which turns as told, in the first step, and of both in the second.
    assert figures["walking_error/omega"] == pytest.approx(0.4 / 3.0, abs=1e-6)


def test_rewards_that_are_not_finite_are_told_but_for_robots_whose_physics_failed(small_env: HumanoidEnv) -> None:
    statistics = Statistics(NOBODY, small_env.robot.waist)
    transition, first = small_env._transition(small_env.readings, NOBODY), torch.arange(8) == 0
    bad = torch.tensor([math.nan, math.inf, -math.inf, 1.0, 1.0, 1.0, 1.0, 1.0])
    for diverged in (first, NOBODY):
        terms = {"alive": torch.where(first, math.nan, 1.0), "mine": bad}
        statistics.add(terms, torch.ones(8, 2), transition, torch.tensor([30]), diverged)
    assert statistics.faults() == "not finite, counted as 0: 1 of alive, 5 of mine"
    assert statistics.faults() == ""


def test_events_are_counted_and_tracking_is_remembered(small_env: HumanoidEnv) -> None:
    statistics = Statistics(NOBODY, small_env.robot.waist)
    for _ in range(2):
        add(statistics, small_env, 0.0, WALKING_PAIR)
    torch.testing.assert_close(statistics.tracking, torch.full((8, 2), 1.0 - TRACKING_MEMORY**2))
    figures = statistics.pop()
    assert (figures["episodes"], figures["falls"], figures["episode_length"]) == (2.0, 0.0, 30.0)
    assert statistics.pop()["episodes"] == 0.0


def test_gates_of_another_run_go_on_with_its_levels(small_env: HumanoidEnv) -> None:
    small_env.curriculum.update((0.8, 0.7), (0.75, 0.6))
    levels = small_env.curriculum.state_dict()
    small_env.curriculum.update(None, (0.1, 0.1))
    small_env.restore_levels(levels)
    assert small_env.statistics.gate("speed") == pytest.approx((0.8, 0.7))
    assert small_env.statistics.gate("alpha") == pytest.approx((0.75, 0.6))


def test_a_gate_hears_of_its_robots_alone() -> None:
    statistics = Statistics(NOBODY[:4], waist=10)
    tracking = torch.tensor([[1.0, 0.5], [0.2, 0.2], [0.0, 0.0], [math.nan, 0.0]])
    statistics.note_gate("alpha", tracking, torch.tensor([True, True, False, False]))
    statistics.note_gate("alpha", tracking, torch.zeros(4, dtype=torch.bool))  # nobody: says nothing
    share = 1.0 - TRACKING_MEMORY
    assert statistics.gate("alpha") == pytest.approx((0.6 * share, 0.35 * share))
    assert statistics.gate("speed") == (0.0, 0.0)
    other = Statistics(NOBODY[:4], waist=10)
    other.load_state_dict(statistics.state_dict())
    assert other.gate("alpha") == statistics.gate("alpha")

import copy
import math
from typing import Any

import pytest
import torch

from hugwbc.learned.config import PPOConfig
from hugwbc.learned.env.readings import StepResult
from hugwbc.learned.policy.critic_observations import Observation
from hugwbc.learned.policy.networks import SymmetricCritic
from hugwbc.learned.rl import ppo
from hugwbc.learned.rl.ppo import PPO
from hugwbc.robot import load_robot

ROBOT, CRITIC_SIZE = load_robot(), 63 + 18 + 40 + 221
GAIT = torch.ones(64, dtype=torch.long)


def test_what_comes_from_outside_is_no_merit_of_an_action() -> None:
    # A new command after the second step makes the value jump.
    reward, value = torch.tensor([[1.0], [2.0], [3.0]]), torch.tensor([[0.5], [0.4], [50.0]])
    done, disturbed = torch.zeros(3, 1, dtype=torch.bool), torch.tensor([[False], [True], [False]])
    advantage = ppo.generalised_advantage(reward, done, disturbed, value, torch.tensor([49.0]), gamma=0.9, lam=0.8)
    assert advantage.flatten().tolist() == pytest.approx([1.0 + 0.9 * 0.4 - 0.5, 0.0, 3.0 + 0.9 * 49.0 - 50.0])


def test_standardised_has_mean_zero_and_deviation_one() -> None:
    torch.manual_seed(0)
    values = ppo.standardised(5.0 + 3.0 * torch.randn(1000), torch.zeros(1000, dtype=torch.long), 1)
    assert values.mean().item() == pytest.approx(0.0, abs=1e-5)
    assert values.std(correction=0).item() == pytest.approx(1.0, rel=1e-5)


def test_values_far_from_their_groups_mean_are_cut_off() -> None:
    torch.manual_seed(0)
    values, groups = torch.randn(2000), torch.arange(2000) % 2
    values[groups == 1] *= 0.5
    values[:20:2] = -60.0
    plain = ppo.standardised(values, groups, 2)
    cut = ppo.standardised(values, groups, 2, clip=2.0)
    usual = slice(20, None)
    assert plain[usual][groups[usual] == 0].std() < 0.2, "the tail makes all others small"
    assert cut[usual][groups[usual] == 0].std() > 0.8 and cut[:20:2].max() < -1.5
    for group in range(2):
        assert cut[groups == group].mean().item() == pytest.approx(0.0, abs=1e-5)
    assert torch.equal(ppo.standardised(values, groups, 2, clip=float("inf")), plain)


def test_nothing_limits_how_far_a_value_moves_in_an_update() -> None:
    torch.manual_seed(0)
    config = PPOConfig(horizon=4, epochs=60, minibatches=1, critic_learning_rate=1e-3)
    learner = PPO(config, ROBOT, torch.Generator().manual_seed(0))
    observation = Observation(
        torch.zeros(64, 315), torch.zeros(64, 18), torch.zeros(64, CRITIC_SIZE), torch.zeros(64, 6)
    )
    before = float(learner.value(observation.critic).detach().mean())
    for t in range(4):
        learner.act(t, observation, GAIT[: len(observation.command)])
        everybody = torch.ones(64, dtype=torch.bool)
        reward = torch.full((64,), before + 4.0)
        learner.record(t, StepResult(reward, everybody, ~everybody, observation, ~everybody))
    learner.update(observation, critic_only=True)
    assert 3.0 < float(learner.value(observation.critic).detach().mean()) - before < 5.0


def test_only_robots_whose_time_was_over_get_the_value_of_what_they_would_have_collected() -> None:
    torch.manual_seed(0)
    config = PPOConfig(horizon=1, gamma=0.5)
    learner = PPO(config, ROBOT, torch.Generator().manual_seed(0))
    observation = Observation(*(torch.randn(4, size) for size in (315, 18, CRITIC_SIZE, 6)))
    terminated, truncated = torch.tensor([False, True, False, False]), torch.tensor([True, False, False, True])
    ended = Observation(*(values[[0, 1, 3]] for values in vars(observation).values()))
    learner.act(0, observation, GAIT[:4])
    learner.record(0, StepResult(torch.ones(4), terminated, truncated, ended, ~truncated))
    expected = 1.0 + 0.5 * truncated * learner.value(observation.critic)
    torch.testing.assert_close(learner.rollout.reward[0], expected)
    assert learner.rollout.done[0].tolist() == [True, True, False, True]


def test_explained_variance_of_perfect_and_constant_critics() -> None:
    returns = torch.tensor([1.0, 2.0, 3.0, 6.0])
    assert ppo.explained_variance(returns, returns) == pytest.approx(1.0)
    assert ppo.explained_variance(torch.full((4,), 3.0), returns) == pytest.approx(0.0)
    assert ppo.explained_variance(-returns, returns) == pytest.approx(-3.0)


def make_learner(**changes: Any) -> PPO:
    torch.manual_seed(0)
    return PPO(PPOConfig(horizon=2, **changes), ROBOT, torch.Generator().manual_seed(0))


def test_the_loss_is_the_sum_of_its_parts_with_their_weights(monkeypatch) -> None:
    torch.manual_seed(0)
    learner = make_learner(policy_weight=2.0, estimation_weight=3.0, entropy_weight=0.1)
    descended = []
    monkeypatch.setattr(learner, "_descend", lambda *given: (descended.append(given), (4 * [0.0], True))[1])
    rows, network = 32, learner.network
    batch = {name: torch.randn(rows, size) for name, size in (("history", 315), ("command", 18), ("estimate", 6))}
    batch |= {name: torch.randn(rows, size) for name, size in (("critic", CRITIC_SIZE), ("action", 19), ("mean", 19))}
    batch |= {name: torch.randn(rows) for name in ("log_prob", "advantage", "returns")}
    batch["log_prob"] -= 20.0
    before = {name: value.clone() for name, value in batch.items()}
    learner._step(batch, network.exploration().detach())
    (loss, (value, policy, estimation, _)) = descended[0]
    network.requires_grad_(False)
    mean, estimate = network.actor.prepared(before["history"], before["command"])
    told = network.critic.prepared(before["critic"])
    log_std = network.exploration()
    chosen = torch.distributions.Normal(mean, log_std.exp()).log_prob(before["action"]).sum(1)
    ratio = (chosen - before["log_prob"]).exp()
    worst = torch.minimum(ratio * before["advantage"], ratio.clamp(0.8, 1.2) * before["advantage"])
    torch.testing.assert_close(value, (told - before["returns"]).square().mean())
    torch.testing.assert_close(policy, -worst.mean())
    torch.testing.assert_close(estimation, (estimate - before["estimate"]).square().mean())
    torch.testing.assert_close(loss, value + 2.0 * policy + 3.0 * estimation - 0.1 * log_std.sum())


def test_std_is_bounded_by_the_schedule() -> None:
    learner = make_learner(std_initial=0.8, std_final=0.2, std_steps=100.0)
    learner.bound_std(50.0)
    assert learner.network.log_std.detach().exp().max().item() == pytest.approx(math.sqrt(0.8 * 0.2), rel=1e-5)
    learner.bound_std(1e9)
    assert learner.network.log_std.detach().exp().max().item() == pytest.approx(0.2, rel=1e-5)


def test_the_actors_learning_rate_follows_the_kl() -> None:
    learner = make_learner(learning_rate=1e-4, critic_learning_rate=2e-4, target_kl=0.01)
    actor, critic = learner.optimiser.param_groups
    learner._adapt_learning_rate(0.03)
    assert actor["lr"] == learner.learning_rate == pytest.approx(1e-4 / 1.5) and critic["lr"] == 2e-4
    learner._adapt_learning_rate(0.001)
    learner._adapt_learning_rate(0.01)
    assert learner.learning_rate == pytest.approx(1e-4)


def test_the_actors_learning_rate_stays_in_its_range() -> None:
    learner = make_learner(learning_rate=3e-4, learning_rate_range=(1e-5, 1e-4), target_kl=0.01)
    learner._adapt_learning_rate(0.01)
    assert learner.learning_rate == learner.optimiser.param_groups[0]["lr"] == pytest.approx(1e-4)


def test_non_finite_loss_is_skipped() -> None:
    learner = make_learner()
    before = [p.detach().clone() for p in learner.network.parameters()]
    assert not learner._descend(learner.network.log_std.sum() * float("nan"), torch.zeros(4))[1]
    for old, new in zip(before, learner.network.parameters(), strict=True):
        torch.testing.assert_close(old, new.detach())


def test_values_are_finer_than_the_reward_of_a_step() -> None:
    """A step of perfect tracking earns less than .1 and values are near 10: bfloat16 would round them to .06."""
    learner = make_learner()
    assert isinstance(learner.network.critic, SymmetricCritic)
    torch.nn.init.constant_(learner.network.critic.output.bias, 10.0)
    rows = torch.randn(8, CRITIC_SIZE)
    exact = copy.deepcopy(learner.network.critic).double()(rows.double())
    torch.testing.assert_close(learner.value(rows).double(), exact, atol=1e-4, rtol=0.0)


def test_updates_improve_policy_value_and_estimate_on_a_known_task() -> None:
    """One-step episodes, reward -|a - 0.5|^2 / 19, an estimate fixed by the history: all three are learnt."""
    torch.manual_seed(0)
    count, horizon = 64, 4
    config = PPOConfig(horizon=horizon, epochs=2, minibatches=2, learning_rate=1e-3, std_initial=0.5)
    learner = PPO(config, ROBOT, torch.Generator().manual_seed(0))
    history, mixing = torch.randn(count, 315), torch.randn(6, 315) / 315**0.5
    observation = Observation(history, torch.zeros(count, 18), torch.zeros(count, CRITIC_SIZE), history @ mixing.T)
    everybody = torch.ones(count, dtype=torch.bool)
    rewards, losses = [], []
    for _ in range(60):
        for t in range(horizon):
            action = learner.act(t, observation, GAIT[: len(observation.command)])
            reward = -(action - 0.5).square().mean(1)
            learner.record(t, StepResult(reward, everybody, ~everybody, observation, ~everybody))
        rewards.append(float(learner.rollout.reward.mean()))
        losses.append(learner.update(observation))
    noise_floor = -float(learner.network.exploration().detach().exp().square().mean())
    assert rewards[0] < -0.45  # 0.25 from the mean, 0.25 from the noise
    assert rewards[-1] > noise_floor - 0.05
    assert losses[-1]["estimation_loss"] < 0.3 * losses[0]["estimation_loss"]
    assert abs(float(learner.value(observation.critic).mean()) - rewards[-1]) < 0.1


def test_a_large_critic_gradient_does_not_shorten_the_actor_s() -> None:
    learner = make_learner(max_grad_norm=1.0)
    actor = learner.optimiser.param_groups[0]["params"]
    loss = 0.5 * actor[0].sum() + 1e6 * sum(p.sum() for p in learner.network.critic.parameters())
    assert learner._descend(loss, torch.zeros(4))[1]
    torch.testing.assert_close(actor[0].grad, torch.full_like(actor[0], 0.5 * min(1.0, 2.0 / actor[0].numel() ** 0.5)))

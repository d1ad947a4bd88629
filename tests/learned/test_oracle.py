"""The learner's formulas against rsl_rl's PPO, run as it is on a stored batch."""

from collections.abc import Iterator

import pytest
import torch
from rsl_rl import algorithms
from rsl_rl.models import MLPModel
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict

from hugwbc.learned.rl import ppo

ROBOTS, HORIZON, ACTIONS = 16, 12, 5
GAMMA, LAM, CLIP = 0.97, 0.9, 0.2
GROUPS = {"actor": ["policy"], "critic": ["privileged"]}


@pytest.fixture(autouse=True)
def double_precision() -> Iterator[None]:
    torch.set_default_dtype(torch.float64)
    torch.manual_seed(3)
    yield
    torch.set_default_dtype(torch.float32)


def observation() -> TensorDict:
    return TensorDict({"policy": torch.randn(ROBOTS, 7), "privileged": torch.randn(ROBOTS, 9)}, [ROBOTS])


@pytest.fixture
def oracle() -> algorithms.PPO:
    """A learner with a full storage, whose networks have moved since, so that every clip is at work."""
    first = observation()
    gaussian = {"class_name": "GaussianDistribution", "init_std": 0.6, "std_type": "log"}
    actor = MLPModel(first, GROUPS, "actor", ACTIONS, (16, 16), distribution_cfg=gaussian)
    critic = MLPModel(first, GROUPS, "critic", 1, (16, 16))
    storage = RolloutStorage("rl", ROBOTS, HORIZON, first, [ACTIONS])
    learner = algorithms.PPO(
        actor, critic, storage, num_learning_epochs=1, num_mini_batches=1, clip_param=CLIP, gamma=GAMMA, lam=LAM,
        value_loss_coef=1.0, entropy_coef=0.003, max_grad_norm=1e9, use_clipped_value_loss=False,
    )  # fmt: skip
    for _ in range(HORIZON):
        seen = observation()
        learner.act(seen)
        done = torch.rand(ROBOTS) < 0.15
        learner.process_env_step(seen, torch.randn(ROBOTS), done, {})
    return learner


def perturb(*modules: torch.nn.Module) -> None:
    with torch.no_grad():
        for module in modules:
            for parameter in module.parameters():
                parameter += 0.1 * torch.randn_like(parameter)


def test_advantages_and_returns(oracle: algorithms.PPO) -> None:
    storage, last = oracle.storage, observation()
    oracle.compute_returns(last)
    value, reward, done = (x.squeeze(-1) for x in (storage.values, storage.rewards, storage.dones))
    last_value = oracle.critic(last).detach().squeeze(-1)
    advantage = ppo.generalised_advantage(
        reward, done.bool(), torch.zeros_like(done, dtype=torch.bool), value, last_value, GAMMA, LAM
    )
    assert done.any() and not done.all()
    torch.testing.assert_close(advantage + value, storage.returns.squeeze(-1), atol=1e-6, rtol=0)
    count = advantage.numel()
    scaled = ppo.standardised(advantage.flatten(), torch.zeros(count, dtype=torch.long), 1)
    scaled *= ((count - 1) / count) ** 0.5  # rsl_rl divides by the deviation of a sample
    torch.testing.assert_close(scaled, storage.advantages.flatten(), atol=1e-6, rtol=0)


def test_losses_kl_and_gradients(oracle: algorithms.PPO, monkeypatch: pytest.MonkeyPatch) -> None:
    oracle.compute_returns(observation())
    perturb(oracle.actor, oracle.critic)
    s = oracle.storage
    old_log_prob = s.actions_log_prob.flatten()
    action, returns, advantage = s.actions.flatten(0, 1), s.returns.flatten(), s.advantages.flatten()
    old_mean, old_std = (x.flatten(0, 1) for x in s.distribution_params)
    seen = s.observations.flatten(0, 1)

    mean = oracle.actor(seen)
    value = oracle.critic(seen).squeeze(-1)
    log_std = oracle.actor.distribution.log_std_param
    log_prob = ppo.log_probability(action, mean, log_std)
    surrogate = ppo.surrogate_loss(log_prob, old_log_prob, advantage, CLIP)
    value_loss = (value - returns).square().mean()
    kl = ppo.kl_divergence(old_mean, old_std.log(), mean, log_std).mean()
    ratio = (log_prob - old_log_prob).exp()
    assert (ratio > 1 + CLIP).any() and (ratio < 1 - CLIP).any()
    parameters = [*oracle.actor.parameters(), *oracle.critic.parameters()]
    gradients = torch.autograd.grad(surrogate + value_loss - 0.003 * log_std.sum(), parameters)

    kls = []
    divergence = oracle.actor.get_kl_divergence
    monkeypatch.setattr(oracle.actor, "get_kl_divergence", lambda *a: kls.append(divergence(*a)) or kls[-1])
    losses = oracle.update()
    assert surrogate.item() == pytest.approx(losses["surrogate"], abs=1e-6)
    assert value_loss.item() == pytest.approx(losses["value"], abs=1e-6)
    assert kl.item() == pytest.approx(kls[0].mean().item(), abs=1e-6)
    for mine, parameter in zip(gradients, parameters, strict=True):
        torch.testing.assert_close(mine, parameter.grad, atol=1e-6, rtol=0)

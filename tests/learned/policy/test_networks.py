import math

import pytest
import torch

from hugwbc.learned.policy.networks import Actor, ActorCritic, Critic


def _size(module: torch.nn.Module) -> int:
    return sum(parameter.numel() for parameter in module.parameters())


def test_sizes_are_the_papers() -> None:
    actor = Actor()
    # (inputs + 1) * outputs of every layer; the history has 5 frames of 63.
    assert _size(actor.encoder) == 316 * 256 + 257 * 128 + 129 * 32
    assert _size(actor.estimator) == 33 * 64 + 65 * 32 + 33 * 6
    # latent 32, estimate 6, frame 63, command 13
    assert _size(actor.policy) == 115 * 256 + 257 * 128 + 129 * 64 + 65 * 19
    assert _size(Critic()) == 322 * 512 + 513 * 256 + 257 * 128 + 129


def test_outputs_have_a_row_per_robot_and_begin_near_the_nominal_pose() -> None:
    torch.manual_seed(0)
    network = ActorCritic(std=0.5)
    action, estimate = network.actor(torch.randn(4, 315), torch.randn(4, 13))
    assert action.shape == (4, 19) and estimate.shape == (4, 6)
    assert action.abs().max() < 0.1
    assert network.critic(torch.randn(4, 321)).shape == (4,)
    assert network.log_std.tolist() == pytest.approx([math.log(0.5)] * 19)


def test_the_policy_reads_the_newest_frame_and_leaves_the_estimator_alone() -> None:
    torch.manual_seed(0)
    actor = Actor()
    history = torch.randn(2, 315, requires_grad=True)
    features: list[torch.Tensor] = []
    actor.policy.register_forward_hook(lambda module, inputs, output: features.append(inputs[0]))
    action, _ = actor(history, torch.randn(2, 13))
    torch.testing.assert_close(features[0][:, 38:101], history[:, -63:])
    action.sum().backward()
    assert all(parameter.grad is None for parameter in actor.estimator.parameters())
    assert all(bool(parameter.grad.abs().sum() > 0) for parameter in actor.encoder.parameters())

import math

import pytest
import torch

from hugwbc.learned.policy import critic_observations as obs
from hugwbc.learned.policy.networks import Actor, ActorCritic, SymmetricActor, SymmetricCritic, policy_widths
from hugwbc.learned.policy.terms import ACTION, COMMAND, CRITIC_CORE, ESTIMATE, HISTORY, TERRAIN_SIZE
from hugwbc.robot import load_robot

ROBOT = load_robot()
CORE_SIZE = 63 + 18 + 40


def _size(module: torch.nn.Module) -> int:
    return sum(parameter.numel() for parameter in module.parameters())


def test_sizes_are_the_papers_but_for_a_wider_policy() -> None:
    actor = Actor(63, 18, 19)
    # (inputs + 1) * outputs of every layer; the history has 5 frames of 63.
    assert _size(actor.encoder) == 316 * 256 + 257 * 128 + 129 * 32
    assert _size(actor.estimator) == 33 * 64 + 65 * 32 + 33 * 6
    # latent 32, estimate 6, frame 63, command 18
    assert _size(actor.policy) == 120 * 512 + 513 * 256 + 257 * 128 + 129 * 19
    assert _size(Actor(63, 13, 19).policy) == 115 * 512 + 513 * 256 + 257 * 128 + 129 * 19


def test_outputs_have_a_row_per_robot_and_begin_near_the_nominal_pose() -> None:
    torch.manual_seed(0)
    network = ActorCritic(ROBOT, std=0.5)
    action, estimate = network.actor(torch.randn(4, 315), torch.randn(4, 18))
    assert action.shape == (4, 19) and estimate.shape == (4, 6)
    assert action.abs().max() < 0.1
    assert network.critic(torch.randn(4, (CORE_SIZE + TERRAIN_SIZE))).shape == (4,)
    assert network.critic(torch.randn(4, CORE_SIZE + 1)).shape == (4,)
    assert network.exploration().tolist() == pytest.approx([math.log(0.5)] * 19)


def test_the_policy_reads_the_newest_frame_and_leaves_the_estimator_alone() -> None:
    torch.manual_seed(0)
    actor = Actor(63, 18, 19)
    history = torch.randn(2, 315, requires_grad=True)
    features: list[torch.Tensor] = []
    actor.policy.register_forward_hook(lambda module, inputs, output: features.append(inputs[0]))
    action, _ = actor(history, torch.randn(2, 18))
    torch.testing.assert_close(features[0][:, 38:101], history[:, -63:])
    action.sum().backward()
    assert all(parameter.grad is None for parameter in actor.estimator.parameters())
    assert all(bool(parameter.grad.abs().sum() > 0) for parameter in actor.encoder.parameters())


def lively(network: torch.nn.Module) -> None:
    """Draw larger weights, with which a wrong sign would show."""
    for parameter in network.parameters():
        torch.nn.init.normal_(parameter, std=0.2)


@torch.no_grad()
def test_the_symmetric_networks_commute_with_the_mirror() -> None:
    torch.manual_seed(0)
    actor, critic = SymmetricActor(ROBOT), SymmetricCritic(ROBOT)
    lively(actor)
    lively(critic)
    history, command, seen = torch.randn(5, 315), torch.randn(5, 18), torch.randn(5, (CORE_SIZE + TERRAIN_SIZE))
    action, estimate = actor(history, command)
    image, image_estimate = actor(obs.mirror(HISTORY, ROBOT)(history), obs.mirror(COMMAND, ROBOT)(command))
    torch.testing.assert_close(image, obs.mirror(ACTION, ROBOT)(action), atol=1e-4, rtol=1e-5)
    torch.testing.assert_close(image_estimate, obs.mirror(ESTIMATE, ROBOT)(estimate), atol=1e-4, rtol=1e-5)
    core, terrain = seen.split((CORE_SIZE, TERRAIN_SIZE), 1)
    mirrored = torch.cat((obs.mirror(CRITIC_CORE, ROBOT)(core), obs.terrain_mirror()(terrain)), 1)
    torch.testing.assert_close(critic(mirrored), critic(seen), atol=1e-3, rtol=1e-5)
    assert action.std() > 0.1 and critic(seen).std() > 0.1
    assert not torch.allclose(critic(-seen), critic(seen), atol=1e-2)


@torch.no_grad()
def test_the_plain_form_of_the_symmetric_actor_is_the_same_function() -> None:
    torch.manual_seed(1)
    actor = SymmetricActor(ROBOT)
    lively(actor)
    history, command = torch.randn(5, 315), torch.randn(5, 18)
    for plain, symmetric in zip(actor.plain()(history, command), actor(history, command), strict=True):
        torch.testing.assert_close(plain, symmetric, atol=1e-3, rtol=1e-4)


@torch.no_grad()
def test_one_column_of_a_plane_stands_for_all_samples() -> None:
    torch.manual_seed(2)
    critic = SymmetricCritic(ROBOT)
    lively(critic)
    core, height = torch.randn(5, CORE_SIZE), torch.randn(5, 1)
    every = torch.cat((core, height.expand(-1, TERRAIN_SIZE)), 1)
    torch.testing.assert_close(critic(torch.cat((core, height), 1)), critic(every), atol=1e-2, rtol=1e-4)


def test_mirrored_joints_share_their_exploration() -> None:
    network = ActorCritic(ROBOT)
    with torch.no_grad():
        network.log_std[0] = -1.0  # the left hip's yaw; the right one is joint 5
    std = network.exploration()
    assert std[0] == std[5] == -0.5 and std[1] == 0.0


def test_networks_are_as_wide_as_the_tensors_that_they_take() -> None:
    """Policies of before version 0.2 are half as wide."""
    narrow = ActorCritic(ROBOT, hidden=(256, 128, 64))
    tensors = {f"network.{name}": value for name, value in narrow.state_dict().items()}
    assert policy_widths(tensors) == policy_widths(narrow.actor.plain().state_dict()) == (256, 128, 64)
    assert policy_widths({}) == (512, 256, 128)

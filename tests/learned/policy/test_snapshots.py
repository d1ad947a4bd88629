import pytest
import torch

from hugwbc.learned.policy import checkpoint, load_policy, observations as obs, policy_dir
from hugwbc.learned.policy.networks import ActorCritic
from hugwbc.learned.policy.snapshots import is_symmetric, network_of


def test_networks_of_either_kind_are_told_apart_and_loaded() -> None:
    for symmetric in (True, False):
        network = ActorCritic(symmetric=symmetric)
        tensors = network.state_dict()
        assert is_symmetric(tensors) == symmetric
        again = network_of(tensors)
        assert all(torch.equal(a, b) for a, b in zip(network.parameters(), again.parameters(), strict=True))
    with pytest.raises(RuntimeError):
        network_of({"weight": torch.zeros(3)})


@torch.no_grad()
def test_a_snapshot_with_the_first_layout_is_the_same_function_of_the_present_one() -> None:
    tensors, _ = checkpoint.load_file(policy_dir() / "h1" / "snapshot.safetensors", "checkpoint")
    network = network_of({name.removeprefix("network."): value for name, value in tensors.items()})
    actor = load_policy("h1").actor
    assert actor.command_size == obs.FIRST_COMMAND_SIZE
    gait = torch.tensor([0, 1, 2, 3, 4])
    phases = torch.rand(5, 2)
    command = obs.command_observation(torch.randn(5, 8), gait, phases, torch.ones(5, dtype=torch.bool))
    history = torch.randn(5, 315)
    torch.testing.assert_close(network.actor(history, command)[0], actor(history, command)[0], atol=1e-4, rtol=1e-4)
    assert torch.isfinite(network.critic(torch.randn(5, obs.CRITIC_SIZE))).all()

import pytest
import torch

from hugwbc.learned.policy.networks import ActorCritic
from hugwbc.learned.policy.snapshots import is_symmetric, load_into


def test_networks_of_either_kind_are_told_apart_and_loaded() -> None:
    for symmetric in (True, False):
        network = ActorCritic(symmetric=symmetric)
        tensors = network.state_dict()
        assert is_symmetric(tensors) == symmetric
        again = ActorCritic(symmetric=symmetric)
        load_into(again, tensors)
        assert all(torch.equal(a, b) for a, b in zip(network.parameters(), again.parameters(), strict=True))
    with pytest.raises(RuntimeError):
        load_into(ActorCritic(), {"weight": torch.zeros(3)})

"""Networks from the tensors of a snapshot or checkpoint."""

from collections.abc import Mapping

import torch

from hugwbc.learned.policy import critic_observations as obs
from hugwbc.learned.policy.networks import ActorCritic
from hugwbc.learned.policy.symmetry import EvenOdd


def load_into(network: ActorCritic, tensors: Mapping[str, torch.Tensor]) -> None:
    """Load tensors, by their names in the network.

    Observation terms that the tensors' network did not read have weights of zero.
    """
    widened = _widened(network, tensors) if network.further else {}
    network.load_state_dict(dict(tensors) | widened)


def _widened(network: ActorCritic, tensors: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Return the weights of first layers with zeros for further terms; none where they fit already."""
    even = EvenOdd(obs.command_mirror(network.further)).even - EvenOdd(obs.command_mirror()).even
    odd = obs.size_of(network.further) - even
    core = EvenOdd(obs.critic_mirror())
    places = {
        "actor.policy.layers.0.even.weight": (None, even),
        "actor.policy.layers.0.odd.weight": (None, odd),
        "critic.value.layers.0.even.weight": (core.even, even),
        "critic.value.layers.0.odd.weight": (core.odd, odd),
    }
    wide, wanted = {}, network.state_dict()
    for name, (place, count) in places.items():
        weight = tensors[name]
        if weight.shape[1] + count == wanted[name].shape[1] and count:
            place = weight.shape[1] if place is None else place
            wide[name] = torch.cat((weight[:, :place], weight.new_zeros(len(weight), count), weight[:, place:]), 1)
    return wide

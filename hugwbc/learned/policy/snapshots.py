"""Networks from the tensors of a snapshot or checkpoint."""

from collections.abc import Mapping

import torch

from hugwbc.learned.policy import observations as obs
from hugwbc.learned.policy.networks import ActorCritic, SymmetricActor, SymmetricCritic
from hugwbc.learned.policy.symmetry import EvenOdd

_POLICY, _CRITIC = "actor.policy.0.weight", "critic.value.0.weight"  # of plain networks: what reads the observations


def is_symmetric(tensors: Mapping[str, torch.Tensor]) -> bool:
    """Return whether tensors of a network, by name, are those of a symmetric one."""
    return _POLICY not in tensors


def load_into(network: ActorCritic, tensors: Mapping[str, torch.Tensor]) -> None:
    """Load tensors, by their names in the network.

    Observation terms that the tensors' network did not read have weights of zero.
    """
    widened = _widened(network, tensors) if network.further else {}
    network.load_state_dict(dict(tensors) | widened)


def _widened(network: ActorCritic, tensors: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Return the weights of first layers with zeros for further terms; none where they fit already."""
    actor, critic = network.actor, network.critic
    if isinstance(actor, SymmetricActor) and isinstance(critic, SymmetricCritic):
        even = EvenOdd(obs.command_mirror(network.further)).even - EvenOdd(obs.command_mirror()).even
        core = EvenOdd(obs.critic_mirror())
        odd = obs.size_of(network.further) - even
        places = {
            "actor.policy.layers.0.even.weight": (None, even),
            "actor.policy.layers.0.odd.weight": (None, odd),
            "critic.value.layers.0.even.weight": (core.even, even),
            "critic.value.layers.0.odd.weight": (core.odd, odd),
        }
    else:
        size = obs.size_of(network.further)
        places = {_POLICY: (None, size), _CRITIC: (obs.CRITIC_CORE_SIZE, size)}
    wide, wanted = {}, network.state_dict()
    for name, (place, count) in places.items():
        weight = tensors[name]
        if weight.shape[1] + count == wanted[name].shape[1] and count:
            place = weight.shape[1] if place is None else place
            wide[name] = torch.cat((weight[:, :place], weight.new_zeros(len(weight), count), weight[:, place:]), 1)
    return wide

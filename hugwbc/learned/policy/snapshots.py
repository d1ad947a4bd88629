"""Networks from the tensors of a snapshot or checkpoint."""

from collections.abc import Mapping

import torch

from hugwbc.learned.policy.networks import ActorCritic


def load_into(network: ActorCritic, tensors: Mapping[str, torch.Tensor]) -> None:
    """Load tensors, by their names in the network.

    Observation terms that the tensors' network did not read have weights of zero.
    """
    widened = _widened(network, tensors) if any(network.further) else {}
    network.load_state_dict(dict(tensors) | widened)


def _widened(network: ActorCritic, tensors: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Return the weights of first layers with zeros for further terms; none where they fit already."""
    even, odd = network.further
    places = {
        "actor.policy.layers.0.even.weight": (None, even),
        "actor.policy.layers.0.odd.weight": (None, odd),
        "critic.value.layers.0.even.weight": (network.core[0], even),
        "critic.value.layers.0.odd.weight": (network.core[1], odd),
    }
    wide, wanted = {}, network.state_dict()
    for name, (place, count) in places.items():
        weight = tensors[name]
        if weight.shape[1] + count == wanted[name].shape[1] and count:
            place = weight.shape[1] if place is None else place
            wide[name] = torch.cat((weight[:, :place], weight.new_zeros(len(weight), count), weight[:, place:]), 1)
    return wide

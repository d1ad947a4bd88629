"""Networks from the tensors of a snapshot or checkpoint, with this or the first layout of the observations."""

from collections.abc import Mapping

import torch

from hugwbc.learned.policy import observations as obs
from hugwbc.learned.policy.networks import ESTIMATE_SIZE, LATENT_SIZE, ActorCritic

_POLICY, _CRITIC = "actor.policy.0.weight", "critic.value.0.weight"  # of plain networks: what reads the observations
_BEFORE_COMMAND = LATENT_SIZE + ESTIMATE_SIZE + obs.PROPRIOCEPTION_SIZE
_FIRST_PRIVILEGED_SIZE = 24


def is_symmetric(tensors: Mapping[str, torch.Tensor]) -> bool:
    """Return whether tensors of a network, by name, are those of a symmetric one."""
    return _POLICY not in tensors


def load_into(network: ActorCritic, tensors: Mapping[str, torch.Tensor]) -> None:
    """Load tensors, by their names in the network; those of the first layout are changed to the present one.

    The first layout's command observation is a linear map of the present one, so that the changed network is the same
    function. What the critic sees in addition now has weights of zero.

    Raises:
        RuntimeError: if they do not fit the network.
    """
    tensors = dict(tensors)
    policy = tensors.get(_POLICY)
    if policy is not None and policy.shape[1] == _BEFORE_COMMAND + obs.FIRST_COMMAND_SIZE:
        before, command = policy.split((_BEFORE_COMMAND, obs.FIRST_COMMAND_SIZE), 1)
        tensors[_POLICY] = torch.cat((before, command @ obs.first_layout()), 1)
        sizes = (obs.PROPRIOCEPTION_SIZE, obs.FIRST_COMMAND_SIZE, _FIRST_PRIVILEGED_SIZE, obs.TERRAIN_SIZE)
        frame, command, privileged, terrain = tensors[_CRITIC].split(sizes, 1)
        unseen = torch.zeros(len(frame), obs.PRIVILEGED_SIZE - _FIRST_PRIVILEGED_SIZE)
        tensors[_CRITIC] = torch.cat((frame, command @ obs.first_layout(), privileged, unseen, terrain), 1)
    network.load_state_dict(tensors)


def network_of(tensors: Mapping[str, torch.Tensor]) -> ActorCritic:
    """Return the network that tensors, by their names in it, belong to.

    Raises:
        RuntimeError: if they do not fit this version's networks.
    """
    network = ActorCritic(symmetric=is_symmetric(tensors))
    load_into(network, tensors)
    return network

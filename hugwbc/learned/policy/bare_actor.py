"""The network of a policy in torch as a function of arrays, without the book-keeping of modules."""

from collections.abc import Callable

import numpy as np
import torch
from torch import nn

from hugwbc.learned.policy.layout import PROPRIOCEPTION_SIZE
from hugwbc.learned.policy.networks import Actor
from hugwbc.learned.policy.policy_rows import Network

_TorchNetwork = Callable[[torch.Tensor, torch.Tensor], tuple[torch.Tensor, torch.Tensor]]


def on_arrays(network: _TorchNetwork) -> Network:
    """Return a network of tensors as a function of arrays, without gradients."""

    def run(history: np.ndarray, command: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        with torch.inference_mode():
            action, estimate = network(torch.from_numpy(history), torch.from_numpy(command))
        return action.numpy(), estimate.numpy()

    return run


class BareActor:
    """The functions of an `Actor` without the book-keeping of its modules, half of the time for a single robot."""

    def __init__(self, actor: Actor) -> None:
        """Take the weights of a network."""
        self._parts = [
            [(layer.weight.detach(), layer.bias.detach()) for layer in part if isinstance(layer, nn.Linear)]
            for part in (actor.encoder, actor.estimator, actor.policy)
        ]

    def __call__(self, history: torch.Tensor, command: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return mean action and estimate, as `Actor.forward`."""
        encoder, estimator, policy = self._parts
        latent = _pass(encoder, history)
        estimate = _pass(estimator, latent)
        newest = history[:, -PROPRIOCEPTION_SIZE:]
        return _pass(policy, torch.cat((latent, estimate, newest, command), dim=1)), estimate


def _pass(layers: list[tuple[torch.Tensor, torch.Tensor]], rows: torch.Tensor) -> torch.Tensor:
    *hidden, (weight, bias) = layers
    for hidden_weight, hidden_bias in hidden:
        # On its own result, elu needs no further memory.
        rows = torch.nn.functional.elu_(torch.nn.functional.linear(rows, hidden_weight, hidden_bias))
    return torch.nn.functional.linear(rows, weight, bias)

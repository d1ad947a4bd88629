"""The network of a policy file in torch, without the book-keeping of modules: half of the time for a single robot."""

from collections.abc import Sequence

import numpy as np
import torch
from torch import nn

from hugwbc.learned.policy.networks import Actor


class BareActor:
    """The functions of an `Actor` as a `network_files.Network`."""

    def __init__(self, actor: Actor) -> None:
        """Take the weights of a network."""
        self._frame_size = actor.frame_size
        self._parts = [
            [(layer.weight.detach(), layer.bias.detach()) for layer in part if isinstance(layer, nn.Linear)]
            for part in (actor.encoder, actor.estimator, actor.policy)
        ]

    def reset(self) -> None:
        """Do nothing; the network has no memory."""

    def __call__(self, inputs: Sequence[np.ndarray]) -> np.ndarray:
        """Return the mean action, shape (joints,), of `Actor.forward` for a history and a command."""
        history, command = (torch.from_numpy(row)[None] for row in inputs)
        encoder, estimator, policy = self._parts
        with torch.inference_mode():
            latent = _pass(encoder, history)
            estimate = _pass(estimator, latent)
            newest = history[:, -self._frame_size :]
            action = _pass(policy, torch.cat((latent, estimate, newest, command), dim=1))
        return action[0].numpy()


def _pass(layers: list[tuple[torch.Tensor, torch.Tensor]], rows: torch.Tensor) -> torch.Tensor:
    *hidden, (weight, bias) = layers
    for hidden_weight, hidden_bias in hidden:
        # On its own result, elu needs no further memory.
        rows = torch.nn.functional.elu_(torch.nn.functional.linear(rows, hidden_weight, hidden_bias))
    return torch.nn.functional.linear(rows, weight, bias)

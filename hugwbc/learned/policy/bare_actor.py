"""The network of a policy in torch as a function of arrays: without the book-keeping of modules, and row by row."""

import copy
from collections.abc import Callable

import numpy as np
import torch
from torch import nn

from hugwbc.learned.policy.layout import PROPRIOCEPTION_SIZE
from hugwbc.learned.policy.networks import Actor
from hugwbc.learned.policy.policy_rows import Network

_SMALL = 400  # weights, below which PyTorch multiplies a batch by a loop of its own
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


class _RowLinear(nn.Module):
    """A linear layer whose result for a row does not depend on the number of rows.

    A product of two matrices sums in another order than a product of a vector and a matrix. The last bits differ, and
    a walk with contacts amplifies the difference. A batch of one-row products sums as a single row does, at a tenth of
    the cost of one call per row. The exception are small matrices, which PyTorch multiplies in a loop of its own: they
    are called row by row.
    """

    def __init__(self, linear: nn.Linear) -> None:
        super().__init__()
        self.weight, self.bias = linear.weight, linear.bias

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """Map rows of shape (n, inputs) to (n, outputs)."""
        if self.weight.numel() < _SMALL:
            return torch.cat([nn.functional.linear(row, self.weight, self.bias) for row in rows.split(1)])
        weight = self.weight.t()[None].expand(len(rows), -1, -1)
        return torch.bmm(rows[:, None], weight)[:, 0] + self.bias


def row_by_row(actor: Actor) -> Actor:
    """Return a copy of the network that gives each row of a batch what the network gives that row alone."""
    result = copy.deepcopy(actor)
    for part in [module for module in result.modules() if isinstance(module, nn.Sequential)]:
        for index, layer in enumerate(part):
            if isinstance(layer, nn.Linear):
                part[index] = _RowLinear(layer)
    return result

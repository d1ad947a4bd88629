"""A trained policy as a controller, loaded from safetensors without the training code."""

import dataclasses
import pathlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import nn

from hugwbc.errors import PolicyFileError
from hugwbc.learned.policy import checkpoint, self_test
from hugwbc.learned.policy.contract import Contract, contract_of
from hugwbc.learned.policy.network_files import TorchThreads
from hugwbc.learned.policy.network_policy import NetworkPolicy, tried
from hugwbc.learned.policy.networks import Actor
from hugwbc.learned.policy.policy_files import DEFAULT_POLICY, policy_file


def load_policy(name_or_path: str | pathlib.Path = DEFAULT_POLICY, *, threads: int | None = 1) -> "LearnedController":
    """Load a policy as a controller, by the name of a shipped policy, a policy file, or a folder that holds one.

    Args:
        name_or_path: "h1", or a path.
        threads: number of threads that torch may use where the policy is called; None leaves torch's own choice. One
            robot gains nothing from more: on a busy machine, threads waiting for each other stretched a tick of 0.4 ms
            to 55 ms.
    """
    path = policy_file(name_or_path)
    tensors, metadata = checkpoint.load_file(path, "policy")
    contract = contract_of(metadata, path)
    stored = {name: tensor for name, tensor in tensors.items() if name.startswith(self_test.PREFIX)}
    actor = Actor(contract.observation_size, contract.input_sizes[-1], len(contract.joints))
    try:
        actor.load_state_dict({name: tensor for name, tensor in tensors.items() if name not in stored})
    except RuntimeError as error:
        raise PolicyFileError(f"{path} does not fit the policy network: {error}") from error
    if not all(bool(torch.isfinite(tensor).all()) for tensor in actor.state_dict().values()):
        raise PolicyFileError(f"{path} has weights that are not finite: its training failed; use an earlier file of it")
    tried(BareActor(actor, threads), contract, path)
    controller = LearnedController(actor, contract, metadata.get("training", {}), threads)
    _verify(controller, stored, path)
    return controller


def _verify(controller: "LearnedController", stored: dict[str, torch.Tensor], path: pathlib.Path) -> None:
    """Refuse a policy that does not give the same joint targets here as where it was saved."""
    try:
        deviation = self_test.deviation(controller, stored)
    except (LookupError, ValueError, TypeError, RuntimeError) as error:
        raise PolicyFileError(f"{path} lacks a readable self-test ({error}); use a file as hugwbc wrote it") from error
    if deviation > self_test.TOLERANCE:
        versions = controller.training.get("versions")
        writer = versions.get("hugwbc", "unknown") if isinstance(versions, dict) else "unknown"
        raise PolicyFileError(
            f"{path} fails its self-test: joint targets differ by up to {deviation:.2g} rad from the stored ones, "
            f"valid is {self_test.TOLERANCE:g}. The file was changed, or this hugwbc runs policies differently than "
            f"hugwbc {writer}, which wrote it; use that version"
        )


def save_policy(path: pathlib.Path, actor: Actor, contract: Contract, training: dict[str, Any]) -> None:
    """Write a policy file: weights, contract, training record and self-test.

    Args:
        path: path of the file.
        actor: the network.
        contract: contract of the training, from `EnvConfig.contract`.
        training: record of the training, anything JSON can hold.
    """
    tensors = actor.state_dict() | self_test.record(LearnedController(actor, contract, training))
    checkpoint.save_file(path, tensors, "policy", {"contract": dataclasses.asdict(contract), "training": training})


class LearnedController(NetworkPolicy):
    """A policy of this project, whose network torch runs.

    Attributes:
        actor: network of the policy.
        training: record of its training.
    """

    def __init__(
        self, actor: Actor, contract: Contract, training: dict[str, Any] | None = None, threads: int | None = None
    ) -> None:
        """Set up a controller for a trained network, which runs on some threads of torch; None for torch's choice."""
        self.actor, self.training = actor.eval(), training or {}
        super().__init__(contract, BareActor(self.actor, threads))


class BareActor:
    """The functions of an `Actor` as a `network_files.Network`."""

    def __init__(self, actor: Actor, threads: int | None) -> None:
        """Take the weights of a network, and the threads that torch may use; None for torch's choice."""
        self._threads = TorchThreads(threads)
        self._frame_size = actor.frame_size
        self._parts = [
            [(layer.weight.detach(), layer.bias.detach()) for layer in part if isinstance(layer, nn.Linear)]
            for part in (actor.encoder, actor.estimator, actor.policy)
        ]

    def reset(self) -> None:
        """Do nothing; the network has no memory."""

    def __call__(self, inputs: Sequence[np.ndarray]) -> np.ndarray:
        """Return the mean action, shape (joints,), of `Actor.forward` for a history and a command."""
        self._threads.keep()
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

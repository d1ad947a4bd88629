"""A trained policy as a controller, loaded from safetensors without the training code."""

import dataclasses
import pathlib
from typing import Any

import torch

from hugwbc.errors import PolicyFileError
from hugwbc.learned.policy import checkpoint, self_test
from hugwbc.learned.policy.bare_actor import BareActor
from hugwbc.learned.policy.contract import Contract, contract_of
from hugwbc.learned.policy.network_policy import NetworkPolicy, tried
from hugwbc.learned.policy.networks import Actor
from hugwbc.learned.policy.policy_files import DEFAULT_POLICY, policy_file


def load_policy(name_or_path: str | pathlib.Path = DEFAULT_POLICY, *, threads: int | None = 1) -> "LearnedController":
    """Load a policy as a controller, by the name of a shipped policy, a policy file, or a folder that holds one.

    Args:
        name_or_path: "h1", or a path.
        threads: number of threads that torch may use in this process; None leaves torch's own choice. One robot gains
            nothing from more: on a busy machine, threads waiting for each other stretched a tick of 0.4 ms to 55 ms.
    """
    if threads is not None:
        torch.set_num_threads(threads)
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
    tried(BareActor(actor), contract, path)
    controller = LearnedController(actor, contract, metadata.get("training", {}))
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

    def __init__(self, actor: Actor, contract: Contract, training: dict[str, Any] | None = None) -> None:
        """Set up a controller for a trained network."""
        self.actor, self.training = actor.eval(), training or {}
        super().__init__(contract, BareActor(self.actor))

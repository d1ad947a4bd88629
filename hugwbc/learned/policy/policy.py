"""A trained policy as a controller, loaded from safetensors without the training code."""

import pathlib
from typing import Any

import torch

from hugwbc.errors import PolicyFileError
from hugwbc.learned.policy import checkpoint, self_test
from hugwbc.learned.policy.bare_actor import BareActor, on_arrays
from hugwbc.learned.policy.network_policy import NetworkPolicy
from hugwbc.learned.policy.networks import Actor
from hugwbc.learned.policy.policy_contract import command_size, complete_contract, recorded_intervention
from hugwbc.learned.policy.policy_files import DEFAULT_POLICY, policy_file


def trained_with(name_or_path: str | pathlib.Path = DEFAULT_POLICY) -> str | None:
    """Return what moved the arms in a policy's training ("noise", "motion" or "none"); None without a record.

    Raises:
        UnknownNameError: if it is neither a shipped policy nor an existing path.
        PolicyFileError: if the file is missing, truncated or of another program.
    """
    _, metadata = checkpoint.load_file(policy_file(name_or_path), "policy")
    return recorded_intervention(metadata)


def load_policy(name_or_path: str | pathlib.Path = DEFAULT_POLICY, *, threads: int | None = 1) -> "LearnedController":
    """Load a policy as a controller, by the name of a shipped policy, a policy file, or a folder that holds one.

    Args:
        name_or_path: "h1", or a path.
        threads: number of threads that torch may use in this process; None leaves torch's own choice. One robot gains
            nothing from more: on a busy machine, threads waiting for each other stretched a tick of 0.4 ms to 55 ms.

    Raises:
        UnknownNameError: if it is neither a shipped policy nor an existing path.
        PolicyFileError: if the file is truncated, corrupted, of another program or another robot, has weights that
            are not finite, or fails its self-test.
    """
    if threads is not None:
        torch.set_num_threads(threads)
    path = policy_file(name_or_path)
    tensors, metadata = checkpoint.load_file(path, "policy")
    metadata = complete_contract(metadata, path)
    stored = {name: tensor for name, tensor in tensors.items() if name.startswith(self_test.PREFIX)}
    actor = Actor(command_size(metadata))
    try:
        actor.load_state_dict({name: tensor for name, tensor in tensors.items() if name not in stored})
    except RuntimeError as error:
        raise PolicyFileError(f"{path} does not fit the policy network: {error}") from error
    if not all(bool(torch.isfinite(tensor).all()) for tensor in actor.state_dict().values()):
        raise PolicyFileError(f"{path} has weights that are not finite: its training failed; use an earlier file of it")
    controller = LearnedController(actor, metadata)
    _verify(controller, stored, path)
    return controller


def _verify(controller: "LearnedController", stored: dict[str, torch.Tensor], path: pathlib.Path) -> None:
    """Refuse a policy that does not give the same joint targets here as where it was saved."""
    try:
        deviation = self_test.deviation(controller, stored)
    except (LookupError, ValueError, TypeError, RuntimeError) as error:
        raise PolicyFileError(f"{path} lacks a readable self-test ({error}); use a file as hugwbc wrote it") from error
    if deviation > self_test.TOLERANCE:
        versions = controller.metadata.get("versions")
        writer = versions.get("hugwbc", "unknown") if isinstance(versions, dict) else "unknown"
        raise PolicyFileError(
            f"{path} fails its self-test: joint targets differ by up to {deviation:.2g} rad from the stored ones, "
            f"valid is {self_test.TOLERANCE:g}. The file was changed, or this hugwbc runs policies differently than "
            f"hugwbc {writer}, which wrote it; use that version"
        )


def save_policy(path: pathlib.Path, actor: Actor, contract: dict[str, Any], training: dict[str, Any]) -> None:
    """Write a policy file: weights, contract, training record and self-test.

    Args:
        path: path of the file.
        actor: the network.
        contract: contract of the training, from `policy_contract`.
        training: record of the training, anything JSON can hold.
    """
    metadata = contract | {"training": training}
    tensors = actor.state_dict() | self_test.record(LearnedController(actor, metadata))
    checkpoint.save_file(path, tensors, "policy", metadata)


class LearnedController(NetworkPolicy):
    """A trained policy whose network torch runs; further attributes in `NetworkPolicy`.

    Attributes:
        actor: network of the policy.
    """

    def __init__(self, actor: Actor, metadata: dict[str, Any]) -> None:
        """Set up a controller for a network.

        Args:
            actor: the trained network.
            metadata: its contract, from `policy_contract` or `complete_contract`.
        """
        self.actor = actor.eval()
        super().__init__(on_arrays(BareActor(self.actor)), metadata)

    def last_pass(self) -> dict[str, torch.Tensor]:
        """Return inputs and outputs of the network in the last call of `act`.

        Returns:
            history (1, 315), observation (1, 18), action (1, 19) and estimate (1, 6), in observation units.
        """
        rows = self._rows
        passed = {"history": rows.history.reshape(1, -1), "observation": rows.observation}
        passed |= {"action": rows.action, "estimate": rows.estimate}
        return {name: torch.from_numpy(value.copy()) for name, value in passed.items()}

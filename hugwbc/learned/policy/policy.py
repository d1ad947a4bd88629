"""A trained policy as a controller, loaded from safetensors without the training code."""

import os
import pathlib
from typing import Any

import numpy as np
import torch

from hugwbc.commands import Command
from hugwbc.controller import JointCommand, UpperBody, override_arms
from hugwbc.errors import PolicyFileError, UnknownNameError
from hugwbc.learned.policy import checkpoint, self_test
from hugwbc.learned.policy.networks import Actor
from hugwbc.learned.policy.policy_contract import command_size, complete_contract
from hugwbc.learned.policy.policy_rows import BareActor, PolicyRows, row_by_row
from hugwbc.robot import load_robot, model_dir
from hugwbc.state import RobotState

DEFAULT_POLICY = "h1"
POLICY_FILE = "policy.safetensors"
LARGEST_READING = 1e10  # [rad], [rad/s], MuJoCo's own bound; far beyond it the network overflows


def policy_dir() -> pathlib.Path:
    """Return the folder of the shipped policies."""
    return model_dir() / "policies"


def shipped_policies() -> list[str]:
    """Return the names of the shipped policies."""
    return sorted(path.parent.name for path in policy_dir().glob(f"*/{POLICY_FILE}"))


def policy_file(name_or_path: str | pathlib.Path = DEFAULT_POLICY) -> pathlib.Path:
    """Find the policy file, given the name of a shipped policy, a file, or a folder that holds one.

    Raises:
        UnknownNameError: if it is neither a shipped policy nor an existing path.
    """
    for path in (pathlib.Path(name_or_path), policy_dir() / str(name_or_path)):
        # pathlib raises on a name that no file can have; os.path says that it does not exist.
        if os.path.exists(path):
            return path / POLICY_FILE if path.is_dir() else path
    raise UnknownNameError("policy", name_or_path, [*shipped_policies(), "the path of a policy file or folder"])


def trained_with(name_or_path: str | pathlib.Path = DEFAULT_POLICY) -> str | None:
    """Return what moved the arms in a policy's training ("noise", "motion" or "none"); None without a record.

    Raises:
        UnknownNameError: if it is neither a shipped policy nor an existing path.
        PolicyFileError: if the file is missing, truncated or of another program.
    """
    _, metadata = checkpoint.load_file(policy_file(name_or_path), "policy")
    record: Any = metadata
    for key in ("training", "config", "env", "intervention"):
        record = record.get(key) if isinstance(record, dict) else None
    return record if isinstance(record, str) else None


def load_policy(name_or_path: str | pathlib.Path = DEFAULT_POLICY, *, threads: int | None = 1) -> "LearnedController":
    """Load a policy as a controller, by the name of a shipped policy, a policy file, or a folder that holds one.

    Args:
        name_or_path: "h1", or a path.
        threads: number of threads that torch may use in this process; None leaves torch's own choice. One robot gains
            nothing from more: on a busy machine, threads waiting for each other stretched a tick of 0.4 ms to 55 ms.

    Raises:
        UnknownNameError: if it is neither a shipped policy nor an existing path.
        PolicyFileError: if the file is truncated, corrupted, of another program or another robot, or fails its
            self-test.
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
    controller = LearnedController(actor, metadata)
    # A file from before the contract was versioned has no self-test.
    if "contract" in metadata:
        _verify(controller, stored, path)
    return controller


def _verify(controller: "LearnedController", stored: dict[str, torch.Tensor], path: pathlib.Path) -> None:
    """Refuse a policy that does not give the same joint targets here as where it was saved."""
    try:
        deviation = self_test.deviation(controller, stored)
    except (LookupError, ValueError, TypeError, RuntimeError) as error:
        raise PolicyFileError(f"{path} lacks a readable self-test ({error}); use a file as hugwbc wrote it") from error
    if deviation > self_test.TOLERANCE:
        writer = controller.metadata.get("versions", {}).get("hugwbc", "unknown")
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


def _is_readable(state: RobotState) -> bool:
    """Return whether the network can read a state: an action that overflowed would stay in its inputs for ever."""
    numbers = np.concatenate((state.q, state.dq, state.angular_velocity))
    return state.is_finite and float(np.abs(numbers).max()) <= LARGEST_READING


class LearnedController:
    """A trained policy behind the common controller interface.

    Attributes:
        name: "learned".
        period: time between two actions [s].
        metadata: contract and training record of the policy.
        robot: robot that the policy was trained on, from the contract.
        actor: network of the policy.
        held: number of unreadable states that were replaced by the last good observation.
    """

    name = "learned"

    def __init__(self, actor: Actor, metadata: dict[str, Any]) -> None:
        """Set up a controller for a network.

        Args:
            actor: the trained network.
            metadata: its contract, from `policy_contract` or `complete_contract`.
        """
        self.period = float(metadata["period"])
        self.metadata = metadata
        self.held = 0
        self.robot = load_robot(metadata["robot"])
        self.actor = actor.eval()
        self._rows = PolicyRows(metadata, BareActor(self.actor), 1)

    @property
    def phase(self) -> float:
        """Common phase of `hugwbc.gait` in the period of the last command, in [0, 1)."""
        return float(self._rows.phase[0])

    def reset(self, state: RobotState) -> None:
        """Forget the past and fill the history with the first frame."""
        self._rows.reset()
        if _is_readable(state):
            self._push(state)

    def for_many(self, count: int) -> PolicyRows:
        """Return the same policy for many robots; each gets what `act` would give it, bit for bit."""
        return PolicyRows(self.metadata, row_by_row(self.actor), count)

    def _push(self, state: RobotState) -> None:
        self._rows.push(state.angular_velocity[None], state.projected_gravity[None], state.q[None], state.dq[None])

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        """Return the joint targets for the next period; arms under external control get the external targets.

        A state that is not finite, or beyond `LARGEST_READING`, leaves the history unchanged. Commands outside of
        their ranges are clamped.
        """
        if _is_readable(state):
            self._push(state)
        else:
            self.held += 1
        command, _ = command.clamp()
        rows = self._rows
        q = rows.decide(command.array()[None], np.array([int(command.gait)]), np.array([upper_body.indicator]))[0]
        zero = np.zeros_like(q)
        own = JointCommand(q=q, dq=zero, kp=rows.kp, kd=rows.kd, tau=zero)
        return override_arms(own, upper_body, self.robot)

    def last_pass(self) -> dict[str, torch.Tensor]:
        """Return inputs and outputs of the network in the last call of `act`.

        Returns:
            history (1, 315), observation (1, 18), action (1, 19) and estimate (1, 6), in observation units.
        """
        rows = self._rows
        passed = {"history": rows.history.reshape(1, -1), "observation": rows.observation}
        passed |= {"action": rows.action, "estimate": rows.estimate}
        return {name: torch.from_numpy(value.copy()) for name, value in passed.items()}

"""A trained policy as a controller, loaded from a file with a self-test, without the training code."""

import dataclasses
import math
import pathlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import nn

from hugwbc.commands import COMMAND_NAMES, Command, command_ranges
from hugwbc.controller import UpperBody
from hugwbc.errors import PolicyFileError
from hugwbc.gait import Gait
from hugwbc.learned.policy import checkpoint
from hugwbc.learned.policy.contract import Contract, contract_of
from hugwbc.learned.policy.network_files import DEFAULT_POLICY, keep_threads, policy_file
from hugwbc.learned.policy.network_policy import NetworkPolicy, tried
from hugwbc.learned.policy.networks import Actor, policy_widths
from hugwbc.robot import Robot
from hugwbc.state import RobotState

# The self-test in a policy file: sensor readings and commands, and the joint targets that they must give.
_PREFIX = "self_test."  # of the names of its tensors
_TOLERANCE = 1e-4  # [rad] of joint targets; float32 differs by about 1e-6 between machines
_TEST_INPUTS = ("orientation", "angular_velocity", "q", "dq", "command", "gait", "arms", "intervention")
_STEPS_EACH = 6  # of each gait, one more than the history holds
_SEED = 0


def load_policy(name_or_path: str | pathlib.Path = DEFAULT_POLICY, *, threads: int | None = 1) -> "LearnedController":
    """Load a policy as a controller, by the name of a shipped policy, a policy file, or a folder that holds one.

    Args:
        name_or_path: "h1", or a path.
        threads: number of threads that torch may use where the policy is called; None leaves torch's own choice. One
            robot gains nothing from more than one: on a busy machine, threads that waited for each other stretched a
            tick of 0.4 ms to 55 ms.

    Raises:
        PolicyFileError: if the file cannot be read, is damaged, or fails its self-test.
        UnknownNameError: if there is no such policy.
    """
    path = policy_file(name_or_path)
    tensors, metadata = checkpoint.load_file(path, "policy")
    contract = contract_of(metadata, path)
    stored = {name: tensor for name, tensor in tensors.items() if name.startswith(_PREFIX)}
    actor = Actor(contract.observation_size, contract.input_sizes[-1], len(contract.joints), policy_widths(tensors))
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
        inputs = {name: stored[_PREFIX + name] for name in _TEST_INPUTS}
        expected, found = stored[_PREFIX + "target"], _test_targets(controller, inputs)
        if expected.shape != found.shape:
            raise ValueError(f"targets of shape {tuple(expected.shape)}")
        difference = float((found - expected).abs().nan_to_num(nan=math.inf, posinf=math.inf).max())
    except (LookupError, ValueError, TypeError, RuntimeError) as error:
        raise PolicyFileError(f"{path} lacks a readable self-test ({error}); use a file as hugwbc wrote it") from error
    if difference > _TOLERANCE:
        versions = controller.training.get("versions")
        writer = versions.get("hugwbc", "unknown") if isinstance(versions, dict) else "unknown"
        raise PolicyFileError(
            f"{path} fails its self-test: joint targets differ by up to {difference:.2g} rad from the stored ones, "
            f"valid is {_TOLERANCE:g}. The file was changed, or this hugwbc runs policies differently than "
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
    test = _made_up(contract.described)
    test["target"] = _test_targets(LearnedController(actor, contract, training), test)
    tensors = actor.state_dict() | {_PREFIX + name: tensor for name, tensor in test.items()}
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
        """Set up a controller for a trained network that runs on `threads` threads; None for torch's choice."""
        self.actor, self.training = actor.eval(), training or {}
        super().__init__(contract, BareActor(self.actor, threads))


class BareActor:
    """An `Actor` as a `network_files.Network`, computed from its weights without torch's modules."""

    def __init__(self, actor: Actor, threads: int | None) -> None:
        """Take the weights of an actor, and the number of threads that torch may use; None for torch's choice."""
        self._threads = threads
        self._frame_size = actor.frame_size
        self._parts = [
            [(layer.weight.detach(), layer.bias.detach()) for layer in part if isinstance(layer, nn.Linear)]
            for part in (actor.encoder, actor.estimator, actor.policy)
        ]

    def reset(self) -> None:
        """Do nothing; the network has no memory."""

    def __call__(self, inputs: Sequence[np.ndarray]) -> np.ndarray:
        """Return the mean action, shape (joints,), of `Actor.forward` for a history and a command."""
        keep_threads(self._threads)
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
        # In place, elu needs no further memory.
        rows = torch.nn.functional.elu_(torch.nn.functional.linear(rows, hidden_weight, hidden_bias))
    return torch.nn.functional.linear(rows, weight, bias)


def _made_up(robot: Robot) -> dict[str, torch.Tensor]:
    """Make up an episode with every gait, commands in their initial ranges, and arms at times under external control.

    Of k steps: orientation (k, 4), angular_velocity (k, 3), q and dq (k, joints), command (k, 8), gait (k,), arms
    (k, arm joints) and intervention (k,).
    """
    rng = np.random.default_rng(_SEED)
    steps, joints = _STEPS_EACH * len(Gait), len(robot.joint_names)
    tilt = 0.2 * rng.standard_normal((steps, 3))
    orientation = np.column_stack((np.ones(steps), tilt))
    ranges = command_ranges(Gait.WALKING, robot)
    low, high = np.array([ranges[name].initial for name in COMMAND_NAMES]).T
    command = rng.uniform(low, high, (steps, len(COMMAND_NAMES)))
    gait = np.repeat([int(gait) for gait in Gait], _STEPS_EACH)
    command[gait == Gait.STANDING, :3] = 0.0
    arrays = {
        "orientation": orientation / np.linalg.norm(orientation, axis=1, keepdims=True),
        "angular_velocity": rng.standard_normal((steps, 3)),
        "q": robot.nominal + 0.2 * rng.standard_normal((steps, joints)),
        "dq": 2.0 * rng.standard_normal((steps, joints)),
        "command": command,
        "gait": gait,
        "arms": rng.uniform(-0.5, 0.5, (steps, len(robot.arms))),
        "intervention": np.arange(steps) % 3 == 2,
    }
    return {name: torch.from_numpy(array) for name, array in arrays.items()}


def _test_targets(controller: NetworkPolicy, inputs: dict[str, torch.Tensor]) -> torch.Tensor:
    """Return the joint targets of the controller after a reset, at every step [rad], shape (k, joints)."""
    rows = {name: inputs[name].numpy() for name in _TEST_INPUTS}
    targets = []
    for i in range(len(rows["q"])):
        state = RobotState(*(rows[name][i] for name in ("q", "dq", "orientation", "angular_velocity")))
        if i == 0:
            controller.reset(state)
        command, _ = Command.from_array(rows["command"][i], Gait(int(rows["gait"][i]))).clamp()
        upper_body = UpperBody.targets(rows["arms"][i]) if rows["intervention"][i] else UpperBody.none()
        targets.append(torch.from_numpy(controller.act(state, command, upper_body).q))
    return torch.stack(targets)

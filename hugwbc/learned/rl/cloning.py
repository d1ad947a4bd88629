"""Behaviour cloning inside PPO: labels of a teacher, collected once, pull the policy towards it while it learns.

The term is weight * mean huber(pi(o) - a) over labelled observations o and the teacher's actions a. A schedule lets its
weight decay, so that the teacher shows the way and reinforcement learning has the last word.
"""

import pathlib
from collections.abc import Mapping

import torch

from hugwbc.errors import PolicyFileError
from hugwbc.learned.policy import checkpoint, observations as obs
from hugwbc.learned.policy.networks import ACTION_SIZE, ActorCritic
from hugwbc.learned.policy.observations import Observation
from hugwbc.learned.policy.records import versions

LABELS_FILE = "labels.safetensors"
_WIDTHS = {
    "history": obs.HISTORY_FRAMES * obs.PROPRIOCEPTION_SIZE,
    "command": obs.COMMAND_SIZE,
    "action": ACTION_SIZE,
    "weight": ACTION_SIZE,
}


def save_labels(path: pathlib.Path, columns: Mapping[str, torch.Tensor], record: Mapping[str, object]) -> None:
    """Write labels to a file, in half precision: an error of 1e-3 is below that of any teacher.

    Args:
        path: path of the file.
        columns: history (n, 315), command (n, 18), action (n, 19) and weight (n, 19) of each joint in the loss.
        record: where they come from, anything JSON can hold.
    """
    tensors = {name: columns[name].half() for name in _WIDTHS}
    rows = len(tensors["action"])
    checkpoint.save_file(path, tensors, "labels", {"labels": rows, "versions": versions()} | dict(record))


class Labels:
    """Labelled observations, in the coordinates of a network.

    Attributes:
        count: number of labels.
    """

    def __init__(self, path: pathlib.Path, network: ActorCritic, generator: torch.Generator) -> None:
        """Read a file that `save_labels` wrote.

        Args:
            path: path of the file.
            network: the learner's networks, which read the labels.
            generator: source of the batches.

        Raises:
            PolicyFileError: if the file cannot be used.
        """
        columns, _ = checkpoint.load_file(path, "labels")
        self.count = len(columns["action"]) if "action" in columns else 0
        for name, width in _WIDTHS.items():
            found = tuple(columns[name].shape) if name in columns else None
            if not self.count or found != (self.count, width):
                raise PolicyFileError(
                    f"{path} has no usable labels: '{name}' has the shape {found}, not {(self.count, width)}; "
                    "give a file that this version collected"
                )
        self._columns = {name: columns[name] for name in _WIDTHS}
        self._network, self._generator = network, generator

    def sample(self, rows: int) -> dict[str, torch.Tensor]:
        """Draw labels at random: history and command in the network's coordinates, action and weight."""
        chosen = torch.randint(self.count, (rows,), generator=self._generator)
        batch = {name: column.index_select(0, chosen).float() for name, column in self._columns.items()}
        critic, estimate = torch.zeros(rows, obs.CRITIC_CORE_SIZE + 1), torch.zeros(rows, obs.ESTIMATE_SIZE)
        seen = self._network.prepare(Observation(batch["history"], batch["command"], critic, estimate))
        return batch | {"history": seen.history, "command": seen.command}


def cloning_loss(action: torch.Tensor, label: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """Return the mean of the weighted smooth L1 loss over batch and joints.

    It tolerates labels that jump where a foot of the teacher comes down; of a squared loss they would be the most.
    """
    return (weight * torch.nn.functional.smooth_l1_loss(action, label, reduction="none")).mean()

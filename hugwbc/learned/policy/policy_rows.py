"""One policy for any number of robots: each row has its own past and the same result as a robot by itself."""

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import nn

from hugwbc import gait as gaits
from hugwbc.commands import COMMAND_NAMES
from hugwbc.learned.policy import feed_forward
from hugwbc.learned.policy import observations as obs
from hugwbc.learned.policy.networks import Actor
from hugwbc.learned.policy.policy_contract import command_size
from hugwbc.robot import load_robot

_F, _W = COMMAND_NAMES.index("f"), COMMAND_NAMES.index("w")
_SMALL = 400  # weights, below which PyTorch multiplies a batch by a loop of its own
Network = Callable[[torch.Tensor, torch.Tensor], tuple[torch.Tensor, torch.Tensor]]


class PolicyRows:
    """Observations and actions of n robots under one policy.

    Attributes:
        kp, kd: gains of the joints [N*m/rad, N*m*s/rad], shape (19,).
        history: last five proprioceptive frames, oldest first, shape (n, 5, 63).
        observation: command observation in the policy's layout, shape (n, 18), or (n, 13) in the first one.
        action, estimate: last outputs of the network, shapes (n, 19) and (n, 6).
        phase: common phase of each robot's gait, shape (n,).
    """

    def __init__(self, metadata: dict[str, Any], network: Network, count: int) -> None:
        """Set up rows; call `reset` before the first `push`.

        Args:
            metadata: contract of the policy.
            network: function from history and command observation to action and estimate.
            count: number of robots.
        """
        vectors = (np.array(metadata[name], dtype=float) for name in ("nominal", "action_scale", "kp", "kd"))
        self._nominal, self._scale, self.kp, self.kd = vectors
        self._nominal_row = torch.tensor(self._nominal, dtype=torch.float32)
        self._network = network
        self._feed_forward = feed_forward.of_contract(metadata)
        self._period = float(metadata["period"])
        self._waist_step = float(metadata["waist_rate"]) * self._period
        self._waist_joint = load_robot(metadata["robot"]).waist
        self.history = torch.zeros(count, obs.HISTORY_FRAMES, obs.PROPRIOCEPTION_SIZE)
        self._command_size = command_size(metadata)
        self.observation = torch.zeros(count, self._command_size)
        self.action = torch.zeros(count, obs.JOINTS)
        self.estimate = torch.zeros(count, obs.ESTIMATE_SIZE)
        self.phase = np.zeros(count)
        self._waist = np.zeros(count)
        self._started = False

    def reset(self) -> None:
        """Forget the past of all rows; the next frame fills the histories, which are zero until then."""
        self.history = torch.zeros_like(self.history)
        self.action = torch.zeros_like(self.action)
        self.phase = np.zeros_like(self.phase)
        self._waist = np.zeros_like(self._waist)
        self._started = False

    def keep(self, rows: np.ndarray) -> None:
        """Keep the chosen rows, shape (n,), bool, and drop those of robots that are done."""
        chosen = torch.from_numpy(rows)
        for name in ("history", "observation", "action", "estimate"):
            setattr(self, name, getattr(self, name)[chosen])
        self.phase, self._waist = self.phase[rows], self._waist[rows]

    def push(self, angular_velocity: np.ndarray, gravity: np.ndarray, q: np.ndarray, dq: np.ndarray) -> None:
        """Add a frame to the histories.

        Args:
            angular_velocity: angular velocity of the pelvis in its own frame [rad/s], shape (n, 3).
            gravity: unit vector of gravity in the pelvis frame, shape (n, 3).
            q: joint positions [rad], shape (n, 19).
            dq: joint velocities [rad/s], shape (n, 19).
        """
        frame = obs.proprioception(
            _tensor(angular_velocity), _tensor(gravity), _tensor(q) - self._nominal_row, _tensor(dq), self.action
        )
        if self._started:
            self.history = torch.cat((self.history[:, 1:], frame[:, None]), dim=1)
        else:
            self.history[:] = frame[:, None]
            self._started = True

    @torch.no_grad()
    def decide(self, command: np.ndarray, gait: np.ndarray, indicator: np.ndarray) -> np.ndarray:
        """Return the joint position targets for the next period [rad], shape (n, 19).

        Args:
            command: commands within their ranges, in the order of `COMMAND_NAMES`, shape (n, 8).
            gait: values of `Gait`, shape (n,).
            indicator: whether the arms are under external control, shape (n,), bool.
        """
        self.phase = gaits.advance_phase(self.phase, command[:, _F], self._period)
        command = self._feed_forward.asked(command, gait)
        gait_row = torch.as_tensor(gait)
        feet = gaits.foot_phases(_tensor(self.phase), gait_row)
        phases = gaits.homogenised_phase(feet)
        observation = obs.command_observation(_tensor(command), gait_row, phases, torch.as_tensor(indicator))
        self.observation = obs.in_layout(observation, self._command_size)
        self.action, self.estimate = self._network(self.history.flatten(1), self.observation)
        q = self._nominal + self._scale * self.action.double().numpy()
        self._waist += np.clip(command[:, _W] - self._waist, -self._waist_step, self._waist_step)
        q[:, self._waist_joint] += self._waist
        return q


def _tensor(values: np.ndarray) -> torch.Tensor:
    return torch.as_tensor(values, dtype=torch.float32)


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

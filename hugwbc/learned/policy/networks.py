"""The paper's networks: history encoder, state estimator, low-level policy and privileged critic."""

import torch
from torch import nn

from hugwbc.learned.policy.observations import (
    COMMAND_SIZE,
    CRITIC_SIZE,
    ESTIMATE_SIZE,
    HISTORY_FRAMES,
    PROPRIOCEPTION_SIZE,
)

LATENT_SIZE = 32
ACTION_SIZE = 19
ENCODER_HIDDEN = (256, 128)
ESTIMATOR_HIDDEN = (64, 32)
POLICY_HIDDEN = (256, 128, 64)
CRITIC_HIDDEN = (512, 256, 128)


def _mlp(inputs: int, hidden: tuple[int, ...], outputs: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for width in hidden:
        layers += [nn.Linear(inputs, width), nn.ELU()]
        inputs = width
    return nn.Sequential(*layers, nn.Linear(inputs, outputs))


class Actor(nn.Module):
    """The policy's mean action and state estimate from the proprioceptive history and the command.

    z = encoder(o_his); [v, l, h] = estimator(z); a = policy(z, [v, l, h], o_pro, c). No gradient passes from the
    policy to the estimate: its own loss alone trains it, so that it remains an estimate of the state.
    """

    def __init__(self) -> None:
        super().__init__()
        self.encoder = _mlp(HISTORY_FRAMES * PROPRIOCEPTION_SIZE, ENCODER_HIDDEN, LATENT_SIZE)
        self.estimator = _mlp(LATENT_SIZE, ESTIMATOR_HIDDEN, ESTIMATE_SIZE)
        self.policy = _mlp(LATENT_SIZE + ESTIMATE_SIZE + PROPRIOCEPTION_SIZE + COMMAND_SIZE, POLICY_HIDDEN, ACTION_SIZE)

    def forward(self, history: torch.Tensor, command: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return mean action and estimate.

        Args:
            history: the last five proprioceptive frames, oldest first, shape (n, 315).
            command: commands, clocks and indicator, shape (n, 13).

        Returns:
            Mean action, shape (n, 19), and estimate [v, l, h] in observation units, shape (n, 6).
        """
        latent = self.encoder(history)
        estimate = self.estimator(latent)
        newest = history[:, -PROPRIOCEPTION_SIZE:]
        return self.policy(torch.cat((latent, estimate.detach(), newest, command), dim=1)), estimate


class Critic(nn.Module):
    """The value of a state from the privileged observation, shape (n, 321) to (n,)."""

    def __init__(self) -> None:
        super().__init__()
        self.value = _mlp(CRITIC_SIZE, CRITIC_HIDDEN, 1)

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return the value of each row."""
        return self.value(observation).squeeze(1)


class ActorCritic(nn.Module):
    """Actor, critic and one exploration standard deviation per joint."""

    def __init__(self, std: float = 1.0) -> None:
        super().__init__()
        self.actor = Actor()
        self.critic = Critic()
        self.log_std = nn.Parameter(torch.full((ACTION_SIZE,), float(std)).log())
        # Start close to the nominal pose: zero mean action.
        output = self.actor.policy[-1]
        assert isinstance(output, nn.Linear)
        nn.init.uniform_(output.weight, -0.01, 0.01)
        nn.init.zeros_(output.bias)

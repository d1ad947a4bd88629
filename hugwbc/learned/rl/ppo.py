"""PPO with a loss of the state estimator: the whole algorithm, readable from top to bottom.

Proximal policy optimisation: Schulman et al., "Proximal Policy Optimization Algorithms", arXiv:1707.06347 (2017).
Advantages: Schulman et al., "High-Dimensional Continuous Control Using Generalized Advantage Estimation", ICLR 2016.
"""

import dataclasses
import math
from collections.abc import Iterator

import torch
from torch import nn

from hugwbc.gait import Gait
from hugwbc.learned import distributed
from hugwbc.learned.config import PPOConfig
from hugwbc.learned.env.randomization import randn
from hugwbc.learned.env.readings import StepResult
from hugwbc.learned.policy.critic_observations import Observation
from hugwbc.learned.policy.networks import POLICY_HIDDEN, ActorCritic
from hugwbc.learned.policy.terms import Part
from hugwbc.robot import Robot

LEAST_SPREAD = 0.25
_LOG_TWO_PI = math.log(2.0 * math.pi)
_LOSSES = ("value_loss", "policy_loss", "estimation_loss", "kl")
_GROUPS = torch.tensor([min(gait, gait.mirrored()) for gait in Gait])  # of advantages: hops on either leg are alike


def log_probability(action: torch.Tensor, mean: torch.Tensor, log_std: torch.Tensor) -> torch.Tensor:
    """Return the log density of a diagonal Gaussian, summed over the joints, shape (n,)."""
    normal = (action - mean) * torch.exp(-log_std)
    return (-0.5 * normal.square() - log_std - 0.5 * _LOG_TWO_PI).sum(-1)


def kl_divergence(
    old_mean: torch.Tensor, old_log_std: torch.Tensor, mean: torch.Tensor, log_std: torch.Tensor
) -> torch.Tensor:
    """Return KL(old || new) of two diagonal Gaussians, summed over the joints, shape (n,)."""
    ratio = (old_log_std - log_std).exp()
    distance = (old_mean - mean) * torch.exp(-log_std)
    return (log_std - old_log_std + 0.5 * (ratio.square() + distance.square()) - 0.5).sum(-1)


def generalised_advantage(
    reward: torch.Tensor,
    done: torch.Tensor,
    disturbed: torch.Tensor,
    value: torch.Tensor,
    last_value: torch.Tensor,
    gamma: float,
    lam: float,
) -> torch.Tensor:
    """Return the generalised advantage estimates, shape (t, n).

    A_t = delta_t + gamma lam (1 - done_t) A_{t+1}, delta_t = r_t + gamma (1 - done_t) V_{t+1} - V_t, and A_t = 0 where
    the robot was disturbed. What a new command or a push does to the value is not due to an action: in the credit of
    the actions before, the value of the state just before it stands for all that follows.

    Args:
        reward: rewards, with gamma V(final observation) added where an episode ran out of time, shape (t, n).
        done: whether the episode ended after the step, shape (t, n), bool.
        disturbed: whether something came from outside in the step, shape (t, n), bool.
        value: value of the observation before the step, shape (t, n).
        last_value: value of the observation after the last step, shape (n,).
        gamma: discount per step.
        lam: trace decay lambda.
    """
    advantage = torch.zeros_like(value)
    following, running = last_value, torch.zeros_like(last_value)
    for t in reversed(range(len(reward))):
        going_on = (~done[t]).to(value.dtype)
        delta = reward[t] + gamma * going_on * following - value[t]
        running = (delta + gamma * lam * going_on * running) * ~disturbed[t]
        advantage[t], following = running, value[t]
    return advantage


def surrogate_loss(
    log_prob: torch.Tensor, old_log_prob: torch.Tensor, advantage: torch.Tensor, clip: float
) -> torch.Tensor:
    """Return PPO's clipped surrogate, negated: -mean min(r A, clip(r, 1 - c, 1 + c) A)."""
    ratio = (log_prob - old_log_prob).exp()
    return -torch.min(ratio * advantage, ratio.clamp(1.0 - clip, 1.0 + clip) * advantage).mean()


def explained_variance(value: torch.Tensor, returns: torch.Tensor) -> float:
    """Return 1 - var(R - V) / var(R): 1 for a critic that knows the returns, 0 for one that says the same of all."""
    return float(1.0 - (returns - value).var() / returns.var().clamp(min=1e-12))


def standardised(values: torch.Tensor, groups: torch.Tensor, count: int, clip: float = math.inf) -> torch.Tensor:
    """Standardise values by the mean and the standard deviation of their groups over all processes.

    Args:
        values: the values of this process, as many as in every other, shape (n,).
        groups: group of each value, from 0 to `count` - 1, shape (n,). The standard deviation of a group counts as at
            least `LEAST_SPREAD` of that of all values: where nothing is left to learn, the deviations are noise.
        count: number of groups.
        clip: distance from the mean of its group to which a value is clipped first [mean absolute deviations of the
            group].
    """

    def sums(numbers: torch.Tensor) -> torch.Tensor:
        return distributed.total(numbers.new_zeros(count).index_add_(0, groups, numbers))

    members = sums(torch.ones_like(values)).clamp(min=1.0)
    centred = values - (sums(values) / members)[groups]
    if math.isfinite(clip):
        bound = clip * (sums(centred.abs()) / members)[groups]
        values = torch.maximum(torch.minimum(centred, bound), -bound)
        centred = values - (sums(values) / members)[groups]
    whole = values - distributed.mean(values.mean())
    spread = (distributed.total(whole.square().sum()) / (distributed.size() * values.numel() - 1)).sqrt()
    spreads = (sums(centred.square()) / members).sqrt()
    return centred / (torch.maximum(spreads, LEAST_SPREAD * spread)[groups] + 1e-8)


@dataclasses.dataclass(eq=False)
class Rollout:
    """Experience of one iteration; all tensors have shape (horizon, n, ...).

    History, command and critic observation are in the coordinates of the networks (`ActorCritic.prepare`).
    """

    history: torch.Tensor
    command: torch.Tensor
    critic: torch.Tensor
    estimate: torch.Tensor
    action: torch.Tensor
    mean: torch.Tensor
    log_prob: torch.Tensor
    value: torch.Tensor
    reward: torch.Tensor
    done: torch.Tensor
    disturbed: torch.Tensor
    group: torch.Tensor

    @classmethod
    def empty(cls, horizon: int, seen: Observation, actions: int) -> "Rollout":
        """Allocate storage for `horizon` steps of robots that see observations like `seen` and have `actions`."""
        count, device = len(seen.history), seen.history.device
        sizes = {field.name: tuple(getattr(seen, field.name).shape[1:]) for field in dataclasses.fields(seen)}
        sizes |= {"action": (actions,), "mean": (actions,), "log_prob": (), "value": (), "reward": ()}
        tensors = {name: torch.empty(horizon, count, *size, device=device) for name, size in sizes.items()}
        done, disturbed = torch.zeros(2, horizon, count, dtype=torch.bool, device=device)
        group = torch.zeros(horizon, count, dtype=torch.long, device=device)
        return cls(**tensors, done=done, disturbed=disturbed, group=group)


class PPO:
    """The learner: networks, optimiser and the experience of one iteration.

    Attributes:
        network: actor, critic and exploration std.
        config: the settings, which may change between iterations.
        learning_rate: current learning rate of the actor, adapted to the KL divergence.
        skipped: number of gradient steps left out because a loss or gradient was not finite.
    """

    def __init__(
        self,
        config: PPOConfig,
        robot: Robot,
        generator: torch.Generator,
        further: tuple[Part, ...] = (),
        hidden: tuple[int, ...] = POLICY_HIDDEN,
    ) -> None:
        """Build networks and optimiser, on the device of the generator of exploration noise and minibatches.

        Args:
            config: the settings.
            robot: the robot.
            generator: source of exploration noise and minibatches.
            further: observation terms besides the paper's that the networks read.
            hidden: widths of the policy's hidden layers.
        """
        self.config = config
        self.device = generator.device
        self.network = ActorCritic(robot, config.std_initial, further=further, hidden=hidden).to(self.device)
        self.learning_rate = config.learning_rate
        critic = list(self.network.critic.parameters())
        actor = [p for name, p in self.network.named_parameters() if not name.startswith("critic.")]
        # The critic has its own rate: the KL lowers the actor's to 1e-5 at a small std, too slow for the critic.
        self.optimiser = torch.optim.Adam(
            [{"params": actor, "lr": self.learning_rate}, {"params": critic, "lr": config.critic_learning_rate}],
            fused=True,
        )
        self._groups = _GROUPS.to(self.device)
        self._rollout: Rollout | None = None
        self.skipped = 0
        self._generator = generator
        self.bound_std(0.0)

    def bound_std(self, steps: float) -> None:
        """Keep the exploration std of all joints between its bounds after a number of environment steps."""
        c = self.config
        progress = min(1.0, steps / c.std_steps)
        largest = min(c.std_limit, c.std_initial * (c.std_final / c.std_initial) ** progress)
        with torch.no_grad():
            self.network.log_std.clamp_(math.log(c.std_min), math.log(largest))

    # Acting ---------------------------------------------------------------------------------------------------------

    @property
    def rollout(self) -> Rollout:
        """The experience of the present iteration."""
        if self._rollout is None:
            raise RuntimeError("there is no experience yet: call act for step 0 first")
        return self._rollout

    @torch.no_grad()
    def act(self, t: int, observation: Observation, gait: torch.Tensor) -> torch.Tensor:
        """Sample actions for step t, shape (n, joints), and store what the update needs."""
        seen = self.network.prepare(observation)
        r, width = self._rollout, seen.critic.shape[1]  # rough ground adds columns for the critic
        if r is None or len(r.reward) != self.config.horizon or r.critic.shape[2] != width:
            self._rollout = Rollout.empty(self.config.horizon, seen, len(self.network.log_std))
        r = self.rollout
        for field in dataclasses.fields(seen):
            getattr(r, field.name)[t] = getattr(seen, field.name)
        r.group[t] = self._groups[gait]
        mean, _ = self.network.actor.prepared(r.history[t], r.command[t])
        noise = randn(self._generator, *mean.shape)
        log_std = self.network.exploration()
        action = mean + noise * log_std.exp()
        r.action[t], r.mean[t] = action, mean
        r.log_prob[t] = log_probability(action, mean, log_std)
        r.value[t] = self.network.critic.prepared(r.critic[t])
        return action

    @torch.no_grad()
    def record(self, t: int, result: StepResult) -> None:
        """Store the outcome of step t.

        An episode that only ran out of time would have gone on: the discounted value of its last observation stands
        for the rewards that it no longer collects.
        """
        self.rollout.reward[t], self.rollout.done[t] = result.reward, result.done
        self.rollout.disturbed[t] = result.disturbed
        if result.truncated.any():
            final = self.value(result.final.critic[result.truncated[result.done]])
            self.rollout.reward[t, result.truncated] += self.config.gamma * final

    @torch.no_grad()
    def value(self, critic_observation: torch.Tensor) -> torch.Tensor:
        """Return the values of critic observations as the environment gives them, shape (n,)."""
        return self.network.critic(critic_observation)

    # Learning -------------------------------------------------------------------------------------------------------

    def update(self, last: Observation, *, critic_only: bool = False) -> dict[str, float]:
        """Learn from the stored iteration; return mean losses and KL divergence, learning rate, std and other figures.

        Args:
            last: observation after the last step.
            critic_only: whether to leave the actor as it is.
        """
        for name, parameter in self.network.named_parameters():
            parameter.requires_grad_(name.startswith("critic.") or not critic_only)
        c, r = self.config, self.rollout
        with torch.no_grad():
            last_value = self.value(last.critic)
            advantage = generalised_advantage(r.reward, r.done, r.disturbed, r.value, last_value, c.gamma, c.lam)
        batch = {field.name: getattr(r, field.name).flatten(0, 1) for field in dataclasses.fields(r)}
        # Targets of the critic keep the scale of the rewards; only the advantages are standardised.
        batch["returns"] = advantage.flatten() + batch["value"]
        explained = explained_variance(batch["value"], batch["returns"])
        # By gait: over all, the rare falls of a hard gait would hide the small errors of an easy one.
        batch["advantage"] = standardised(advantage.flatten(), batch.pop("group"), len(_GROUPS), c.advantage_clip)
        old_log_std = self.network.exploration().detach().clone()
        sums: dict[str, float] = {}
        count = 0
        for rows in self._minibatches(advantage.numel()):
            # index_select takes a sixth of the time of value[rows].
            minibatch = {name: value.index_select(0, rows) for name, value in batch.items()}
            losses, applied = self._step(minibatch, old_log_std)
            if applied:
                sums = {name: sums.get(name, 0.0) + value for name, value in losses.items()}
                count += 1
            else:
                self.skipped += 1
        std = self.network.exploration().detach().exp()
        return {name: sums.get(name, math.nan) / max(count, 1) for name in _LOSSES} | {
            "learning_rate": self.learning_rate,
            "std": float(std.mean()),
            "explained_variance": explained,
            "skipped": float(self.skipped),
        }

    def _minibatches(self, samples: int) -> Iterator[torch.Tensor]:
        size = math.ceil(samples / self.config.minibatches)
        for _ in range(self.config.epochs):
            yield from torch.randperm(samples, generator=self._generator, device=self.device).split(size)

    def _step(self, b: dict[str, torch.Tensor], old_log_std: torch.Tensor) -> tuple[dict[str, float], bool]:
        """Take a gradient step on a minibatch; return its losses and whether the step was applied."""
        c, network = self.config, self.network
        mean, estimate = network.actor.prepared(b["history"], b["command"])
        log_std = network.exploration()
        value = network.critic.prepared(b["critic"])
        log_prob = log_probability(b["action"], mean, log_std)

        l_value = (value - b["returns"]).square().mean()
        l_policy = surrogate_loss(log_prob, b["log_prob"], b["advantage"], c.clip)
        l_estimation = (estimate - b["estimate"]).square().mean()
        entropy = log_std.sum()
        loss = l_value + c.policy_weight * l_policy + c.estimation_weight * l_estimation - c.entropy_weight * entropy

        with torch.no_grad():
            # The mean of all processes, so that their learning rates, and with them their networks, stay equal.
            kl = distributed.mean(kl_divergence(b["mean"], old_log_std, mean, log_std).mean())
        seen, applied = self._descend(loss, torch.stack([l_value, l_policy, l_estimation, kl]).detach())
        return dict(zip(_LOSSES, seen, strict=True)), applied

    def _descend(self, loss: torch.Tensor, figures: torch.Tensor) -> tuple[list[float], bool]:
        """Apply the gradient if it is finite; return the figures, the last of which is the KL, and whether it was."""
        self.optimiser.zero_grad()
        loss.backward()
        distributed.average_gradients(self.network.parameters())
        # Clip the two separately: a large error of the critic must not shorten the actor's step.
        parts = (group["params"] for group in self.optimiser.param_groups)
        norms = [nn.utils.clip_grad_norm_(part, self.config.max_grad_norm).to(loss) for part in parts]
        # The only place of a gradient step that waits for a GPU.
        *seen, total, first, second = torch.cat((figures, torch.stack([loss.detach(), *norms]))).tolist()
        # While the critic learns alone the policy does not move: a KL of zero says nothing about the rate.
        if self.network.log_std.requires_grad:
            self._adapt_learning_rate(seen[-1])
        # If one process skips the step, all must: their networks are equal.
        finite = not distributed.anywhere(not all(map(math.isfinite, (total, first, second))))
        if finite:
            self.optimiser.step()
        return seen, finite

    def _adapt_learning_rate(self, kl: float) -> None:
        """Keep the KL divergence of an update near its target: step less after a large one, more after a small one."""
        step = 1.5 if kl < 0.5 * self.config.target_kl else 1.0
        self.set_learning_rate(
            self.learning_rate / 1.5 if kl > 2.0 * self.config.target_kl else step * self.learning_rate
        )

    def set_learning_rate(self, rate: float) -> None:
        """Set the learning rate of the actor, within its range; that of the critic stays as configured."""
        low, high = self.config.learning_rate_range
        self.learning_rate = self.optimiser.param_groups[0]["lr"] = min(max(rate, low), high)

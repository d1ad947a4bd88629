"""DAgger: fitting a network to teachers on the student's own states; imitation and distillation build on it.

DAgger (Ross, Gordon, Bagnell, "A Reduction of Imitation Learning and Structured Prediction to No-Regret Online
Learning", AISTATS 2011): the teacher drives the robots at first, then the student does. In every state the teacher
names the action that it would take, and the student is fitted to all these labels. Cloning episodes of the teacher
alone does not work: the first small errors of the student lead to states that the teacher never visits.
"""

import abc
import time
from collections.abc import Callable
from typing import Any, Generic, TypeVar

import torch

from hugwbc.errors import ConfigError
from hugwbc.learned.config import DistillationConfig, ImitationConfig
from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.policy import observations as obs
from hugwbc.learned.policy.networks import ACTION_SIZE, ActorCritic
from hugwbc.learned.policy.observations import Observation
from hugwbc.learned.policy.policy_contract import settings_record, versions
from hugwbc.learned.rl.trainer import save_product

Config = TypeVar("Config", ImitationConfig, DistillationConfig)
Report = Callable[[dict[str, float]], None]


class Memory:
    """A ring buffer of the newest labelled observations.

    Attributes:
        size: number of samples in it.
    """

    def __init__(self, capacity: int, generator: torch.Generator) -> None:
        """Reserve the memory.

        Args:
            capacity: largest number of samples.
            generator: source of the batches.

        Raises:
            ConfigError: if the machine does not have that much memory.
        """
        self.size = 0
        self._next = 0
        self._generator = generator
        history = obs.HISTORY_FRAMES * obs.PROPRIOCEPTION_SIZE
        widths = {"history": history, "command": obs.COMMAND_SIZE, "estimate": obs.ESTIMATE_SIZE}
        widths |= {"action": ACTION_SIZE, "weight": ACTION_SIZE}
        try:
            self._columns = {name: torch.empty(capacity, width) for name, width in widths.items()}
        except RuntimeError as error:
            size = capacity * sum(widths.values()) * torch.finfo(torch.float32).bits // 8 / 2**30
            raise ConfigError(f"{capacity} labels take {size:.0f} GiB of memory; ask for fewer") from error

    def add(self, observation: Observation, action: torch.Tensor, weight: torch.Tensor) -> None:
        """Store one row per robot.

        Args:
            observation: what the student saw.
            action: the teacher's action, shape (n, 19).
            weight: weight of each joint in the loss, shape (n, 19).
        """
        capacity = len(self._columns["action"])
        # The oldest labels, of states that earlier drivers visited, are overwritten first.
        rows = (self._next + torch.arange(len(action))) % capacity
        values = (observation.history, observation.command, observation.estimate, action, weight)
        for column, value in zip(self._columns.values(), values, strict=True):
            column[rows] = value
        self._next = int(rows[-1] + 1) % capacity
        self.size = min(self.size + len(action), capacity)

    def columns(self) -> dict[str, torch.Tensor]:
        """Return all samples by column, in the order in which they are stored; live views."""
        return {name: column[: self.size] for name, column in self._columns.items()}

    def sample(self, count: int) -> dict[str, torch.Tensor]:
        """Draw random rows and mirror half of them: the robot is symmetric, so each label also holds mirrored."""
        rows = torch.randint(self.size, (count,), generator=self._generator)
        batch = {name: column[rows] for name, column in self._columns.items()}
        half = count // 2
        for name, mirror in (
            ("history", obs.mirror_history),
            ("command", obs.mirror_command_observation),
            ("estimate", obs.mirror_estimate),
            ("action", obs.mirror_action),
            ("weight", lambda weight: obs.mirror_action(weight).abs()),
        ):
            batch[name][:half] = mirror(batch[name][:half])
        return batch


class Dagger(abc.ABC, Generic[Config]):
    """A loop that collects labels of the states that robots visit, and fits the student to them.

    Attributes:
        config: the settings.
        env: the robots.
        network: the student; its critic is not trained.
        memory: the labels.
        samples: number of labels so far.
    """

    interval: int
    """Control steps between two rounds of fitting."""
    least_rate: float
    """Fraction of its initial value to which the learning rate falls."""

    def __init__(self, config: Config, network: ActorCritic, capacity: int) -> None:
        """Set up the robots and the memory.

        Args:
            config: the settings.
            network: the student.
            capacity: number of labels that are kept.
        """
        torch.set_num_threads(config.threads)
        self.config = config
        self.network = network
        self.env = HumanoidEnv(config.env, seed=config.seed, threads=config.threads)
        # Nobody updates the curriculum here: its levels stay as they are set.
        self.env.curriculum.alpha = config.noise_level
        self.env.curriculum.max_speed = config.max_speed
        self.samples = 0
        self._generator = torch.Generator().manual_seed(config.seed)
        self.memory = Memory(capacity, self._generator)
        self._optimiser = torch.optim.Adam(network.actor.parameters(), lr=config.learning_rate)

    @property
    def progress(self) -> float:
        """Fraction of the labels that are collected."""
        return self.samples / self.config.samples

    def run(self, report: Report) -> None:
        """Collect and fit until there are `config.samples` labels; write a policy and a snapshot to train from.

        Args:
            report: called after every round of fitting with its figures.
        """
        begin = time.monotonic()
        while self.samples < self.config.samples:
            falls = sum(self.collect() for _ in range(self.interval))
            steps = self.interval * self.env.count
            losses = self.fit()
            report({"samples": self.samples, "falls": falls, "steps": steps} | losses)
        record = {
            "seconds": time.monotonic() - begin,
            "versions": versions(),
            "config": settings_record(self.config),
        }
        save_product(self.config.out, self.network, self.config.env, self.metadata(record))

    @abc.abstractmethod
    def collect(self) -> int:
        """Advance all robots by one control step and store the labels; return how many robots fell."""

    @abc.abstractmethod
    def loss(self, action: torch.Tensor, label: torch.Tensor) -> torch.Tensor:
        """Return the loss of each joint; actions, labels and losses have shape (n, 19)."""

    @abc.abstractmethod
    def metadata(self, record: dict[str, Any]) -> dict[str, Any]:
        """Return what the policy and the snapshot say of their training.

        Args:
            record: duration, versions and settings of this run.
        """

    def _store(self, observation: Observation, label: torch.Tensor, weight: torch.Tensor) -> None:
        self.memory.add(observation, label, weight)
        self.samples += self.env.count

    @torch.no_grad()
    def _own_action(self, observation: Observation) -> torch.Tensor:
        action, _ = self.network.actor(observation.history, observation.command)
        return action

    def _exploration(self) -> torch.Tensor:
        # Noise pushes the robots off the path of their driver; the labels there show the way back.
        noise = torch.randn((self.env.count, ACTION_SIZE), generator=self._generator)
        return noise * self.config.exploration

    def fit(self) -> dict[str, float]:
        """Take gradient steps on random labels; return the mean losses."""
        c, actor = self.config, self.network.actor
        for group in self._optimiser.param_groups:
            group["lr"] = c.learning_rate * max(self.least_rate, 1.0 - self.progress)
        sums = {"imitation_loss": 0.0, "estimation_loss": 0.0}
        for _ in range(c.updates):
            batch = self.memory.sample(c.batch)
            mean, estimate = actor(batch["history"], batch["command"])
            # A joint has weight 0 where its label means nothing, such as arms that follow external targets.
            l_imitation = (batch["weight"] * self.loss(mean, batch["action"])).mean()
            l_estimation = (estimate - batch["estimate"]).square().mean()
            self._optimiser.zero_grad()
            (l_imitation + c.estimation_weight * l_estimation).backward()
            torch.nn.utils.clip_grad_norm_(actor.parameters(), 1.0)
            self._optimiser.step()
            sums["imitation_loss"] += float(l_imitation.detach()) / c.updates
            sums["estimation_loss"] += float(l_estimation.detach()) / c.updates
        return sums

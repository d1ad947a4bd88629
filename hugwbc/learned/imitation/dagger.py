"""Fitting a network to teachers on the student's own states, and what imitation and distillation share of it.

DAgger (Ross, Gordon, Bagnell, "A Reduction of Imitation Learning and Structured Prediction to No-Regret Online
Learning", AISTATS 2011): robots are driven by the student, after a beginning by the teacher; the teacher names the
action that it would take in every state, and the student is fitted to all of them. Cloning the teacher's own episodes
does not do: the student's first small errors lead to states that the teacher never visits.
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
    """The newest labelled observations.

    Attributes:
        size: how many there are.
    """

    def __init__(self, capacity: int, generator: torch.Generator) -> None:
        """Reserve the memory.

        Args:
            capacity: largest number of samples.
            generator: of the batches.

        Raises:
            ConfigError: if the machine has not that much memory.
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
        """Store a row per robot: what it saw, the teacher's action (n, 19) and the weight of each joint (n, 19)."""
        capacity = len(self._columns["action"])
        rows = (self._next + torch.arange(len(action))) % capacity
        values = (observation.history, observation.command, observation.estimate, action, weight)
        for column, value in zip(self._columns.values(), values, strict=True):
            column[rows] = value
        self._next = int(rows[-1] + 1) % capacity
        self.size = min(self.size + len(action), capacity)

    def sample(self, count: int) -> dict[str, torch.Tensor]:
        """Random rows, half of them as their mirror images: what is right on the left is right on the right."""
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
    """Collects labels of the states that robots visit, and fits the student to them.

    Attributes:
        config: the settings.
        env: the robots.
        network: the student; its critic stays as it starts.
        memory: the labels.
        samples: labels so far.
    """

    interval: int
    """Control steps between two rounds of fitting."""
    least_rate: float
    """To which part of its first value the learning rate falls."""

    def __init__(self, config: Config, network: ActorCritic, capacity: int) -> None:
        """Set up the robots and the memory.

        Args:
            config: the settings.
            network: the student.
            capacity: how many labels are kept.
        """
        torch.set_num_threads(config.threads)
        self.config = config
        self.network = network
        self.env = HumanoidEnv(config.env, seed=config.seed, threads=config.threads)
        self.env.curriculum.alpha = config.noise_level
        self.env.curriculum.max_speed = config.max_speed
        self.samples = 0
        self._generator = torch.Generator().manual_seed(config.seed)
        self.memory = Memory(capacity, self._generator)
        self._optimiser = torch.optim.Adam(network.actor.parameters(), lr=config.learning_rate)

    @property
    def progress(self) -> float:
        """Part of the work that is done."""
        return self.samples / self.config.samples

    def run(self, report: Report) -> None:
        """Collect and fit until there are `config.samples` labels; writes a policy and a snapshot to train from."""
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
        """One control step of all robots, and its labels; returns how many fell."""

    @abc.abstractmethod
    def loss(self, action: torch.Tensor, label: torch.Tensor) -> torch.Tensor:
        """Of each joint's error; actions, labels and losses have the shape (n, 19)."""

    @abc.abstractmethod
    def metadata(self, record: dict[str, Any]) -> dict[str, Any]:
        """What the policy and the snapshot say of their training.

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
        noise = torch.randn((self.env.count, ACTION_SIZE), generator=self._generator)
        return noise * self.config.exploration

    def fit(self) -> dict[str, float]:
        """Gradient steps on random labels; returns the mean losses."""
        c, actor = self.config, self.network.actor
        for group in self._optimiser.param_groups:
            group["lr"] = c.learning_rate * max(self.least_rate, 1.0 - self.progress)
        sums = {"imitation_loss": 0.0, "estimation_loss": 0.0}
        for _ in range(c.updates):
            batch = self.memory.sample(c.batch)
            mean, estimate = actor(batch["history"], batch["command"])
            l_imitation = (batch["weight"] * self.loss(mean, batch["action"])).mean()
            l_estimation = (estimate - batch["estimate"]).square().mean()
            self._optimiser.zero_grad()
            (l_imitation + c.estimation_weight * l_estimation).backward()
            torch.nn.utils.clip_grad_norm_(actor.parameters(), 1.0)
            self._optimiser.step()
            sums["imitation_loss"] += float(l_imitation.detach()) / c.updates
            sums["estimation_loss"] += float(l_estimation.detach()) / c.updates
        return sums

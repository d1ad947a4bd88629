"""DAgger: fitting a network to teachers on the student's own states; imitation and distillation build on it.

DAgger (Ross, Gordon, Bagnell, "A Reduction of Imitation Learning and Structured Prediction to No-Regret Online
Learning", AISTATS 2011): the teacher drives the robots at first, then the student does. In every state the teacher
names the action that it would take, and the student is fitted to all these labels. Cloning episodes of the teacher
alone does not work: the first small errors of the student lead to states that the teacher never visits.
"""

import abc
import contextlib
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Generic, TypeVar

import torch

from hugwbc.errors import ConfigError
from hugwbc.learned.config import DistillationConfig, ImitationConfig
from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.policy import observations as obs
from hugwbc.learned.policy.networks import ACTION_SIZE, ActorCritic
from hugwbc.learned.policy.observations import Observation
from hugwbc.learned.policy.records import settings_record, versions
from hugwbc.learned.rl.trainer import save_product
from hugwbc.learned.stopping import StoppedError, stopped_by_signals

Config = TypeVar("Config", ImitationConfig, DistillationConfig)
Report = Callable[[dict[str, float]], None]
_LEG_SEEDS = 1_000_003  # between the seeds of two legs


class Memory:
    """A ring buffer of the newest labelled observations.

    Attributes:
        size: number of samples in it.
        capacity: largest number of samples.
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
        self.capacity = capacity
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
        # The oldest labels, of states that earlier drivers visited, are overwritten first.
        rows = (self._next + torch.arange(len(action))) % self.capacity
        values = (observation.history, observation.command, observation.estimate, action, weight)
        for column, value in zip(self._columns.values(), values, strict=True):
            column[rows] = value
        self._next = int(rows[-1] + 1) % self.capacity
        self.size = min(self.size + len(action), self.capacity)

    def newest(self, count: int) -> dict[str, torch.Tensor]:
        """Return the columns of the newest `count` samples, oldest first; at most as many as the memory holds."""
        count = min(count, self.size)
        rows = (self._next - count + torch.arange(count)) % self.capacity
        return {name: column[rows] for name, column in self._columns.items()}

    def restore(self, parts: Iterable[dict[str, torch.Tensor]], before: int) -> None:
        """Put samples back where they were.

        Args:
            parts: columns of samples as `newest` returned them, in the order in which they were collected.
            before: number of samples that were collected before those of the parts.
        """
        capacity = self.capacity
        self._next, self.size = before % capacity, min(before, capacity)
        for part in parts:
            count = len(part["action"])
            rows = (self._next + torch.arange(count)) % capacity
            for name, column in self._columns.items():
                column[rows] = part[name]
            self._next = (self._next + count) % capacity
            self.size = min(self.size + count, capacity)

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

        Raises:
            ConfigError: if the environment has observation terms of other packages.
        """
        torch.set_num_threads(config.threads)
        self.config = config
        self.network = network
        if config.env.observations:
            raise ConfigError(
                "teachers have no observation terms of other packages; leave env.observations out here, and give it in "
                "the training that continues from the snapshot"
            )
        self.env = self._make_env(config.seed)
        self.samples = 0
        self._generator = torch.Generator().manual_seed(config.seed)
        self.memory = Memory(capacity, self._generator)
        self._optimiser = torch.optim.Adam(network.actor.parameters(), lr=config.learning_rate)

    def _make_env(self, seed: int) -> HumanoidEnv:
        env = HumanoidEnv(self.config.env, seed=seed, threads=self.config.threads)
        # Nobody updates the curriculum here: its levels stay as they are set.
        env.curriculum.alpha = self.config.noise_level
        env.curriculum.max_speed = self.config.max_speed
        return env

    @property
    def progress(self) -> float:
        """Fraction of the labels that are collected."""
        return self.samples / self.config.samples

    def run(self, report: Report) -> None:
        """Collect and fit until there are `config.samples` labels; write a policy and a snapshot to train from.

        SIGINT and SIGTERM end it after the current round of fitting; what was learnt so far is written.

        Args:
            report: called after every round of fitting with its figures.
        """
        begin = time.monotonic()
        with stopped_by_signals() as stop:

            def report_and_check(figures: dict[str, float]) -> None:
                report(figures)
                stop.check()

            with contextlib.suppress(StoppedError):
                self.advance(self.config.samples, report_and_check)
            self.write(time.monotonic() - begin)

    def advance(self, samples: float, report: Report) -> None:
        """Collect and fit until there are `samples` labels; `report` as for `run`."""
        while self.samples < samples:
            falls = sum(self.collect() for _ in range(self.interval))
            steps = self.interval * self.env.count
            losses = self.fit()
            report({"samples": self.samples, "falls": falls, "steps": steps} | losses)

    def write(self, seconds: float) -> None:
        """Write the policy and the snapshot.

        Args:
            seconds: how long it took [s], for the record.
        """
        record = {"seconds": seconds, "versions": versions(), "config": settings_record(self.config)}
        save_product(self.config.out, self.network, self.config.env, self.metadata(record))

    # Resting places: what follows one depends on `state` and the number of the leg alone, so that a run that was killed
    # goes on from the last one as if nothing had happened.

    def begin_leg(self, number: int) -> None:
        """Begin new episodes with random numbers of their own."""
        seed = self.config.seed + _LEG_SEEDS * number
        self._generator.manual_seed(seed)
        self.env = self._make_env(seed)

    def state(self) -> dict[str, torch.Tensor]:
        """Return what the next leg needs besides the memory."""
        tensors = {f"network.{name}": value for name, value in self.network.state_dict().items()}
        for index, state in self._optimiser.state_dict()["state"].items():
            tensors |= {f"optimiser.{index}.{name}": torch.as_tensor(value) for name, value in state.items()}
        return tensors | {"samples": torch.tensor(self.samples)}

    def load_state(self, tensors: Mapping[str, torch.Tensor]) -> None:
        """Restore what `state` returned."""
        self.samples = int(tensors["samples"])
        prefix = "network."
        self.network.load_state_dict({k[len(prefix) :]: v for k, v in tensors.items() if k.startswith(prefix)})
        state: dict[int, dict[str, torch.Tensor]] = {}
        for key, value in tensors.items():
            group, _, rest = key.partition(".")
            if group == "optimiser":
                index, _, name = rest.partition(".")
                state.setdefault(int(index), {})[name] = value.clone()
        groups = self._optimiser.state_dict()["param_groups"]
        self._optimiser.load_state_dict({"state": state, "param_groups": groups})

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

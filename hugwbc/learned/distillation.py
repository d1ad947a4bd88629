"""One network from several: each gait from the policy that does it best, on the student's own states.

As in `hugwbc.learned.imitation`, the student drives and its teachers name their actions (DAgger); the teachers are
policies, so that a label costs next to nothing. Standing can have two: one that is accurate while little moves, and one
that catches the robot when much does. The label goes smoothly from one to the other.
"""

import dataclasses
import json
import pathlib
import time
from collections.abc import Callable

import torch

from hugwbc.errors import ConfigError
from hugwbc.gait import Gait
from hugwbc.learned import checkpoint
from hugwbc.learned.config import DistillationConfig
from hugwbc.learned.contract import versions
from hugwbc.learned.env import HumanoidEnv, Observation
from hugwbc.learned.imitation import Memory
from hugwbc.learned.networks import ACTION_SIZE, ActorCritic
from hugwbc.learned.readings import Readings
from hugwbc.learned.train import save_product

# A standing robot is caught rather than held from about this speed, angular velocity or roll on, or a mixture.
CATCH_SPEED, CATCH_ANGULAR_VELOCITY, CATCH_ROLL = 0.25, 1.2, 0.2  # [m/s], [rad/s], [rad]
_CATCH_SHARPNESS = 5.0
_INTERVAL = 10  # control steps between two rounds of fitting

Report = Callable[[dict[str, float]], None]


def disturbance(readings: Readings) -> torch.Tensor:
    """How far robots are from rest, between 0 and 1, shape (n,); 0.5 at `CATCH_SPEED` alone."""
    motion = (
        torch.linalg.vector_norm(readings.velocity, dim=1) / CATCH_SPEED
        + torch.linalg.vector_norm(readings.angular_velocity, dim=1) / CATCH_ANGULAR_VELOCITY
        + readings.roll.abs() / CATCH_ROLL
    )
    return torch.sigmoid(_CATCH_SHARPNESS * (motion - 1.0))


class Distiller:
    """Collects the teachers' actions and fits the student.

    Attributes:
        env: the robots.
        network: the student; its critic stays as it starts.
        memory: the labels.
        samples: labels so far.
    """

    def __init__(self, config: DistillationConfig) -> None:
        """Load the teachers and set up robots and student.

        Raises:
            ConfigError: if a gait that is drawn has no teacher.
            PolicyFileError: if a snapshot cannot be read.
        """
        torch.set_num_threads(config.threads)
        torch.manual_seed(config.seed)
        self.config = config
        self.teachers = {name: _load(path)[0].actor for name, path in config.teachers().items()}
        self.network, self._metadata = _load(config.start_from)
        self.env = HumanoidEnv(config.env, seed=config.seed, threads=config.threads)
        self.env.curriculum.alpha = config.noise_level
        self.env.curriculum.max_speed = config.max_speed
        self.samples = 0
        self._generator = torch.Generator().manual_seed(config.seed)
        self.memory = Memory(config.memory, self._generator)
        self._optimiser = torch.optim.Adam(self.network.actor.parameters(), lr=config.learning_rate)
        self._arms = torch.as_tensor(self.env.robot.arms)

    @property
    def progress(self) -> float:
        """Part of the work that is done."""
        return self.samples / self.config.samples

    def run(self, report: Report) -> None:
        """Collect and fit until there are `config.samples` labels; writes a policy and a snapshot to train from."""
        begin = time.monotonic()
        while self.samples < self.config.samples:
            falls = sum(self.collect() for _ in range(_INTERVAL))
            figures = {
                "samples": float(self.samples),
                "falls": float(falls),
                "steps": float(_INTERVAL * self.env.count),
            }
            report(figures | self.fit())
        record = {
            "labels": self.samples,
            "seconds": time.monotonic() - begin,
            "versions": versions(),
            "config": json.loads(json.dumps(dataclasses.asdict(self.config), default=str)),
        }
        save_product(self.config.out, self.network, self.config.env, self._metadata | {"distillation": record})

    def collect(self) -> int:
        """One control step of all robots; returns how many fell."""
        env = self.env
        observation = env.observe()
        with torch.no_grad():
            own, _ = self.network.actor(observation.history, observation.command)
            label = self.label(observation)
        weight = torch.ones(env.count, ACTION_SIZE)
        # Arms under takeover do not follow the action: whatever a teacher says about them is untested.
        weight[env.intervention.active.nonzero(), self._arms] = 0.0
        self.memory.add(observation, label, weight)
        self.samples += env.count
        noise = torch.randn(own.shape, generator=self._generator) * self.config.exploration
        result = env.step(own + noise)
        return int(result.done.sum()) - len(result.timed_out)

    def label(self, observation: Observation) -> torch.Tensor:
        """What each robot's teacher would do, shape (n, 19)."""
        gait = self.env.gait
        label = torch.zeros(self.env.count, ACTION_SIZE)
        for name, actor in self.teachers.items():
            rows = _of(gait, name).nonzero().squeeze(1)
            if rows.numel():
                action, _ = actor(observation.history[rows], observation.command[rows])
                if name == "catching":
                    share = disturbance(self.env.readings)[rows, None]
                    action = share * action + (1.0 - share) * label[rows]
                label[rows] = action
        return label

    def fit(self) -> dict[str, float]:
        """Gradient steps on random labels; returns the mean losses."""
        c, actor = self.config, self.network.actor
        for group in self._optimiser.param_groups:
            group["lr"] = c.learning_rate * max(0.05, 1.0 - self.progress)
        sums = {"imitation_loss": 0.0, "estimation_loss": 0.0}
        for _ in range(c.updates):
            batch = self.memory.sample(c.batch)
            mean, estimate = actor(batch["history"], batch["command"])
            l_imitation = (batch["weight"] * (mean - batch["action"]).square()).mean()
            l_estimation = (estimate - batch["estimate"]).square().mean()
            self._optimiser.zero_grad()
            (l_imitation + c.estimation_weight * l_estimation).backward()
            torch.nn.utils.clip_grad_norm_(actor.parameters(), 1.0)
            self._optimiser.step()
            sums["imitation_loss"] += float(l_imitation.detach()) / c.updates
            sums["estimation_loss"] += float(l_estimation.detach()) / c.updates
        return sums


def _of(gait: torch.Tensor, teacher: str) -> torch.Tensor:
    """Which robots a teacher labels, shape (n,), bool."""
    if teacher == "hopping":
        return (gait == int(Gait.HOPPING_LEFT)) | (gait == int(Gait.HOPPING_RIGHT))
    return gait == int(Gait.STANDING if teacher == "catching" else Gait.parse(teacher))


def _load(path: pathlib.Path | None) -> tuple[ActorCritic, dict[str, object]]:
    if path is None:
        raise ConfigError("start_from is missing; give the snapshot of the network that the student starts as")
    tensors, metadata = checkpoint.load_file(path, "checkpoint")
    network = ActorCritic()
    prefix = "network."
    network.load_state_dict({k[len(prefix) :]: v for k, v in tensors.items() if k.startswith(prefix)})
    return network, metadata

"""The training loop: collect, learn, move curricula, log, save; stops and resumes cleanly."""

import copy
import math
import pathlib
import signal
import time
from collections.abc import Callable
from typing import Any

import torch

from hugwbc.errors import ConfigError
from hugwbc.learned import distributed
from hugwbc.learned.config import EnvConfig, TrainConfig
from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.policy import checkpoint
from hugwbc.learned.policy.networks import Actor, ActorCritic
from hugwbc.learned.policy.policy import POLICY_FILE, save_policy
from hugwbc.learned.policy.policy_contract import policy_contract, settings_record, versions
from hugwbc.learned.rl import trainer_state as train_state
from hugwbc.learned.rl.evaluator import SCORE, Evaluator
from hugwbc.learned.rl.ppo import PPO
from hugwbc.learned.rl.run_log import append_row, append_session, begin_log
from hugwbc.robot import load_robot
from hugwbc.sim.scene import TRAINING_TIMESTEP

CHECKPOINT_NAME = "checkpoint.safetensors"
SNAPSHOT_NAME = "snapshot.safetensors"
BEST_FOLDER = "best"
_SEED_STEP = 1_000_003  # between the seeds of two processes
MAX_DUMPS = 3  # of skipped minibatches in a run's folder; each takes some 20 MB

Report = Callable[[dict[str, float], dict[str, str]], None]


class Trainer:
    """A training run: environment, learner, counters; with torchrun, this process's part of it.

    Every process simulates its own robots; gradients, KL divergence, advantage moments and the averages that move the
    curricula are those of all. The first process evaluates, logs and saves; its figures are of its own robots.

    Attributes:
        iteration, steps, seconds: iterations, environment steps and wall-clock seconds so far, over all sessions.
        evaluation: figures of the last evaluation, with its iteration; empty before the first.
        best: the same of the best one, whose policy is in the folder `best`.
        leads: whether this is the first process.
    """

    def __init__(self, config: TrainConfig) -> None:
        """Set up; restore the latest checkpoint if `config.resume`, or another run's if `config.start_from`."""
        if config.device == "cuda":
            _claim_gpu()
        torch.set_num_threads(config.threads)
        torch.manual_seed(config.seed)
        self.config = config
        # The networks start equal in all processes; robots, commands and noise do not.
        own_seed = config.seed + _SEED_STEP * distributed.rank()
        self.leads = distributed.rank() == 0
        self.generator = torch.Generator().manual_seed(own_seed)
        self.env = HumanoidEnv(config.env, seed=own_seed, threads=config.threads, device=config.device)
        self.ppo = PPO(config.ppo, config.env.count, self.generator, config.device)
        self.ppo.on_skip = self._dump
        self.evaluator = self._make_evaluator()
        self.evaluation: dict[str, float] = {}
        self.best: dict[str, float] = {}
        self.iteration, self.steps, self.seconds = 0, 0, 0.0
        self.stop_requested = False
        if config.resume:
            train_state.restore(self, config.out / CHECKPOINT_NAME)
        elif config.start_from is not None:
            train_state.restore(self, config.start_from)
            self.best = {}  # the other run's: there is no such file in this run's folder
        self._actor_learns_from = self.iteration + config.critic_warm_up

    def run(self, report: Report) -> None:
        """Train until the limits of the configuration, or until asked to stop; saves at the end.

        Args:
            report: called after every iteration with figures and the gates' words.
        """
        start = time.monotonic()
        if self.leads:
            record = {"config": settings_record(self.config), "start_iteration": self.iteration}
            append_session(self.config.out, {"versions": versions(), **record})
            begin_log(self.config.out, self.iteration, resumed=self.config.resume)
        # What one process is told, or its clock says, all of them follow.
        while self.steps < self.config.steps and not distributed.anywhere(
            self.stop_requested or time.monotonic() - start >= 3600.0 * self.config.hours
        ):
            row = self.iterate() | self._evaluate()
            if self.leads:
                append_row(self.config.out, row, self.iteration)
                report(row, self.env.curriculum.gates)
            if self.iteration % self.config.save_interval == 0:
                self.save()
        self.save()

    def iterate(self) -> dict[str, float]:
        """One iteration: collect `horizon` steps, update, move the curricula. Returns its figures."""
        begin = time.monotonic()
        observation = self.env.observe()
        reward = 0.0
        for t in range(self.config.ppo.horizon):
            result = self.env.step(self.ppo.act(t, observation))
            self.ppo.record(t, result)
            reward += float(result.reward.mean()) / self.config.ppo.horizon
            observation = self.env.observe()
        collected = time.monotonic()
        losses = self.ppo.update(observation, critic_only=self.iteration < self._actor_learns_from)
        self.iteration += 1
        steps = self.config.ppo.horizon * self.config.env.count * distributed.size()
        self.steps += steps
        self.ppo.bound_std(self.steps)
        self.env.update_curriculum()
        elapsed = time.monotonic() - begin
        self.seconds += elapsed
        levels = self.env.curriculum
        return {
            "iteration": self.iteration,
            "steps": self.steps,
            "seconds": round(self.seconds, 1),
            "steps_per_second": steps / elapsed,
            "collect_fraction": (collected - begin) / elapsed,
            "reward": reward,
            "penalty_scale": levels.penalty_scale,
            "alpha": levels.alpha,
            "max_speed": levels.max_speed,
            **losses,
            **self.env.statistics.pop(),
        }

    def _actor(self) -> Actor:
        """The policy network on the CPU, where it is evaluated and saved."""
        actor = self.ppo.network.actor
        return actor if self.ppo.device.type == "cpu" else copy.deepcopy(actor).cpu()

    def _make_evaluator(self) -> Evaluator | None:
        c = self.config
        if not c.evaluation_interval or not self.leads:
            return None
        return Evaluator(c.env, count=c.evaluation_robots, seconds=c.evaluation_seconds, threads=c.threads)

    def _evaluate(self) -> dict[str, float]:
        """Figures of an evaluation if one is due, else the same names with NaN; the best policy is kept."""
        if self.evaluator is None:
            return {}
        if self.iteration % self.config.evaluation_interval:
            return dict.fromkeys(self.evaluator.names, math.nan)
        begin = time.monotonic()
        figures = self.evaluator.run(self._actor())
        finite = {name: value for name, value in figures.items() if math.isfinite(value)}
        self.evaluation = finite | {"iteration": self.iteration}
        if figures[SCORE] < self.best.get(SCORE, math.inf):
            self.best = self.evaluation
            self._save_product(self.config.out / BEST_FOLDER)
        self.seconds += time.monotonic() - begin
        return figures

    # Files ----------------------------------------------------------------------------------------------------------

    def save(self) -> None:
        """Write the checkpoint, its slim snapshot and the policy; other processes than the first their robots."""
        if not self.leads:
            path = distributed.own_path(self.config.out / CHECKPOINT_NAME)
            checkpoint.save_file(path, train_state.robots_of(self), "robots", {"iteration": self.iteration})
            return
        tensors = train_state.learner_of(self) | train_state.robots_of(self)
        checkpoint.save_file(self.config.out / CHECKPOINT_NAME, tensors, "checkpoint", train_state.metadata_of(self))
        self._save_product(self.config.out)

    def _save_product(self, folder: pathlib.Path) -> None:
        """Write policy and snapshot: what to ship, and what to continue from."""
        save_product(folder, self.ppo.network, self.config.env, train_state.metadata_of(self))

    def _dump(self, minibatch: dict[str, torch.Tensor], losses: dict[str, float]) -> None:
        """Keep a minibatch whose update was skipped, for the search after the cause."""
        dumps = len(list(self.config.out.glob("skipped-*.safetensors")))
        if dumps < MAX_DUMPS:
            record = {
                "iteration": self.iteration,
                "steps": self.steps,
                "losses": {k: str(v) for k, v in losses.items()},
            }
            path = distributed.own_path(self.config.out / f"skipped-{self.iteration}-{self.ppo.skipped}.safetensors")
            checkpoint.save_file(path, minibatch, "minibatch", record)


def contract_of(env: EnvConfig) -> dict[str, Any]:
    """The contract of a policy trained in an environment."""
    robot = load_robot()
    return policy_contract(
        period=TRAINING_TIMESTEP * env.substeps,
        action_scale=env.action_scales(robot),
        kd=env.damping(robot),
        waist_rate=env.waist_rate,
    )


def save_product(folder: pathlib.Path, network: ActorCritic, env: EnvConfig, metadata: dict[str, Any]) -> None:
    """Write a policy and the slim snapshot from which a training can go on.

    Args:
        folder: for both.
        network: what was learnt.
        env: the environment that it was learnt in.
        metadata: the training's record, anything JSON can hold.
    """
    # The snapshot leaves out optimiser moments and simulation states: small enough to ship with a policy.
    slim = {f"network.{name}": value for name, value in network.state_dict().items()}
    checkpoint.save_file(folder / SNAPSHOT_NAME, slim, "checkpoint", metadata)
    contract = contract_of(env)
    save_policy(folder / POLICY_FILE, copy.deepcopy(network.actor).cpu(), contract, metadata)


def train(config: TrainConfig, report: Report) -> Trainer:
    """Train by a configuration; SIGINT and SIGTERM end the run after the current iteration, with a checkpoint.

    Args:
        config: the run.
        report: called after every iteration with figures and the gates' words, in the first process only.

    Raises:
        ConfigError: if a new run would overwrite the one in its folder.
    """
    if not config.resume and (config.out / CHECKPOINT_NAME).exists():
        raise ConfigError(f"{config.out} holds a run already; --resume goes on with it, another --out starts a new one")
    with distributed.process_group("gloo" if config.device == "cpu" else "cpu:gloo,cuda:nccl"):
        trainer = Trainer(config)

        def request_stop(_signal: int, _frame: object) -> None:
            trainer.stop_requested = True

        previous = {s: signal.signal(s, request_stop) for s in (signal.SIGINT, signal.SIGTERM)}
        try:
            trainer.run(report)
        finally:
            for number, handler in previous.items():
                signal.signal(number, handler)
    return trainer


def _claim_gpu() -> None:
    """Make one GPU of the machine this process's.

    Raises:
        ConfigError: if torch finds none.
    """
    if not torch.cuda.is_available():
        raise ConfigError("device cuda needs an NVIDIA GPU and torch built for it; none was found. Use --device cpu")
    torch.cuda.set_device(distributed.local_rank())

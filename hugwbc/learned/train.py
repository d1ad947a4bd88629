"""The training loop: collect, learn, move curricula, log, save; stops and resumes cleanly."""

import csv
import dataclasses
import json
import os
import pathlib
import signal
import time
from collections.abc import Callable
from typing import Any

import torch

from hugwbc.errors import PolicyFileError
from hugwbc.learned import checkpoint
from hugwbc.learned.config import TrainConfig
from hugwbc.learned.contract import policy_contract, versions
from hugwbc.learned.env import HumanoidEnv
from hugwbc.learned.policy import POLICY_FILE, save_policy
from hugwbc.learned.ppo import PPO

CHECKPOINT_NAME = "checkpoint.safetensors"
SNAPSHOT_NAME = "snapshot.safetensors"
LOG_NAME = "metrics.csv"

Report = Callable[[dict[str, float], dict[str, str]], None]


class Trainer:
    """A training run: environment, learner, counters.

    Attributes:
        iteration, steps, seconds: iterations, environment steps and wall-clock seconds so far, over all sessions.
    """

    def __init__(self, config: TrainConfig) -> None:
        """Set up; restore the latest checkpoint if `config.resume`, or another run's if `config.start_from`."""
        torch.set_num_threads(config.threads)
        torch.manual_seed(config.seed)
        self.config = config
        self.generator = torch.Generator().manual_seed(config.seed)
        self.env = HumanoidEnv(config.env, seed=config.seed, threads=config.threads)
        self.ppo = PPO(config.ppo, config.env.count, self.generator)
        self.iteration, self.steps, self.seconds = 0, 0, 0.0
        self.stop_requested = False
        if config.resume:
            self.load(config.out / CHECKPOINT_NAME)
        elif config.start_from is not None:
            self.load(config.start_from)

    def run(self, report: Report) -> None:
        """Train until the limits of the configuration, or until asked to stop; saves at the end.

        Args:
            report: called after every iteration with figures and the gates' words.
        """
        start = time.monotonic()
        self._log_setup()
        while (
            self.steps < self.config.steps
            and time.monotonic() - start < 3600.0 * self.config.hours
            and not self.stop_requested
        ):
            row = self.iterate()
            self._append_log(row)
            report(row, self.env.curriculum.gates)
            if self.iteration % self.config.save_interval == 0:
                self.save()
        self.save()

    def iterate(self) -> dict[str, float]:
        """One iteration: collect `horizon` steps, update, move the curricula. Returns its figures."""
        begin = time.monotonic()
        observation = self.env.observe()
        for t in range(self.config.ppo.horizon):
            result = self.env.step(self.ppo.act(t, observation))
            self.ppo.record(t, result)
            observation = self.env.observe()
        collected = time.monotonic()
        losses = self.ppo.update(observation)
        self.iteration += 1
        self.steps += self.config.ppo.horizon * self.config.env.count
        self.ppo.bound_std(self.steps)
        self.env.update_curriculum()
        elapsed = time.monotonic() - begin
        self.seconds += elapsed
        levels = self.env.curriculum
        return {
            "iteration": self.iteration,
            "steps": self.steps,
            "seconds": round(self.seconds, 1),
            "steps_per_second": self.config.ppo.horizon * self.config.env.count / elapsed,
            "collect_fraction": (collected - begin) / elapsed,
            "reward": float(self.ppo.rollout.reward.mean()),
            "penalty_scale": levels.penalty_scale,
            "alpha": levels.alpha,
            "max_speed": levels.max_speed,
            **losses,
            **self.env.statistics.pop(),
        }

    # Files ----------------------------------------------------------------------------------------------------------

    def save(self) -> None:
        """Write the checkpoint, its slim snapshot and the policy."""
        tensors = {f"network.{k}": v for k, v in self.ppo.network.state_dict().items()}
        tensors |= {f"env.{k}": v for k, v in self.env.state_dict().items()}
        for index, state in self.ppo.optimiser.state_dict()["state"].items():
            tensors |= {f"optimiser.{index}.{k}": v for k, v in state.items()}
        tensors["generator"] = self.generator.get_state()
        checkpoint.save_file(self.config.out / CHECKPOINT_NAME, tensors, "checkpoint", self._metadata())
        # The snapshot leaves out optimiser moments and simulation states: small enough to ship with a policy.
        slim = {k: v for k, v in tensors.items() if k.startswith("network.")}
        checkpoint.save_file(self.config.out / SNAPSHOT_NAME, slim, "checkpoint", self._metadata())
        settings = self.config.env
        contract = policy_contract(
            period=self.env.dt, action_scale=settings.action_scale, waist_rate=settings.waist_rate
        )
        save_policy(self.config.out / POLICY_FILE, self.ppo.network.actor, contract, self._metadata())

    def load(self, path: pathlib.Path) -> None:
        """Continue from a checkpoint, or from a snapshot: episodes and optimiser moments then start anew.

        Raises:
            PolicyFileError: if the file cannot be used, or holds another number of robots.
        """
        tensors, metadata = checkpoint.load_file(path, "checkpoint")
        groups: dict[str, dict[str, torch.Tensor]] = {"network": {}, "env": {}, "optimiser": {}}
        for key, value in tensors.items():
            group, _, name = key.partition(".")
            if name:
                groups[group][name] = value
        try:
            self.ppo.network.load_state_dict(groups["network"])
        except RuntimeError as error:
            raise PolicyFileError(f"{path} has other networks than this version: {error}") from error
        stored = groups["env"].get("command")
        if stored is not None and stored.shape[0] != self.config.env.count:
            raise PolicyFileError(
                f"{path} holds {stored.shape[0]} robots, the configuration asks for {self.config.env.count}; "
                f"pass --env.count {stored.shape[0]}"
            )
        if stored is not None:
            try:
                self.env.load_state_dict(groups["env"])
                self.generator.set_state(tensors["generator"])
            except KeyError as error:
                raise PolicyFileError(
                    f"{path} lacks {error} of the environment's state; it was written by another version. "
                    "Continue from its snapshot instead"
                ) from error
        else:
            self.env.curriculum.load_state_dict(metadata["curriculum"])
        if groups["optimiser"]:
            self._load_optimiser(groups["optimiser"])
        self.iteration, self.steps = int(metadata["iteration"]), int(metadata["steps"])
        self.seconds = float(metadata["seconds"])
        self.ppo.learning_rate = float(metadata["learning_rate"])
        self.ppo.skipped = int(metadata["skipped"])
        self.ppo.bound_std(self.steps)

    def _load_optimiser(self, tensors: dict[str, torch.Tensor]) -> None:
        state: dict[int, dict[str, torch.Tensor]] = {}
        for key, value in tensors.items():
            index, _, name = key.partition(".")
            state.setdefault(int(index), {})[name] = value.clone()
        self.ppo.optimiser.load_state_dict(
            {"state": state, "param_groups": self.ppo.optimiser.state_dict()["param_groups"]}
        )

    def _metadata(self) -> dict[str, Any]:
        return {
            "iteration": self.iteration,
            "steps": self.steps,
            "seconds": self.seconds,
            "learning_rate": self.ppo.learning_rate,
            "skipped": self.ppo.skipped,
            "curriculum": self.env.curriculum.state_dict(),
            "versions": versions(),
            "config": json.loads(json.dumps(dataclasses.asdict(self.config), default=str)),
        }

    def _log_setup(self) -> None:
        self.config.out.mkdir(parents=True, exist_ok=True)
        record = {"versions": versions(), "config": self._metadata()["config"], "start_iteration": self.iteration}
        with (self.config.out / "sessions.jsonl").open("a") as file:
            file.write(json.dumps(record) + os.linesep)

    def _append_log(self, row: dict[str, float]) -> None:
        path = self.config.out / LOG_NAME
        if path.exists():
            with path.open(newline="") as file:
                header = next(csv.reader(file), [])
            if header != list(row):
                # Other rewards are on than in the session before: its figures keep their own file and columns.
                path.rename(path.with_stem(f"{path.stem}-until-{self.iteration - 1}"))
        new = not path.exists()
        with path.open("a", newline="") as file:
            writer = csv.DictWriter(file, fieldnames=list(row))
            if new:
                writer.writeheader()
            writer.writerow({name: f"{value:.6g}" for name, value in row.items()})


def train(config: TrainConfig, report: Report) -> Trainer:
    """Train by a configuration; SIGINT and SIGTERM end the run after the current iteration, with a checkpoint.

    Args:
        config: the run.
        report: called after every iteration with figures and the gates' words.
    """
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

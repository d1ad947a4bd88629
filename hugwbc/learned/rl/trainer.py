"""The training loop: collect, learn, move the curricula, log, save; it stops and resumes cleanly."""

import contextlib
import copy
import math
import pathlib
import time
from collections.abc import Callable
from typing import Any

import torch

from hugwbc.errors import ConfigError, PolicyFileError
from hugwbc.files import sole_writer, writing
from hugwbc.learned import distributed
from hugwbc.learned.config import EnvConfig, TrainConfig
from hugwbc.learned.config.environment import same_robots
from hugwbc.learned.distributed import Stop, stopped_by_signals
from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.env.randomization import restore as restore_generator
from hugwbc.learned.policy import checkpoint, save_policy
from hugwbc.learned.policy.network_files import POLICY_FILE, SNAPSHOT_FILE
from hugwbc.learned.policy.networks import Actor, ActorCritic, load_into, policy_widths
from hugwbc.learned.policy.records import (
    append_row,
    append_session,
    begin_log,
    check_robot,
    robot_label,
    settings_record,
    versions,
)
from hugwbc.learned.rl.continuation import (
    by_group,
    check_observations,
    check_unchanged,
    differences,
    readable,
    robot_digest,
    with_robots_of_rank,
)
from hugwbc.learned.rl.evaluator import SCORE, Evaluator
from hugwbc.learned.rl.ppo import PPO

CHECKPOINT_NAME = "checkpoint.safetensors"
BEST_FOLDER = "best"
RECIPE_NAME = "recipe.yaml"  # in the folder of a recipe's run, which has a folder for each stage
_SEED_STEP = 1_000_003  # between the seeds of two processes
_ANEW = "{}: other processes lack the file of their robots at this iteration; these begin new episodes, with new draws"

Report = Callable[[dict[str, float], dict[str, str]], None]


class Trainer:
    """A training run: environment, learner and counters; under torchrun, this process's part of the run.

    Every process simulates its own robots. Gradients, KL divergence, moments of the advantages and the averages that
    move the curricula are those of all processes. The first process evaluates, logs and saves; the others save their
    robots only. The figures in the log are those of the robots of the first process.

    Attributes:
        iteration, steps, seconds: iterations, environment steps and wall-clock seconds so far, over all sessions, those
            of the run that this one starts from included.
        begin: iteration and steps at which this run began.
        evaluation: figures of the last evaluation, its iteration and its steps; empty before the first.
        best: the same of the best evaluation, whose policy is in the folder `best`.
        product: the networks that are evaluated and given out: an exponential moving average (EMA) of the learner's,
            with the time constant `config.average_steps`.
        leads: whether this is the first process.
        device: where it computes.
        stop: the request to stop; it is checked before every iteration.
        remark: what a user should know about the run that this one starts from; usually empty.
    """

    def __init__(self, config: TrainConfig) -> None:
        """Set up; restore the latest checkpoint if `config.resume`, or another run's if `config.start_from`."""
        self.device = distributed.claim_device(config.device)
        torch.set_num_threads(config.threads)
        torch.manual_seed(config.seed)
        self.config = config
        path = config.out / CHECKPOINT_NAME if config.resume else config.start_from
        tensors, metadata = ({}, {}) if path is None else checkpoint.load_file(path, "checkpoint")
        self.iteration, self.steps, self.seconds = 0, 0, 0.0
        self.begin = {"iteration": 0, "steps": 0}
        if path is not None:
            self._read_counters(metadata, path)
            if config.resume:
                check_unchanged(metadata, config, path)
                if (before := metadata.get("processes", 1)) != distributed.size():
                    here = f"{path} is of {before} processes (here {distributed.size()})"
                    raise ConfigError(f"{here}; give --processes {before}")
            with readable(path):
                before = metadata["config"]["env"].get("robot", config.env.robot)
            if robot_label(before) != robot_label(config.env.robot):
                check_robot(str(path), before, config.env.robot)
            check_observations(metadata, config.env, path)
        now = config.at(self.run_steps)
        # The networks start equal in all processes; robots, commands and noise must not.
        self._seed = config.seed + _SEED_STEP * distributed.rank()
        self.leads = distributed.rank() == 0
        self.env = self._robots(now.env)
        # Another stream than the environment's, whose draws would otherwise be those of the exploration.
        self.generator = torch.Generator(self.env.device).manual_seed(self._seed + 1)
        self.ppo = PPO(now.ppo, self.env.robot, self.generator, self.env.further, policy_widths(tensors))
        self.product = copy.deepcopy(self.ppo.network)
        self.evaluator = self._make_evaluator()
        self.evaluation: dict[str, float] = {}
        self.best: dict[str, float] = {}
        self._evaluated = self.run_steps  # at the last evaluation
        self.stop = Stop()
        self.remark = ""
        if path is not None:
            self._restore(tensors, metadata, path)

    @property
    def run_steps(self) -> int:
        """Environment steps of this run alone."""
        return self.steps - self.begin["steps"]

    def _robots(self, config: EnvConfig) -> HumanoidEnv:
        self._env_config = config
        return HumanoidEnv(config, seed=self._seed, threads=self.config.threads, device=self.device)

    # Training -------------------------------------------------------------------------------------------------------

    def run(self, report: Report) -> None:
        """Train until the limits of the configuration or until stopped, and save at the end.

        Args:
            report: called in the first process after every iteration, with the figures and the gates' words; the figure
                `progress` is the share of this session that is over, by steps or by hours, whichever is larger.
        """
        start, first, hours = time.monotonic(), self.run_steps, self.config.hours
        if self.leads:
            record = {"config": settings_record(self.config), "start_iteration": self.iteration}
            append_session(self.config.out, {"versions": versions(), "device": self.device, **record})
            begin_log(self.config.out, self.iteration, resumed=self.config.resume)
        # A signal or a clock of one process must stop all of them in the same iteration: they wait for each other.
        while self.run_steps < self.config.steps and not distributed.anywhere(
            self.stop.requested or time.monotonic() - start >= 3600.0 * hours
        ):
            best = self.best
            row = self.iterate() | self._evaluate()
            if self.leads:
                with writing(self.config.out):
                    append_row(self.config.out, row)
                by_steps = (self.run_steps - first) / (self.config.steps - first)
                by_hours = (time.monotonic() - start) / (3600.0 * hours)
                report(row | {"progress": min(1.0, max(by_steps, by_hours))}, self.env.curriculum.gates)
            # With a new best policy too: a run that is cut off would go on with the figures of an earlier one.
            if self.iteration % self.config.save_interval == 0 or distributed.anywhere(self.best is not best):
                self.save()
        self.save()

    def iterate(self) -> dict[str, float]:
        """Collect `horizon` control steps, update the networks, move the curricula; return the iteration's figures."""
        begin = time.monotonic()
        self._adopt_schedules()
        observation = self.env.observe()
        reward = torch.zeros((), dtype=torch.float64, device=self.env.device)
        horizon = self.ppo.config.horizon
        for t in range(horizon):
            result = self.env.step(self.ppo.act(t, observation, self.env.gait))
            self.ppo.record(t, result)
            reward += result.reward.mean().double() / horizon
            observation = self.env.observe()
        collected = time.monotonic()
        critic_only = self.iteration - self.begin["iteration"] < self.config.critic_warm_up
        losses = self.ppo.update(observation, critic_only=critic_only)
        self.iteration += 1
        steps = horizon * self.config.env.count * distributed.size()
        # The curricula count steps, so that they do not depend on the length of an iteration.
        each = self.config.env.curriculum.steps
        for _ in range((self.steps + steps) // each - self.steps // each):
            self.env.update_curriculum()
        self.steps += steps
        self.ppo.bound_std(self.steps)
        self._average(steps)
        elapsed = time.monotonic() - begin
        self.seconds += elapsed
        levels = self.env.curriculum
        if fault := self.env.simulation.faults():
            levels.gates["physics"] = fault
        if fault := self.env.statistics.faults():
            levels.gates["rewards"] = fault
        return {
            "iteration": self.iteration,
            "steps": self.steps,
            "seconds": round(self.seconds, 1),
            "steps_per_second": steps / elapsed,
            "collect_fraction": (collected - begin) / elapsed,
            "reward": float(reward),
            "penalty_scale": levels.penalty_scale,
            "alpha": levels.alpha,
            "max_speed": levels.max_speed,
            **losses,
            **self.env.statistics.pop(),
            **self.env.levels,
        }

    def _adopt_schedules(self) -> None:
        """Give learner and environment the settings of the present number of steps."""
        if not self.config.schedules:
            return
        now = self.config.at(self.run_steps)
        self.ppo.config = now.ppo
        if same_robots(self._env_config, now.env):
            self.env.adopt(now.env)
        else:
            state = self.env.state_dict()
            self.env = self._robots(now.env)
            self.env.load_state_dict(state)
        self._env_config = now.env

    @torch.no_grad()
    def _average(self, steps: int) -> None:
        """Let the product, the EMA of the learner's weights, follow them for a number of environment steps."""
        share = min(1.0, steps / max(self.config.average_steps, 1.0))
        for mean, learnt in zip(self.product.parameters(), self.ppo.network.parameters(), strict=True):
            mean.lerp_(learnt, share)

    def _make_evaluator(self) -> Evaluator | None:
        c = self.config
        if not c.evaluation_steps or not self.leads:
            return None
        # In the environment of the end, so that all evaluations of a run compare.
        return Evaluator(
            c.at(c.steps).env,
            count=c.evaluation_robots,
            seconds=c.evaluation_seconds,
            threads=c.threads,
            timestep=c.evaluation_timestep,
        )

    def _evaluate(self) -> dict[str, float]:
        """Return the figures of an evaluation, NaN where none is due, and keep the best policy."""
        if self.evaluator is None:
            return {}
        every, steps = self.config.evaluation_steps, self.run_steps
        over = steps >= self.config.steps
        if not over and steps // every == self._evaluated // every:
            return dict.fromkeys(self.evaluator.names, math.nan)
        begin, self._evaluated = time.monotonic(), steps
        self.evaluator.adopt(self.env.config)
        figures = self.evaluator.run(_runnable(self.product))
        finite = {name: value for name, value in figures.items() if math.isfinite(value)}
        self.evaluation = finite | {"iteration": self.iteration, "steps": self.steps}
        if figures[SCORE] < self.best.get(SCORE, math.inf):
            self.best = self.evaluation
            save_product(self.config.out / BEST_FOLDER, self.product, self.env.config, self._metadata())
        self.seconds += time.monotonic() - begin
        return figures

    # Saving ---------------------------------------------------------------------------------------------------------

    def save(self) -> None:
        """Write checkpoint, snapshot and policy; processes other than the first write their robots only."""
        path = distributed.rank_path(self.config.out / CHECKPOINT_NAME)
        with writing(path):
            if not self.leads:
                checkpoint.save_file(path, self._robot_tensors(), "robots", {"iteration": self.iteration})
                return
            tensors = self._learner_tensors() | self._robot_tensors()
            checkpoint.save_file(path, tensors, "checkpoint", self._metadata())
        save_product(self.config.out, self.product, self.env.config, self._metadata())

    def _learner_tensors(self) -> dict[str, torch.Tensor]:
        """Return the part of a checkpoint that all processes have in common: networks and optimiser."""
        tensors = {f"network.{k}": v for k, v in self.ppo.network.state_dict().items()}
        if self.config.average_steps:
            tensors |= {f"product.{k}": v for k, v in self.product.state_dict().items()}
        for index, state in self.ppo.optimiser.state_dict()["state"].items():
            tensors |= {f"optimiser.{index}.{k}": v for k, v in state.items()}
        return tensors

    def _robot_tensors(self) -> dict[str, torch.Tensor]:
        """Return the part of a checkpoint that belongs to this process alone."""
        robots = {f"env.{name}": value for name, value in self.env.state_dict().items()}
        return robots | {"generator": self.generator.get_state()}

    def _metadata(self) -> dict[str, Any]:
        """Return what a checkpoint, a snapshot and a policy say of their training, in a form that JSON can hold."""
        return {
            "iteration": self.iteration,
            "steps": self.steps,
            "seconds": self.seconds,
            "begin": self.begin,
            "learning_rate": self.ppo.learning_rate,
            "skipped": self.ppo.skipped,
            "curriculum": self.env.curriculum.state_dict(),
            "evaluation": self.evaluation,
            "best": self.best,
            "versions": versions(),
            "processes": distributed.size(),
            "config": settings_record(self.config),
            "robot": robot_digest(self.config),
        }

    # Restoring ------------------------------------------------------------------------------------------------------

    def _read_counters(self, metadata: dict[str, Any], path: pathlib.Path) -> None:
        with readable(path):
            self.iteration, self.steps = int(metadata["iteration"]), int(metadata["steps"])
            self.seconds = float(metadata["seconds"])
            here = {"iteration": self.iteration, "steps": self.steps}
            self.begin = {name: int(metadata["begin"][name]) for name in here} if self.config.resume else here

    def _restore(self, tensors: dict[str, torch.Tensor], metadata: dict[str, Any], path: pathlib.Path) -> None:
        """Continue from a checkpoint, or from a snapshot with new episodes and empty moments of the optimiser."""
        if not self.leads:
            tensors = with_robots_of_rank(tensors, path, metadata.get("iteration"))
        anew = self.config.resume and distributed.anywhere("generator" not in tensors)
        groups = by_group(tensors, path)
        try:
            load_into(self.ppo.network, groups["network"])
            load_into(self.product, groups["product"] or groups["network"])
        except (RuntimeError, KeyError) as error:
            raise PolicyFileError(f"{path} has other networks than this version: {error}") from error
        if groups["env"]:
            self._restore_robots(groups["env"], tensors, path)
        if groups["optimiser"]:
            self._restore_optimiser(groups["optimiser"])
        with readable(path):
            if not groups["env"]:
                self.env.restore_levels(metadata["curriculum"])
            self.ppo.set_learning_rate(float(metadata["learning_rate"]))
            self.ppo.skipped = int(metadata["skipped"])
            self.remark = _ANEW.format(path) if anew else differences(metadata, self._env_config, path)
            if self.config.resume:  # the evaluations of another run are of policies in another folder
                self.evaluation, best = dict(metadata["evaluation"]), dict(metadata["best"])
                before, now = (self.config.at(float(n)).env for n in (metadata["config"]["steps"], self.config.steps))
                kept = (self.config.out / BEST_FOLDER / POLICY_FILE).exists()
                self.best = best if kept and before == now else {}  # scores of other environments do not compare
        if not self.config.resume:
            self.ppo.bound_std(self.steps)
            if groups["env"]:  # otherwise the generators would go on with the other run's seed
                self.env.generator.manual_seed(self._seed)
                self.generator.manual_seed(self._seed + 1)

    def _restore_robots(
        self, state: dict[str, torch.Tensor], tensors: dict[str, torch.Tensor], path: pathlib.Path
    ) -> None:
        try:
            stored, count = len(state["command"]), self.config.env.count
            if stored == count:
                self.env.load_state_dict(state)
                restore_generator(self.generator, tensors["generator"])
        except (KeyError, TypeError, ValueError, RuntimeError) as error:
            raise PolicyFileError(
                f"{path} does not hold the environment's state as this version has it ({error}); it was written "
                "by another version. Continue from its snapshot instead"
            ) from error
        if stored != count:
            raise PolicyFileError(
                f"{path} holds {stored} robots, the configuration asks for {count}; pass --env.count {stored}"
            )

    def _restore_optimiser(self, tensors: dict[str, torch.Tensor]) -> None:
        state: dict[int, dict[str, torch.Tensor]] = {}
        for key, value in tensors.items():
            index, _, name = key.partition(".")
            state.setdefault(int(index), {})[name] = value.clone()
        optimiser = self.ppo.optimiser
        parameters = [p for group in optimiser.param_groups for p in group["params"]]
        if any(moment.dim() and moment.shape != parameters[i].shape for i, m in state.items() for moment in m.values()):
            raise PolicyFileError(
                "the checkpoint's network reads other observation terms than env.observations names; continue from its "
                "snapshot"
            )
        optimiser.load_state_dict({"state": state, "param_groups": optimiser.state_dict()["param_groups"]})


def _runnable(network: ActorCritic) -> Actor:
    """Return the policy in the form in which it runs, on the CPU."""
    return copy.deepcopy(network.actor).cpu().plain()


def save_product(folder: pathlib.Path, network: ActorCritic, env: EnvConfig, metadata: dict[str, Any]) -> None:
    """Write a policy, and the snapshot from which a training can continue."""
    # The snapshot leaves out optimiser moments and simulation states: small enough to ship with a policy.
    slim = {f"network.{name}": value for name, value in network.state_dict().items()}
    with writing(folder):
        checkpoint.save_file(folder / SNAPSHOT_FILE, slim, "checkpoint", metadata)
        save_policy(folder / POLICY_FILE, _runnable(network), env.contract(), metadata)


def train(config: TrainConfig, report: Report, notice: Callable[[str], object] = print) -> Trainer:
    """Train by a configuration; SIGINT, SIGTERM and SIGHUP end the run after the current iteration, with a checkpoint.

    Args:
        config: settings of the run.
        report: called after every iteration with the figures and the gates' words, in the first process only.
        notice: called with the trainer's remark, if it has one, in the first process only.

    Raises:
        ConfigError: if the folder holds a run but `resume` is not set, no run but it is set, or the run of a recipe.
    """
    begun = (config.out / CHECKPOINT_NAME).exists()
    if begun and not config.resume:
        raise ConfigError(f"{config.out} already holds a run; --resume continues it, another --out starts a new one")
    if config.resume and not begun:
        raise ConfigError(f"{config.out} holds no run to resume; give the --out of one, or leave out --resume")
    if (config.out / RECIPE_NAME).exists():
        raise ConfigError(f"{config.out} holds the run of a recipe; give another --out")
    with distributed.process_group():
        trainer = Trainer(config)
        if trainer.remark and trainer.leads:
            notice(trainer.remark)
        alone = sole_writer(config.out) if trainer.leads else contextlib.nullcontext()
        with alone, stopped_by_signals() as trainer.stop:
            trainer.run(report)
    return trainer

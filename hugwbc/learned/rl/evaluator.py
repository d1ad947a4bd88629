"""A short evaluation inside the training: no exploration noise, and the same commands every time."""

import dataclasses
import math

import torch

from hugwbc.commands import COMMAND_NAMES
from hugwbc.gait import Gait
from hugwbc.learned.config import EnvConfig
from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.env.readings import TRACKED, tracked
from hugwbc.learned.policy.networks import Actor
from hugwbc.seeds import SELECTION_SEED

# Errors that weigh the same in the score, of the size of the paper's errors of walking [m/s, rad/s, m, rad].
ERROR_SCALES = dict(zip(TRACKED, (0.1, 0.1, 0.1, 0.05, 0.05, 0.05), strict=True))
FALL_COST = 20.0  # added to the score if every robot falls: more than any error of a robot that stays up
SETTLE = 1.0  # [s] at the start that do not count in the errors
SCORE = "evaluation/score"
_FALLS = "evaluation/falls"
_NEVER = 2**30  # control steps
_COLUMNS = [COMMAND_NAMES.index(name) for name in ERROR_SCALES]


class Evaluator:
    """Robots that repeat the same episodes at every evaluation.

    Commands, gaits and model parameters are drawn once, as training draws them, over the initial ranges. There are no
    pushes, no observation noise and no intervention; rough ground has all levels; a command lasts the whole episode.
    All random numbers are the evaluator's own, so that the training continues as if there had been no evaluation.
    """

    def __init__(self, config: EnvConfig, *, count: int, seconds: float, threads: int) -> None:
        """Build the robots.

        Args:
            config: environment of the training.
            count: number of robots.
            seconds: length of the episodes [s].
            threads: threads of the simulation.
        """
        calm = dataclasses.replace(config.randomization, noise=0.0, push_velocity=0.0)
        every_level = dataclasses.replace(config.terrain, start_level=config.terrain.levels - 1)
        settings = dataclasses.replace(
            config,
            count=count,
            episode_steps=_NEVER,
            flip_probability=0.0,
            randomization=calm,
            terrain=every_level,
            command=dataclasses.replace(config.command, resample_steps=_NEVER),
        )
        self._env = HumanoidEnv(settings, seed=SELECTION_SEED, threads=threads)
        self._env.age.zero_()
        self._start = {name: tensor.clone() for name, tensor in self._env.state_dict().items()}
        self._steps = math.ceil(seconds / self._env.dt)
        self._settle = min(math.ceil(SETTLE / self._env.dt), self._steps - 1)
        self._gaits = [Gait(int(value)) for value in self._env.gait.unique()]

    @property
    def names(self) -> list[str]:
        """Names of the figures that `run` returns."""
        return [SCORE, _FALLS, *(f"evaluation/{gait.label}/{name}" for gait in self._gaits for name in ERROR_SCALES)]

    @torch.no_grad()
    def run(self, actor: Actor) -> dict[str, float]:
        """Return the mean absolute errors of each gait, the fraction of falls, and one score; lower is better.

        The score is the mean over gaits of the mean over commands of error / `ERROR_SCALES`, plus `FALL_COST` times
        the fraction of robots that fell. The errors of a robot count until it falls; an error without samples is NaN.

        Args:
            actor: the policy network.
        """
        env = self._env
        env.load_state_dict(self._start)
        command, gait = env.command.clone(), env.gait.clone()
        upright = torch.ones(env.count, dtype=torch.bool)
        sums, samples = torch.zeros(env.count, len(_COLUMNS)), torch.zeros(env.count)
        for step in range(self._steps):
            observation = env.observe()
            action, _ = actor(observation.history, observation.command)
            upright &= ~env.step(action).done
            if step >= self._settle:
                # A robot that fell has restarted under another command: it no longer counts.
                error = (tracked(env.readings, env.robot.waist) - command[:, _COLUMNS]).abs()
                sums += torch.where(upright[:, None], error, 0.0)
                samples += upright
        env.statistics.pop()
        return self._figures(gait, sums, samples, float((~upright).float().mean()))

    def _figures(self, gait: torch.Tensor, sums: torch.Tensor, samples: torch.Tensor, falls: float) -> dict[str, float]:
        scales = torch.tensor(list(ERROR_SCALES.values()))
        figures, scores = {}, []
        for one in self._gaits:
            chosen = gait == one
            errors = sums[chosen].sum(0) / samples[chosen].sum()
            figures |= {
                f"evaluation/{one.label}/{name}": float(error) for name, error in zip(ERROR_SCALES, errors, strict=True)
            }
            if bool(torch.isfinite(errors).all()):
                scores.append(float((errors / scales).mean()))
        score = FALL_COST * falls + (sum(scores) / len(scores) if scores else 0.0)
        return {SCORE: score, _FALLS: falls, **figures}

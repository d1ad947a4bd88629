"""A short evaluation inside the training: no exploration noise, and the same commands every time."""

import dataclasses
import math
from collections.abc import Callable, Mapping

import torch

from hugwbc.commands import COMMAND_NAMES, MEASURED_NAMES
from hugwbc.gait import Gait, held, hopping
from hugwbc.learned.config import EnvConfig, LoadConfig
from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.env.readings import Readings, command_errors, feet_on_ground, held_foot_down
from hugwbc.settings import SELECTION_SEED

# Errors that weigh the same in the score, of the size of the paper's errors of walking [m/s, rad/s, m, rad].
ERROR_SCALES = dict(zip(MEASURED_NAMES, (0.1, 0.1, 0.1, 0.05, 0.05, 0.05), strict=True))
# The same of the steps of a gait: stride frequency [Hz], swing height [m], share of the time with the held foot down,
# speed of descent of a sole before it touches the ground [m/s].
GAIT_SCALES = {"f": 0.1, "l": 0.05, "held_foot": 0.05, "impact": 1.0}
FALL_COST = 20.0  # added to the score if every robot falls: more than any error of a robot that stays up
SETTLE = 1.0  # [s] at the start that do not count in the errors
SCORE = "evaluation/score"
_FALLS = "evaluation/falls"
_SHORTEST_FLIGHT = 2  # control steps off the ground before a contact counts as a touch-down
_NEVER = 2**30  # control steps
_ROUNDING = 1e-6  # of a number of time steps
_F, _L = COMMAND_NAMES.index("f"), COMMAND_NAMES.index("l")


class _Steps:
    """Motion of the feet of n robots: touch-downs, heights of the swings, speeds before the ground, held feet."""

    FIGURES = ("f", "l", "impact", "held_foot")

    def __init__(self, command: torch.Tensor, gait: torch.Tensor, dt: float) -> None:
        """Take the commands, shape (n, 8), and values of `Gait`, shape (n,), of an evaluation."""
        self._command, self._gait, self._dt = command, gait, dt
        self._swings = ~held(gait) & (gait != int(Gait.STANDING))[:, None]
        shape = self._swings.shape
        self._airborne, self._apex, self._descent = (torch.zeros(shape) for _ in range(3))
        self._first, self._last = torch.full(shape, math.nan), torch.full(shape, math.nan)
        self._landings, self._height_error, self._impact = (torch.zeros(shape) for _ in range(3))
        self._down, self._samples = torch.zeros(len(gait)), torch.zeros(len(gait))

    def add(self, readings: Readings, upright: torch.Tensor) -> None:
        """Add the next control step of the robots that are upright, (n,), bool; a fallen robot never counts again."""
        self._samples += upright
        on_ground = feet_on_ground(readings.foot_force)
        landed = on_ground & (self._airborne >= _SHORTEST_FLIGHT) & self._swings & upright[:, None]
        time = (self._samples * self._dt)[:, None].expand_as(self._first)
        self._first = torch.where(landed & self._first.isnan(), time, self._first)
        self._last = torch.where(landed, time, self._last)
        self._landings += landed
        error = (self._apex - self._command[:, [_L]]).abs()
        self._height_error += torch.where(landed, error, 0.0)
        self._impact += torch.where(landed, self._descent.clamp(min=0.0), 0.0)
        self._airborne = torch.where(on_ground, 0.0, self._airborne + 1.0)
        self._apex = torch.where(on_ground, 0.0, torch.maximum(self._apex, readings.clearance))
        self._descent = -readings.foot_velocity[..., 2]
        self._down += held_foot_down(readings, self._gait) & upright

    def errors(self, robots: torch.Tensor) -> dict[str, float]:
        """Return the figures of `GAIT_SCALES` of some robots, (n,), bool: means over the feet that step.

        f and l are mean absolute errors [Hz, m]. A cycle that a foot misses counts as an error of the full commanded
        value, and so does a foot without a whole stride (f) or a landing (l).
        """
        swings = self._swings & robots[:, None]
        if not bool(swings.any()):
            return {}
        cycles, wanted, high = self._landings - 1.0, self._command[:, [_F]], self._command[:, [_L]]
        # As in `hugwbc.evaluation.metrics`: a gap of n periods at the start or the end misses n - 1 cycles.
        gaps = torch.stack((self._first, (self._samples * self._dt)[:, None] - self._last))
        missed = ((gaps * wanted + _ROUNDING).floor() - 1.0).clamp(min=0.0).sum(0)
        error = (cycles / (self._last - self._first) - wanted).abs() * cycles + missed * wanted
        frequency = torch.where(cycles > 0.0, error / (cycles + missed), wanted)
        error = self._height_error + missed * high
        height = torch.where(self._landings > 0.0, error / (self._landings + missed), high)
        landings = self._landings[swings].sum().clamp(min=1.0)
        figures = {
            "f": float(frequency[swings].mean()),
            "l": float(height[swings].mean()),
            "impact": float(self._impact[swings].sum() / landings),
        }
        if bool(hopping(self._gait[robots]).all()):
            figures["held_foot"] = float(self._down[robots].sum() / self._samples[robots].sum().clamp(min=1.0))
        return figures


class Evaluator:
    """Robots that repeat the same episodes at every evaluation.

    Commands, gaits and model parameters are drawn once, as training draws them, with the speeds of its start. There are
    no pushes, loads or intervention; sensors err as in training; rough ground has all levels; a command lasts the whole
    episode. All random numbers are the evaluator's own, so that the training continues as if there had been no
    evaluation.
    """

    def __init__(self, config: EnvConfig, *, count: int, seconds: float, threads: int, timestep: float) -> None:
        """Build the robots.

        Args:
            config: settings of the environment.
            count: number of robots.
            seconds: length of the episodes [s].
            threads: threads of the simulation.
            timestep: largest physics time step [s]; the one used divides the control period into equal steps.
        """
        substeps = math.ceil(config.period / timestep - _ROUNDING)
        calm = dataclasses.replace(config.randomization, push_velocity=0.0)
        every_level = dataclasses.replace(config.terrain, start_level=config.terrain.levels - 1)
        settings = dataclasses.replace(
            config,
            count=count,
            timestep=config.period / substeps,
            substeps=substeps,
            episode_steps=_NEVER,
            flip_probability=0.0,
            randomization=calm,
            loads=LoadConfig(),
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
        names = [SCORE, _FALLS]
        for gait in self._gaits:
            of_steps = [n for n in _Steps.FIGURES if gait is not Gait.STANDING and (gait.hops or n != "held_foot")]
            names += [f"evaluation/{gait.label}/{name}" for name in (*ERROR_SCALES, "falls", *of_steps)]
        return names

    def adopt(self, config: EnvConfig) -> None:
        """Adopt the gains of the legs' feed-forward, with which a policy runs, and which schedules may change."""
        gains = {"squat_gain": config.squat_gain, "swing_gain": config.swing_gain}
        self._env.adopt(dataclasses.replace(self._env.config, **gains))

    @torch.no_grad()
    def run(self, actor: Callable[..., tuple[torch.Tensor, torch.Tensor]]) -> dict[str, float]:
        """Return falls, mean absolute errors and quality of the steps of each gait, and one score; lower is better.

        The score is the mean over gaits of the mean of error / scale over commands and the figures of the steps, plus
        `FALL_COST` times the fraction of robots that fell. The errors of a robot count until it falls; an error without
        samples is NaN, and its gait is left out of the score.
        """
        env = self._env
        env.load_state_dict(self._start)
        command, gait = env.command.clone(), env.gait.clone()
        upright = torch.ones(env.count, dtype=torch.bool)
        sums, samples = torch.zeros(env.count, len(ERROR_SCALES)), torch.zeros(env.count)
        steps = _Steps(command, gait, env.dt)
        for step in range(self._steps):
            observation = env.observe()
            action, _ = actor(observation.history, observation.command)
            upright &= ~env.step(action).done
            if step >= self._settle:
                # A robot that fell has restarted under another command: it no longer counts.
                error = command_errors(env.readings, command, env.robot.waist)
                sums += torch.where(upright[:, None], error, 0.0)
                samples += upright
                steps.add(env.readings, upright)
        env.statistics.pop()
        steps_of_gaits = {
            one: {"falls": float((~upright[gait == one]).float().mean())} | steps.errors(gait == one)
            for one in self._gaits
        }
        return self._figures(gait, sums, samples, float((~upright).float().mean()), steps_of_gaits)

    def _figures(
        self,
        gait: torch.Tensor,
        sums: torch.Tensor,
        samples: torch.Tensor,
        falls: float,
        steps: Mapping[Gait, Mapping[str, float]],
    ) -> dict[str, float]:
        """Return the figures of `run` from sums of errors, shape (n, 6), and what else the gaits have."""
        scales, figures, scores = ERROR_SCALES | GAIT_SCALES, {}, []
        for one in self._gaits:
            chosen = gait == one
            errors = dict(zip(ERROR_SCALES, (sums[chosen].sum(0) / samples[chosen].sum()).tolist(), strict=True))
            errors = {**errors, **steps.get(one, {})}
            figures |= {f"evaluation/{one.label}/{name}": error for name, error in errors.items()}
            relative = [error / scales[name] for name, error in errors.items() if name in scales]
            if all(map(math.isfinite, relative)):
                scores.append(sum(relative) / len(relative))
        score = FALL_COST * falls + (sum(scores) / len(scores) if scores else 0.0)
        return {SCORE: score, _FALLS: falls, **figures}

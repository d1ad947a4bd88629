"""The paper's table of single-command tracking errors.

Each command is sampled over its finishing range while the others stay at their defaults; one episode per sample. The
samples of a command are stratified: its range is cut into as many equal parts as it has episodes, and each part gets
one uniform sample, so that few episodes cover the whole range as well.
"""

import concurrent.futures
import dataclasses
import functools
import math
import multiprocessing
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from hugwbc.commands import COMMAND_NAMES, Command, command_ranges, default_command
from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.evaluation import metrics
from hugwbc.evaluation.loop import Constant
from hugwbc.evaluation.paper import ERROR_NAMES, error_name, single_command_errors
from hugwbc.evaluation.rollout import Trace, rollout
from hugwbc.gait import Gait
from hugwbc.sim import Simulation
from hugwbc.sim.scene import SIMULATION_TIMESTEP

SLOW_SPEED = 0.6  # [m/s]; falls at commanded speeds up to this are counted apart

ControllerFactory = Callable[[], Controller]


@dataclasses.dataclass(frozen=True)
class SingleCommandConfig:
    """Settings of the protocol.

    Attributes:
        gait: of all episodes.
        both_legs: alternate with the mirrored gait: hopping on the left and on the right leg.
        episodes: in all, split evenly over the commands of the gait.
        seed: of the sampled commands.
        duration: of an episode [s].
        settle: start of an episode that is left out of the errors [s].
        timestep: of the physics [s].
        workers: processes that share the episodes.
    """

    gait: Gait
    both_legs: bool = False
    episodes: int = 32
    seed: int = 0
    duration: float = 10.0
    settle: float = metrics.SETTLE_S
    timestep: float = SIMULATION_TIMESTEP
    workers: int = 1

    def __post_init__(self) -> None:
        least = len(sampled_commands(self.gait))
        if self.episodes < least:
            raise ConfigError(
                f"episodes is {self.episodes}; the {self.gait.label} gait needs at least {least}, one per command"
            )
        if self.both_legs and not self.gait.hops:
            raise ConfigError(f"both_legs is for hopping; the gait is {self.gait.label}")
        if not 0.0 <= self.settle < self.duration < math.inf:
            raise ConfigError(
                f"duration is {self.duration} s and settle {self.settle} s; give 0 <= settle < duration, finite"
            )
        if self.workers < 1:
            raise ConfigError(f"workers is {self.workers}; give 1 or more")
        if self.seed < 0:
            raise ConfigError(f"seed is {self.seed}; give 0 or more")

    @property
    def gait_label(self) -> str:
        """Label of the gait; "hopping" for both legs."""
        return "hopping" if self.both_legs else self.gait.label


@dataclasses.dataclass(frozen=True)
class Episode:
    """One episode.

    Attributes:
        gait: label.
        command: name of the sampled command.
        value: its value.
        error_name: the paper's name of the error that the episode counts towards.
        error: that error; None if the robot fell before it could be measured.
        fell: whether the robot fell.
        survived_s: [s].
        foot_travel: length of both feet's paths after the settling time, standing only [m].
        held_foot_contact: part of the time in which the held leg touched the ground, hopping only.
        failures: exceptions of the controller that the safety filter caught.
    """

    gait: str
    command: str
    value: float
    error_name: str
    error: float | None
    fell: bool
    survived_s: float
    foot_travel: float | None
    held_foot_contact: float | None
    failures: int


@dataclasses.dataclass(frozen=True)
class SingleCommandResult:
    """Outcome of the protocol.

    Attributes:
        controller: name.
        gait: label; "hopping" for both legs.
        episodes: how many.
        falls: in how many the robot fell.
        episodes_slow: episodes with a commanded horizontal speed of at most 0.6 m/s.
        falls_slow: in how many of these the robot fell.
        fall_rate_slow: falls_slow / episodes_slow.
        errors: mean of the episodes' errors by the paper's names; None where the gait has no such command.
        foot_travel: mean over the episodes, standing only [m].
        held_foot_contact: mean over the episodes, hopping only.
        paper: the paper's errors, for the names that it reports.
        seed, duration, settle, timestep: as configured.
        rows: the episodes.
    """

    controller: str
    gait: str
    episodes: int
    falls: int
    episodes_slow: int
    falls_slow: int
    fall_rate_slow: float
    errors: dict[str, float | None]
    foot_travel: float | None
    held_foot_contact: float | None
    paper: dict[str, float]
    seed: int
    duration: float
    settle: float
    timestep: float
    rows: tuple[Episode, ...]


def sampled_commands(gait: Gait) -> tuple[str, ...]:
    """The commands whose range under a gait is more than one value; for standing without the foot commands."""
    names = [name for name, limits in command_ranges(gait).items() if limits.finishing[0] < limits.finishing[1]]
    return tuple(name for name in names if gait is not Gait.STANDING or name not in ("f", "l"))


def sample_episodes(config: SingleCommandConfig) -> list[tuple[str, float, Gait]]:
    """Name and value of the sampled command, and gait, of every episode, stratified over the finishing ranges."""
    rng = np.random.default_rng(config.seed)
    names = sampled_commands(config.gait)
    share, rest = divmod(config.episodes, len(names))
    gaits = (config.gait, config.gait.mirrored() if config.both_legs else config.gait)
    samples: list[tuple[str, float, Gait]] = []
    for position, name in enumerate(names):
        count = share + (position < rest)
        low, high = command_ranges(config.gait)[name].finishing
        values = low + (high - low) * (np.arange(count) + rng.uniform(size=count)) / count
        samples += [(name, float(value), gaits[index % 2]) for index, value in enumerate(values)]
    return samples


def run_single_command(
    factory: ControllerFactory, config: SingleCommandConfig, on_episode: Callable[[Episode], None] | None = None
) -> SingleCommandResult:
    """Run the protocol.

    Args:
        factory: makes the controller; with more than one worker it must be picklable.
        config: settings.
        on_episode: called with every finished episode, in order.
    """
    name = factory().name
    rows: list[Episode] = []
    for row in _episodes(factory, config):
        rows.append(row)
        if on_episode is not None:
            on_episode(row)
    slow = [row for row in rows if row.command not in ("v_x", "v_y") or abs(row.value) <= SLOW_SPEED]
    falls_slow = sum(row.fell for row in slow)
    return SingleCommandResult(
        controller=name,
        gait=config.gait_label,
        episodes=len(rows),
        falls=sum(row.fell for row in rows),
        episodes_slow=len(slow),
        falls_slow=falls_slow,
        fall_rate_slow=falls_slow / len(slow) if slow else 0.0,
        errors={error: _mean(row.error for row in rows if row.error_name == error) for error in ERROR_NAMES},
        foot_travel=_mean(row.foot_travel for row in rows),
        held_foot_contact=_mean(row.held_foot_contact for row in rows),
        paper=dict(single_command_errors(config.gait)),
        seed=config.seed,
        duration=config.duration,
        settle=config.settle,
        timestep=config.timestep,
        rows=tuple(rows),
    )


def _episodes(factory: ControllerFactory, config: SingleCommandConfig) -> Iterator[Episode]:
    samples = sample_episodes(config)
    if config.workers == 1:
        controller, simulation = factory(), Simulation(timestep=config.timestep)
        yield from (_run_episode(controller, simulation, config, sample) for sample in samples)
        return
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(config.workers, mp_context=context) as pool:
        yield from pool.map(functools.partial(_run_in_worker, factory, config), samples)


@functools.lru_cache(maxsize=1)
def _worker_equipment(factory: ControllerFactory, timestep: float) -> tuple[Controller, Simulation]:
    """Controller and simulation of a worker process, built once; every episode resets both."""
    return factory(), Simulation(timestep=timestep)


def _run_in_worker(factory: ControllerFactory, config: SingleCommandConfig, sample: tuple[str, float, Gait]) -> Episode:
    return _run_episode(*_worker_equipment(factory, config.timestep), config, sample)


def _run_episode(
    controller: Controller, simulation: Simulation, config: SingleCommandConfig, sample: tuple[str, float, Gait]
) -> Episode:
    name, value, gait = sample
    values = default_command(gait).array()
    values[COMMAND_NAMES.index(name)] = value
    command = Command.from_array(values, gait)
    trace = rollout(controller, Constant(command), simulation, duration=config.duration)
    error = episode_error(trace, name, config.settle)
    return Episode(
        gait=gait.label,
        command=name,
        value=value,
        error_name=error_name(name, value),
        error=_known(error),
        fell=trace.fell,
        survived_s=trace.survived_s,
        foot_travel=_known(metrics.foot_travel(trace, config.settle)) if gait is Gait.STANDING else None,
        held_foot_contact=_known(metrics.held_foot_contact(trace, config.settle)),
        failures=trace.safety.failures,
    )


def episode_error(trace: Trace, command: str, settle: float) -> float:
    """The error of one command over a run, NaN if it did not last beyond `settle` [s]."""
    if command == "f":
        return metrics.frequency_error(trace, settle)
    if command == "l":
        return metrics.swing_height_error(trace, settle)
    return metrics.tracking_errors(trace, settle)[command]


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _mean(errors: Iterable[float | None]) -> float | None:
    known = [error for error in errors if error is not None]
    return float(np.mean(known)) if known else None

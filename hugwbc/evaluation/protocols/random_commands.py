"""All commands drawn at random over their full ranges at once: does the robot stay up, and where does it not?

The paper studies pairs of commands; this is the whole space. Each episode has one independent uniform draw of every
command over its finishing range.
"""

import dataclasses
import itertools
from collections.abc import Callable, Sequence

import numpy as np

from hugwbc.commands import COMMAND_NAMES, Command, command_ranges, sample_all
from hugwbc.evaluation import metrics
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.protocols.episodes import (
    ControllerFactory,
    CountedResult,
    CountedSettings,
    Run,
    known,
    run_episodes,
)
from hugwbc.gait import Gait

PARTS = ("low", "middle", "high")  # thirds of a command's range


@dataclasses.dataclass(frozen=True)
class RandomCommandsConfig(CountedSettings):
    """Settings of the protocol, beside those of any of one gait.

    Attributes:
        episodes: in all.
    """

    episodes: int = 64


@dataclasses.dataclass(frozen=True)
class RandomEpisode:
    """One episode.

    Attributes:
        gait: label.
        command: the drawn values by name.
        fell: whether the robot fell.
        survived_s: [s].
        errors: mean absolute error of v_x, v_y, omega, h, p and w; None where the robot fell before `settle`.
        failures: exceptions of the controller that the safety filter caught.
    """

    gait: str
    command: dict[str, float]
    fell: bool
    survived_s: float
    errors: dict[str, float | None]
    failures: int


@dataclasses.dataclass(frozen=True)
class Combination:
    """Falls among the episodes whose command lay in some part of the space.

    Attributes:
        parts: third of the range, one of `PARTS`, by name of the command: one command or two.
        episodes: how many lay there.
        falls: in how many of these the robot fell.
    """

    parts: dict[str, str]
    episodes: int
    falls: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class RandomCommandsResult(CountedResult[RandomEpisode]):
    """Outcome of the protocol, beside what any has.

    Attributes:
        fall_rate: falls / episodes.
        combinations: thirds of single commands and of pairs with falls, those with the most falls first, then those
            with the highest rate.
    """

    fall_rate: float
    combinations: tuple[Combination, ...]


def sample_episodes(config: RandomCommandsConfig) -> list[Command]:
    """The command of every episode."""
    values = sample_all(config.gait, np.random.default_rng(config.seed), config.episodes)
    return [Command.from_array(row, config.alternating[index % 2]) for index, row in enumerate(values)]


def run_random_commands(
    factory: ControllerFactory,
    config: RandomCommandsConfig,
    on_episode: Callable[[RandomEpisode], None] | None = None,
) -> RandomCommandsResult:
    """Run the protocol.

    Args:
        factory: makes the controller; with more than one worker it must be picklable.
        config: settings.
        on_episode: called with every finished episode, in order.
    """
    plans = [EpisodePlan(command) for command in sample_episodes(config)]
    rows = run_episodes(factory, plans, _Judge(config.settle), config, on_episode)
    return RandomCommandsResult.of(
        factory,
        config,
        rows,
        fall_rate=sum(row.fell for row in rows) / len(rows),
        combinations=failing_combinations(rows, config.gait),
    )


@dataclasses.dataclass(frozen=True)
class _Judge:
    settle: float

    def __call__(self, index: int, run: Run) -> RandomEpisode:
        errors = metrics.tracking_errors(run.trace, self.settle)
        return RandomEpisode(
            gait=run.command.gait.label,
            command=dict(zip(COMMAND_NAMES, run.command.array().tolist(), strict=True)),
            fell=run.trace.fell,
            survived_s=run.trace.survived_s,
            errors={name: known(error) for name, error in errors.items()},
            failures=run.trace.safety.failures,
        )


def failing_combinations(rows: Sequence[RandomEpisode], gait: Gait) -> tuple[Combination, ...]:
    """Thirds of one command's range, and pairs of thirds of two, in which a robot fell.

    Args:
        rows: the episodes.
        gait: whose ranges are cut into thirds.
    """
    limits = {name: r.finishing for name, r in command_ranges(gait).items() if r.finishing[0] < r.finishing[1]}
    counts: dict[tuple[tuple[str, str], ...], list[int]] = {}
    for row in rows:
        parts = [(name, _part(row.command[name], *bounds)) for name, bounds in limits.items()]
        for combination in itertools.chain(itertools.combinations(parts, 1), itertools.combinations(parts, 2)):
            count = counts.setdefault(combination, [0, 0])
            count[0] += 1
            count[1] += row.fell
    found = [Combination(dict(parts), episodes, falls) for parts, (episodes, falls) in counts.items() if falls]
    return tuple(sorted(found, key=lambda c: (-c.falls, -c.falls / c.episodes, len(c.parts))))


def _part(value: float, low: float, high: float) -> str:
    return PARTS[min(int(3.0 * (value - low) / (high - low)), 2)]

"""All commands drawn at random over their full ranges at once: does the robot stay up, and where does it not?

The paper studies pairs of commands; this protocol covers the whole space. In each episode, every command is drawn
independently and uniformly from its finishing range.
"""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from hugwbc.commands import COMMAND_NAMES, Command, command_ranges, sample_all
from hugwbc.evaluation import metrics
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.protocols.episodes import CountedResult, CountedSettings, Run, known
from hugwbc.evaluation.protocols.protocol import PlannedProtocol, failure_lines
from hugwbc.evaluation.tables import format_table
from hugwbc.gait import Gait

PARTS = ("low", "middle", "high")  # thirds of a command's range
_LISTED_PAIRS = 10


@dataclasses.dataclass(frozen=True)
class RandomCommandsConfig(CountedSettings):
    """Settings of the random-commands protocol, in addition to `CountedSettings`.

    Attributes:
        episodes: number of episodes in all.
    """

    episodes: int = 64


@dataclasses.dataclass(frozen=True)
class RandomEpisode:
    """One episode of random commands.

    Attributes:
        gait: label of the gait.
        command: drawn values by name.
        fell: whether the robot fell.
        survived_s: time until the fall, or the whole episode [s].
        errors: mean absolute error of v_x, v_y, omega, h, p and w; None if the robot fell before `settle`.
        failures: number of exceptions of the controller that the safety filter caught.
    """

    gait: str
    command: dict[str, float]
    fell: bool
    survived_s: float
    errors: dict[str, float | None]
    failures: int


@dataclasses.dataclass(frozen=True)
class Combination:
    """Falls in a part of the command space: a third of one command's range, or of two commands' ranges.

    Attributes:
        parts: third of the range, one of `PARTS`, by name of the command.
        episodes: number of episodes in that part.
        falls: number of these in which the robot fell.
    """

    parts: dict[str, str]
    episodes: int
    falls: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class RandomCommandsResult(CountedResult[RandomEpisode]):
    """Result of the random-commands protocol, in addition to `CountedResult`.

    Attributes:
        fall_rate: falls / episodes.
        combinations: thirds of single commands and of pairs in which the robot fell, sorted by number of falls, then
            by rate of falls.
    """

    fall_rate: float
    combinations: tuple[Combination, ...]


def sample_episodes(config: RandomCommandsConfig) -> list[Command]:
    """Draw the command of every episode."""
    values = sample_all(config.gait, np.random.default_rng(config.seed), config.episodes)
    return [Command.from_array(row, config.alternating[index % 2]) for index, row in enumerate(values)]


@dataclasses.dataclass(frozen=True)
class RandomCommandsJudge:
    """Judge of the tracking errors.

    Attributes:
        settle: start of the episode that is left out [s].
    """

    settle: float

    def __call__(self, index: int, run: Run) -> RandomEpisode:
        """Return the row of one episode."""
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
    """Return the thirds of one command's range, and pairs of thirds of two, in which a robot fell.

    Args:
        rows: the episodes.
        gait: gait whose ranges are cut into thirds.
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


class RandomCommandsProtocol(PlannedProtocol[RandomCommandsConfig, RandomEpisode, RandomCommandsResult]):
    """All commands drawn at random at once."""

    name = "random-commands"
    summary = "draw all commands at random at once, and list where the robot falls"
    settings = RandomCommandsConfig
    result = RandomCommandsResult

    def plans(self, settings: RandomCommandsConfig) -> list[EpisodePlan]:
        """Return an episode for each drawn command."""
        return [EpisodePlan(command) for command in sample_episodes(settings)]

    def judge(self, settings: RandomCommandsConfig) -> RandomCommandsJudge:
        """Return the judge of the tracking errors."""
        return RandomCommandsJudge(settings.settle)

    def summarise(self, settings: RandomCommandsConfig, rows: Sequence[RandomEpisode]) -> dict[str, Any]:
        """Return the rate of falls, and where in the space they are."""
        return {
            "fall_rate": sum(row.fell for row in rows) / len(rows),
            "combinations": failing_combinations(rows, settings.gait),
        }

    def describe(self, result: RandomCommandsResult) -> str:
        """Return all falls, falls by the third of each command's range, and the pairs of thirds with the most falls."""
        lines = [f"falls: {result.falls} of {result.episodes} episodes ({100 * result.fall_rate:.1f} %)"]
        if result.falls:
            counts = _falls_by_third(result)
            rows = [(name, *(counts[name].get(part) for part in PARTS)) for name in counts]
            lines += ["", format_table(("falls of episodes", *(f"{part} third" for part in PARTS)), rows)]
            pairs = [c for c in result.combinations if len(c.parts) == 2][:_LISTED_PAIRS]
            rows = [(_label(c), f"{c.falls} of {c.episodes}") for c in pairs]
            lines += ["", format_table(("pairs with the most falls", "falls"), rows)]
        return "\n".join(lines + failure_lines(result.rows))


def _falls_by_third(result: RandomCommandsResult) -> dict[str, dict[str, str]]:
    counts: dict[str, dict[str, str]] = {}
    for combination in result.combinations:
        if len(combination.parts) == 1:
            ((name, part),) = combination.parts.items()
            counts.setdefault(name, {})[part] = f"{combination.falls} of {combination.episodes}"
    return dict(sorted(counts.items(), key=lambda item: list(result.rows[0].command).index(item[0])))


def _label(combination: Combination) -> str:
    return ", ".join(f"{name} {part}" for name, part in combination.parts.items())

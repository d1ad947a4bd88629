"""The paper's heat maps: the errors of two commands over the ranges of both, for every pair of commands.

All other commands are at their defaults. Each command is scanned alone as well, over the same values: that is the
single-command error, with which the summary compares. The paper calls commands orthogonal when they do not
significantly affect one another's tracking, without a number; here that is an error within 1.5 times the single one.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from hugwbc.commands import COMMAND_NAMES, Command, command_ranges, default_command
from hugwbc.errors import ConfigError
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.protocols.episodes import (
    ControllerFactory,
    CountedResult,
    GaitSettings,
    Run,
    known,
    mean,
    run_episodes,
)
from hugwbc.evaluation.protocols.single_command import episode_error, sampled_commands

ORTHOGONAL = 1.5  # times the single-command error


@dataclasses.dataclass(frozen=True)
class HeatmapConfig(GaitSettings):
    """Settings of the protocol, beside those of any of one gait.

    Attributes:
        points: values of each command, evenly over its finishing range, ends included.
    """

    points: int = 5

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.points < 2:
            raise ConfigError(f"points is {self.points}; give 2 or more values of each command")

    @property
    def pairs(self) -> list[tuple[str, str]]:
        """All pairs of the commands of the gait."""
        return list(itertools.combinations(sampled_commands(self.gait), 2))

    @property
    def episodes(self) -> int:
        """In all."""
        return len(self.pairs) * self.points**2 + len(sampled_commands(self.gait)) * self.points

    def values(self, name: str) -> list[float]:
        """Of a command."""
        return np.linspace(*command_ranges(self.gait)[name].finishing, self.points).tolist()


@dataclasses.dataclass(frozen=True)
class HeatmapEpisode:
    """One episode.

    Attributes:
        gait: label.
        commands: the one or two that were set, by name.
        errors: of all commands of the gait, by name; None where the robot fell before they could be measured.
        fell: whether the robot fell.
        failures: exceptions of the controller that the safety filter caught.
    """

    gait: str
    commands: dict[str, float]
    errors: dict[str, float | None]
    fell: bool
    failures: int


@dataclasses.dataclass(frozen=True)
class HeatMap:
    """One pair of commands: matrices with a row for each value of the first, a column for each of the second.

    Attributes:
        first, second: names.
        errors: of both commands, by name; None in a fall.
        falls: whether the robot fell, 1 or 0.
    """

    first: str
    second: str
    errors: dict[str, tuple[tuple[float | None, ...], ...]]
    falls: tuple[tuple[int, ...], ...]


@dataclasses.dataclass(frozen=True)
class OrthogonalRange:
    """Where one command leaves another's tracking as it is.

    Attributes:
        tracked: the command whose error is looked at, averaged over its whole range.
        against: the command that is varied.
        low, high: range of `against` about its default, up to the first scanned values that fail; None if even the
            nearest to the default does.
        share: of the finishing range of `against`, in values scanned.
        worst: largest error of all scanned values, as a multiple of the single-command error; None with a fall.
    """

    tracked: str
    against: str
    low: float | None
    high: float | None
    share: float
    worst: float | None


@dataclasses.dataclass(frozen=True, kw_only=True)
class HeatmapResult(CountedResult[HeatmapEpisode]):
    """Outcome of the protocol, beside what any has.

    Attributes:
        points: values of each command.
        values: of each command, by name.
        single: error of each command scanned alone, averaged over its values.
        maps: one for each pair.
        orthogonality: one for each ordered pair.
    """

    points: int
    values: dict[str, list[float]]
    single: dict[str, float | None]
    maps: tuple[HeatMap, ...]
    orthogonality: tuple[OrthogonalRange, ...]


def heatmap_plans(config: HeatmapConfig) -> list[EpisodePlan]:
    """Each command alone, then each pair, row by row of its map; the label names what is set."""
    names = sampled_commands(config.gait)
    alone = [{name: value} for name in names for value in config.values(name)]
    pairs = [
        {first: a, second: b}
        for first, second in config.pairs
        for a in config.values(first)
        for b in config.values(second)
    ]
    return [
        EpisodePlan(_command(config, values, index), label=" ".join(values))
        for index, values in enumerate([*alone, *pairs])
    ]


def _command(config: HeatmapConfig, values: dict[str, float], index: int) -> Command:
    return dataclasses.replace(default_command(config.alternating[index % 2]), **values)


def run_heatmap(
    factory: ControllerFactory, config: HeatmapConfig, on_episode: Callable[[HeatmapEpisode], None] | None = None
) -> HeatmapResult:
    """Run the protocol.

    Args:
        factory: makes the controller; with more than one worker it must be picklable.
        config: settings.
        on_episode: called with every finished episode, in order.
    """
    rows = run_episodes(factory, heatmap_plans(config), HeatmapJudge(config.settle), config, on_episode)
    names, points = sampled_commands(config.gait), config.points
    alone, paired = rows[: len(names) * points], iter(rows[len(names) * points :])
    single = {
        name: mean(row.errors[name] for row in _survived(alone[position * points : (position + 1) * points]))
        for position, name in enumerate(names)
    }
    maps = tuple(
        heat_map(first, second, list(itertools.islice(paired, points**2)), points) for first, second in config.pairs
    )
    return HeatmapResult.of(
        factory,
        config,
        rows,
        points=points,
        values={name: config.values(name) for name in names},
        single=single,
        maps=maps,
        orthogonality=tuple(orthogonality(config, single, maps)),
    )


def _survived(rows: Iterable[HeatmapEpisode]) -> list[HeatmapEpisode]:
    return [row for row in rows if not row.fell]


def heat_map(first: str, second: str, rows: Sequence[HeatmapEpisode], points: int) -> HeatMap:
    """The map of a pair from its episodes, row by row."""
    grid = [rows[start : start + points] for start in range(0, points**2, points)]
    return HeatMap(
        first,
        second,
        {
            name: tuple(tuple(None if row.fell else row.errors[name] for row in line) for line in grid)
            for name in (first, second)
        },
        tuple(tuple(int(row.fell) for row in line) for line in grid),
    )


def orthogonality(
    config: HeatmapConfig, single: dict[str, float | None], maps: Sequence[HeatMap]
) -> Iterable[OrthogonalRange]:
    """For every ordered pair, where the second command leaves the first one's error within 1.5 times the single one.

    Args:
        config: whose values were scanned.
        single: error of each command alone.
        maps: of all pairs.
    """
    for heat in maps:
        for tracked, against in ((heat.first, heat.second), (heat.second, heat.first)):
            matrix = heat.errors[tracked]
            lines = list(zip(*matrix, strict=True)) if tracked == heat.first else list(matrix)
            yield _orthogonal_range(config, tracked, against, single[tracked], lines)


def _orthogonal_range(
    config: HeatmapConfig,
    tracked: str,
    against: str,
    single: float | None,
    lines: Sequence[Sequence[float | None]],
) -> OrthogonalRange:
    """One ordered pair; `lines` has, for each value of `against`, the errors over the values of `tracked`."""
    values = config.values(against)
    ratios = [_multiple(line, single) for line in lines]
    good = [ratio <= ORTHOGONAL for ratio in ratios]
    default = command_ranges(config.gait)[against].default
    low = high = int(np.argmin(np.abs(np.array(values) - default)))
    worst = known(max(ratios))
    if not good[low]:
        return OrthogonalRange(tracked, against, None, None, 0.0, worst)
    while low > 0 and good[low - 1]:
        low -= 1
    while high + 1 < len(good) and good[high + 1]:
        high += 1
    return OrthogonalRange(tracked, against, values[low], values[high], (high - low + 1) / len(good), worst)


def _multiple(line: Sequence[float | None], single: float | None) -> float:
    """Mean of some errors as a multiple of the error alone; infinite with a fall."""
    if single is None or None in line:
        return math.inf
    error = float(np.mean(np.array(line, dtype=float)))
    if single == 0.0:
        return 1.0 if error == 0.0 else math.inf
    return error / single


@dataclasses.dataclass(frozen=True)
class HeatmapJudge:
    """Measures the errors of all commands of the gait.

    Attributes:
        settle: start of the episode that is left out [s].
    """

    settle: float

    def __call__(self, index: int, run: Run) -> HeatmapEpisode:
        """The row of one episode."""
        values: dict[str, float] = dict(zip(COMMAND_NAMES, run.command.array().tolist(), strict=True))
        return HeatmapEpisode(
            gait=run.command.gait.label,
            commands={name: values[name] for name in run.plan.label.split()},
            errors={
                name: known(episode_error(run.trace, name, self.settle)) for name in sampled_commands(run.command.gait)
            },
            fell=run.trace.fell,
            failures=run.trace.safety.failures,
        )

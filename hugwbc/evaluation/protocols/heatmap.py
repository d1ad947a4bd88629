"""The paper's heat maps: the errors of two commands over the ranges of both, for every pair of commands.

All other commands are at their defaults. Each command is also scanned alone over the same values, which gives the
single-command error that the summary compares with. The paper calls commands orthogonal if they do not significantly
affect one another's tracking, without a number; here that means an error within 1.5 times the single-command error.
"""

import dataclasses
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from hugwbc.commands import COMMAND_NAMES, Command, command_ranges, default_command
from hugwbc.errors import ConfigError
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import Estimate
from hugwbc.evaluation.picture_data import HeatMaps
from hugwbc.evaluation.protocols.episodes import CountedResult, GaitSettings, Run, SettledJudge, known, mean
from hugwbc.evaluation.protocols.protocol import Measured, PlannedProtocol, count_text, failure_lines
from hugwbc.evaluation.protocols.single_command import episode_error, sampled_commands
from hugwbc.evaluation.tables import format_table
from hugwbc.gait import Gait

ORTHOGONAL = 1.5  # times the single-command error


@dataclasses.dataclass(frozen=True)
class HeatmapConfig(GaitSettings):
    """Settings of the heatmap protocol, in addition to `GaitSettings`.

    Attributes:
        points: number of values of each command, evenly spaced over its finishing range, ends included.
    """

    points: int = 5

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.points < 2:
            raise ConfigError(f"points is {self.points}; give 2 or more values of each command")

    @property
    def pairs(self) -> list[tuple[str, str]]:
        """All pairs of commands of the gait."""
        return list(itertools.combinations(sampled_commands(self.gait), 2))

    @property
    def episodes(self) -> int:
        """Number of episodes in all."""
        return len(self.pairs) * self.points**2 + len(sampled_commands(self.gait)) * self.points

    def values(self, name: str) -> list[float]:
        """Return the scanned values of a command."""
        return np.linspace(*command_ranges(self.gait)[name].finishing, self.points).tolist()


@dataclasses.dataclass(frozen=True)
class HeatmapEpisode:
    """One episode of a command or a pair of commands.

    Attributes:
        gait: label of the gait.
        commands: values of the one or two commands that were set, by name.
        errors: errors of all commands of the gait, by name; None if the robot fell before they could be measured.
        fell: whether the robot fell.
        failures: number of exceptions of the controller that the safety filter caught.
    """

    gait: str
    commands: dict[str, float]
    errors: dict[str, float | None]
    fell: bool
    failures: int


@dataclasses.dataclass(frozen=True)
class HeatMap:
    """Errors of a pair of commands, as matrices with rows over the first command and columns over the second.

    Attributes:
        first, second: names of the commands.
        errors: errors of both commands, by name; None in a fall.
        falls: whether the robot fell, 1 or 0.
    """

    first: str
    second: str
    errors: dict[str, tuple[tuple[float | None, ...], ...]]
    falls: tuple[tuple[int, ...], ...]


@dataclasses.dataclass(frozen=True)
class OrthogonalRange:
    """The range of one command in which it does not affect another command's tracking.

    Attributes:
        tracked: command whose error is considered, averaged over its whole range.
        against: command that is varied.
        low, high: range of `against` about its default, up to the first scanned values that fail; None if even the
            value nearest to the default fails.
        share: fraction of the scanned values of `against` in that range.
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
    """Result of the heatmap protocol, in addition to `CountedResult`.

    Attributes:
        points: number of values of each command.
        values: scanned values of each command, by name.
        single: error of each command scanned alone, averaged over its values.
        maps: one map for each pair.
        orthogonality: one range for each ordered pair.
    """

    points: int
    values: dict[str, list[float]]
    single: dict[str, float | None]
    maps: tuple[HeatMap, ...]
    orthogonality: tuple[OrthogonalRange, ...]


def heatmap_plans(config: HeatmapConfig) -> list[EpisodePlan]:
    """Plan each command alone, then each pair, row by row of its map; the labels name what is set."""
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


def _survived(rows: Iterable[HeatmapEpisode]) -> list[HeatmapEpisode]:
    return [row for row in rows if not row.fell]


def heat_map(first: str, second: str, rows: Sequence[HeatmapEpisode], points: int) -> HeatMap:
    """Return the map of a pair from its episodes, given row by row."""
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
    """Find, for every ordered pair, where the second command leaves the first one's error as it is alone.

    Args:
        config: settings of the scan.
        single: error of each command alone.
        maps: maps of all pairs.

    Yields:
        The range in which the error stays within `ORTHOGONAL` times the error alone.
    """
    for heat in maps:
        for tracked, against in ((heat.first, heat.second), (heat.second, heat.first)):
            matrix = heat.errors[tracked]
            # One line for each value of `against`: the columns of the map if that is its second command.
            lines = list(zip(*matrix, strict=True)) if tracked == heat.first else list(matrix)
            yield _orthogonal_range(config, tracked, against, single[tracked], lines)


def _orthogonal_range(
    config: HeatmapConfig,
    tracked: str,
    against: str,
    single: float | None,
    lines: Sequence[Sequence[float | None]],
) -> OrthogonalRange:
    """Return the range of one ordered pair; `lines` has the errors over `tracked` for each value of `against`."""
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
    """Return the mean of some errors as a multiple of the error alone; infinite with a fall."""
    if single is None or None in line:
        return math.inf
    error = float(np.mean(np.array(line, dtype=float)))
    if single == 0.0:
        return 1.0 if error == 0.0 else math.inf
    return error / single


class HeatmapJudge(SettledJudge):
    """Judge that measures the errors of all commands of the gait."""

    def __call__(self, index: int, run: Run) -> HeatmapEpisode:
        """Return the row of one episode."""
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


class HeatmapProtocol(PlannedProtocol[HeatmapConfig, HeatmapEpisode, HeatmapResult]):
    """The paper's heat maps of pairs of commands."""

    name = "heatmap"
    summary = "errors over each pair of commands, and where one leaves the other alone"
    settings = HeatmapConfig
    result = HeatmapResult
    report_title = "Pairs of commands"
    report_text = (
        "Every pair of commands over the ranges of both. Maps: the error of one command (rows) against another one "
        "(columns), both rising to the right and up, relative to its error when it is scanned alone; crosses are "
        "falls. Table: the part of the other commands' ranges, about their defaults, in which the error stays within "
        "1.5 times that; the paper shows maps without such a number."
    )

    def plans(self, settings: HeatmapConfig) -> list[EpisodePlan]:
        """Return each command alone, then each pair."""
        return heatmap_plans(settings)

    def judge(self, settings: HeatmapConfig) -> HeatmapJudge:
        """Return the judge of all commands' errors."""
        return HeatmapJudge(settings.settle)

    def summarise(self, settings: HeatmapConfig, rows: Sequence[HeatmapEpisode]) -> dict[str, Any]:
        """Return the errors of each command alone, the maps, and the ranges of orthogonality."""
        names, points = sampled_commands(settings.gait), settings.points
        alone, paired = rows[: len(names) * points], iter(rows[len(names) * points :])
        single = {
            name: mean(row.errors[name] for row in _survived(alone[position * points : (position + 1) * points]))
            for position, name in enumerate(names)
        }
        maps = tuple(
            heat_map(first, second, list(itertools.islice(paired, points**2)), points)
            for first, second in settings.pairs
        )
        return {
            "points": points,
            "values": {name: settings.values(name) for name in names},
            "single": single,
            "maps": maps,
            "orthogonality": tuple(orthogonality(settings, single, maps)),
        }

    def describe(self, result: HeatmapResult) -> str:
        """Return, for every pair of commands, the range in which the one leaves the other alone."""
        names = list(result.values)
        share = {(entry.tracked, entry.against): entry for entry in result.orthogonality}
        rows = []
        for tracked in names:
            cells = [share.get((tracked, against)) for against in names]
            rows.append((tracked, result.single[tracked], *("" if c is None else _range(c.low, c.high) for c in cells)))
        table = format_table((f"{result.gait}, error of", "alone", *(f"over {name}" for name in names)), rows)
        about = (
            "Ranges of the column's command about its default in which the row's error stays within 1.5 times its "
            "error alone; -: none."
        )
        falls = f"falls: {count_text(result.falls, result.episodes)}, {result.points} values of each command"
        return "\n".join([table, "", about, falls, *failure_lines(result.rows)])

    def quick(self) -> list[HeatmapConfig]:
        """Return few values of standing and walking; jumping has as many pairs as walking, and is left to `full`."""
        return [HeatmapConfig(g, points=n, duration=2.5) for g, n in ((Gait.STANDING, 3), (Gait.WALKING, 2))]

    def full(self) -> list[HeatmapConfig]:
        """Return seven values of each command for every gait."""
        gaits = (Gait.STANDING, Gait.WALKING, Gait.JUMPING, Gait.HOPPING_LEFT)
        return [HeatmapConfig(gait, gait.hops, points=7) for gait in gaits]

    def figures(self, controller: str, result: Mapping[str, Any]) -> list[Figure]:
        """Return in what part of the other commands' ranges each command is tracked as well as alone, on average."""
        figures = []
        table = f"Orthogonality, {result['gait']}"
        for command in dict.fromkeys(entry["tracked"] for entry in result["orthogonality"]):
            shares = [100.0 * entry["share"] for entry in result["orthogonality"] if entry["tracked"] == command]
            estimate = Estimate(sum(shares) / len(shares), None, None, len(shares))
            name = f"error of {command}"
            figures.append(Figure(table, name, "% of ranges", controller, estimate, higher_is_better=True))
        return [*figures, falls_figure(table, controller, result["rows"])]

    def pictures(self, measured: Sequence[Measured], controllers: Sequence[str]) -> list[HeatMaps]:
        """Return the maps of all pairs of commands, for each gait and controller."""
        return [
            HeatMaps(
                f"{result['gait']}, {name}", list(result["values"]), relative_maps(result), "times the error alone"
            )
            for name, result in measured
        ]


def relative_maps(result: Mapping[str, Any]) -> dict[tuple[str, str], np.ndarray]:
    """Return, for every ordered pair of commands, the first one's error relative to its error alone; NaN in a fall.

    A map has a row for each value of the first command and a column for each of the second, both rising.

    Args:
        result: of the protocol, as JSON.
    """
    maps = {}
    for entry in result["maps"]:
        for first, second in ((entry["first"], entry["second"]), (entry["second"], entry["first"])):
            errors = np.array(entry["errors"][first], dtype=float)
            single = result["single"][first] or math.nan
            maps[first, second] = (errors if first == entry["first"] else errors.T) / single
    return maps


def _range(low: float | None, high: float | None) -> str | None:
    return None if low is None or high is None else f"{low:g} to {high:g}"

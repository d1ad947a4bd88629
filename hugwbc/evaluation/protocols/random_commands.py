"""All commands drawn at random over their full ranges at once: does the robot stay up, and where does it not?

The paper studies pairs of commands; this protocol covers the whole space. In each episode, every command is drawn
independently and uniformly from its finishing range. The errors stand beside those of single commands: a controller may
follow each command alone and not their combinations. Episodes with a fall are left out of both and counted.
"""

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from hugwbc.commands import COMMAND_NAMES, Command, command_ranges, sample_all
from hugwbc.evaluation import metrics
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import Estimate, bootstrap_mean, bootstrap_ratio
from hugwbc.evaluation.paper import ERROR_NAMES, ERROR_UNITS, error_name
from hugwbc.evaluation.protocols.episodes import (
    ControllerFactory,
    CountedResult,
    CountedSettings,
    Run,
    SettledJudge,
    known,
    run_episodes,
    stored_rows,
)
from hugwbc.evaluation.protocols.protocol import (
    INTERVAL,
    INTERVAL_NOTE,
    Measured,
    PlannedProtocol,
    count_text,
    failure_lines,
    four_decimals,
    interval_text,
)
from hugwbc.evaluation.protocols.single_command import (
    SingleCommandJudge,
    SingleCommandProtocol,
    episode_error,
    sampled_commands,
)
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
        errors: mean absolute error of v_x, v_y, omega, h, p and w, and the errors of f and l where the gait draws them;
            None if the robot fell before `settle`.
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
        errors: mean error of the episodes without a fall by the paper's names; None where the gait has no such command.
        intervals: the same means with their intervals.
        single: mean errors of single commands without a fall, with their intervals, from the stored episodes of
            `single-command` with the same controller, seed, duration and conditions; empty if there are none.
        ratios: errors over those of single commands, with their intervals; empty without these.
    """

    fall_rate: float
    combinations: tuple[Combination, ...]
    errors: dict[str, float | None] = dataclasses.field(default_factory=dict)
    intervals: dict[str, Estimate] = dataclasses.field(default_factory=dict)
    single: dict[str, Estimate] = dataclasses.field(default_factory=dict)
    ratios: dict[str, Estimate] = dataclasses.field(default_factory=dict)


def sample_episodes(config: RandomCommandsConfig) -> list[Command]:
    """Draw the command of every episode."""
    values = sample_all(config.gait, np.random.default_rng(config.seed), config.episodes)
    return [Command.from_array(row, config.alternating[index % 2]) for index, row in enumerate(values)]


class RandomCommandsJudge(SettledJudge):
    """Judge of the tracking errors."""

    def __call__(self, index: int, run: Run) -> RandomEpisode:
        """Return the row of one episode."""
        errors = metrics.tracking_errors(run.trace, self.settle)
        feet = [name for name in ("f", "l") if name in sampled_commands(run.command.gait)]
        errors |= {name: episode_error(run.trace, name, self.settle) for name in feet}
        return RandomEpisode(
            gait=run.command.gait.label,
            command=dict(zip(COMMAND_NAMES, run.command.array().tolist(), strict=True)),
            fell=run.trace.fell,
            survived_s=run.trace.survived_s,
            errors={name: known(error) for name, error in errors.items()},
            failures=run.trace.safety.failures,
        )


def combined_errors(rows: Iterable[Mapping[str, Any]]) -> dict[str, list[float | None]]:
    """Return the errors of all episodes without a fall by the paper's names.

    Args:
        rows: the episodes as JSON.
    """
    errors: dict[str, list[float | None]] = {name: [] for name in ERROR_NAMES}
    for row in rows:
        for name in () if row["fell"] else sampled_commands(Gait.parse(row["gait"])):
            errors[error_name(name, row["command"][name])].append(row["errors"].get(name))
    return errors


def single_errors(rows: Iterable[Mapping[str, Any]]) -> dict[str, list[float | None]]:
    """Return the errors of all episodes of single commands without a fall by the paper's names.

    Args:
        rows: the episodes of the single-command protocol as JSON.
    """
    errors: dict[str, list[float | None]] = {name: [] for name in ERROR_NAMES}
    for row in rows:
        if not row["fell"]:
            errors[row["error_name"]].append(row["error"])
    return errors


def error_ratios(
    combined: Mapping[str, Sequence[float | None]], single: Mapping[str, Sequence[float | None]]
) -> dict[str, Estimate]:
    """Return the ratio of the mean errors, where both protocols have the error."""
    ratios = {name: bootstrap_ratio(errors, single[name]) for name, errors in combined.items()}
    return {name: ratio for name, ratio in ratios.items() if ratio.value is not None}


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
    report_title = "All commands at once"
    report_text = (
        "All commands are drawn at random over their ranges. Errors are those of the episodes without a fall. Where "
        "the report has single commands of the same gait, the ratio to their errors, also of episodes without a fall, "
        "tells what the combination costs."
    )

    def plans(self, settings: RandomCommandsConfig) -> list[EpisodePlan]:
        """Return an episode for each drawn command."""
        return [EpisodePlan(command) for command in sample_episodes(settings)]

    def judge(self, settings: RandomCommandsConfig) -> RandomCommandsJudge:
        """Return the judge of the tracking errors."""
        return RandomCommandsJudge(settings.settle)

    def run(
        self,
        factory: ControllerFactory,
        settings: RandomCommandsConfig,
        on_episode: Callable[[RandomEpisode], None] | None = None,
    ) -> RandomCommandsResult:
        """Run all episodes and compare their errors with stored ones of single commands; arguments as in `Protocol`."""
        rows = run_episodes(factory, self.plans(settings), self.judge(settings), settings, on_episode)
        gaits = {gait.label for gait in settings.alternating}
        alone = stored_rows(factory, SingleCommandJudge(settings.settle), settings)
        single = single_errors(dataclasses.asdict(row) for row in alone if row.gait in gaits)
        compared = {
            "single": {name: bootstrap_mean(errors) for name, errors in single.items() if errors},
            "ratios": error_ratios(combined_errors(map(dataclasses.asdict, rows)), single),
        }
        return self.result.of(factory, settings, rows, **self.summarise(settings, rows), **compared)

    def summarise(self, settings: RandomCommandsConfig, rows: Sequence[RandomEpisode]) -> dict[str, Any]:
        """Return the errors, the rate of falls, and where in the space they are."""
        intervals = {n: bootstrap_mean(e) for n, e in combined_errors(map(dataclasses.asdict, rows)).items()}
        return {
            "fall_rate": sum(row.fell for row in rows) / len(rows),
            "combinations": failing_combinations(rows, settings.gait),
            "errors": {name: estimate.value for name, estimate in intervals.items()},
            "intervals": intervals,
        }

    def describe(self, result: RandomCommandsResult) -> str:
        """Return the errors, all falls, and where the falls are: by thirds of one command's range and of two's."""
        lines = [*_error_lines(result), f"falls: {count_text(result.falls, result.episodes)}", INTERVAL_NOTE]
        if result.falls:
            counts = _falls_by_third(result)
            rows = [(name, *(counts[name].get(part) for part in PARTS)) for name in counts]
            lines += ["", format_table(("falls of episodes", *(f"{part} third" for part in PARTS)), rows)]
            pairs = [c for c in result.combinations if len(c.parts) == 2][:_LISTED_PAIRS]
            rows = [(_label(c), f"{c.falls} of {c.episodes}") for c in pairs]
            lines += ["", format_table(("pairs with the most falls", "falls"), rows)]
        return "\n".join(lines + failure_lines(result.rows))

    def quick(self) -> list[RandomCommandsConfig]:
        """Return few episodes of standing and walking, as long as those of single commands."""
        return [RandomCommandsConfig(g, episodes=n, duration=5.0) for g, n in ((Gait.STANDING, 6), (Gait.WALKING, 16))]

    def full(self) -> list[RandomCommandsConfig]:
        """Return 256 episodes of every gait, as long as those of single commands."""
        gaits = (Gait.STANDING, Gait.WALKING, Gait.JUMPING, Gait.HOPPING_LEFT)
        return [RandomCommandsConfig(gait, gait.hops, episodes=256, duration=21.0) for gait in gaits]

    def figures(self, controller: str, result: Mapping[str, Any]) -> list[Figure]:
        """Return the errors of the episodes without a fall, and the falls."""
        table = _table(result["gait"])
        errors = {name: errors for name, errors in combined_errors(result["rows"]).items() if errors}
        return [
            *(Figure(table, n, ERROR_UNITS[n], controller, bootstrap_mean(found)) for n, found in errors.items()),
            falls_figure(table, controller, result["rows"]),
        ]

    def across(self, results: Mapping[str, Sequence[Measured]]) -> list[Figure]:
        """Return the ratios of the errors to those of single commands of the same controller and gait."""
        figures = []
        single = {(name, r["gait"]): r["rows"] for name, r in results.get(SingleCommandProtocol.name, ())}
        for controller, result in results.get(self.name, ()):
            rows = single.get((controller, result["gait"]), ())
            ratios = error_ratios(combined_errors(result["rows"]), single_errors(rows))
            for name, ratio in ratios.items():
                figures.append(Figure(_table(result["gait"]), f"{name}, over that alone", "", controller, ratio))
        return figures


def _table(gait: str) -> str:
    return f"All commands at once, {gait}"


def _error_lines(result: RandomCommandsResult) -> list[str]:
    """Return a table of the errors beside those of single commands; nothing if every episode ended in a fall."""
    rows = []
    for name, estimate in result.intervals.items():
        alone, ratio = result.single.get(name), result.ratios.get(name)
        if estimate.value is not None:
            cells = (four_decimals(estimate.value), interval_text(estimate), alone and four_decimals(alone.value))
            ratios = (None, None) if ratio is None or ratio.value is None else (ratio.value, interval_text(ratio, 2))
            rows.append((name, ERROR_UNITS[name], *cells, *ratios))
    if not rows:
        return []
    header = ("error without a fall", "unit", result.controller, INTERVAL, "alone", "ratio", INTERVAL)
    lines = [format_table(header, rows), ""]
    if not result.single:
        lines.append("alone: nothing stored; run `hugwbc evaluate single-command` with the same options first")
    return lines


def _falls_by_third(result: RandomCommandsResult) -> dict[str, dict[str, str]]:
    counts: dict[str, dict[str, str]] = {}
    for combination in result.combinations:
        if len(combination.parts) == 1:
            ((name, part),) = combination.parts.items()
            counts.setdefault(name, {})[part] = f"{combination.falls} of {combination.episodes}"
    return dict(sorted(counts.items(), key=lambda item: list(result.rows[0].command).index(item[0])))


def _label(combination: Combination) -> str:
    return ", ".join(f"{name} {part}" for name, part in combination.parts.items())

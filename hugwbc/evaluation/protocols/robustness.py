"""How much a robot may differ from its description: one factor at a time, over a grid of values.

The factors are payload, friction, sensor latency, joint gains, motor strength, roughness and slope of the ground. Every
value is tested with the same sampled single commands as the unchanged robot, so that the ratio of the errors is the
cost of the difference.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hugwbc.errors import ConfigError
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.figures import Figure
from hugwbc.evaluation.intervals import Estimate, wilson_percentage
from hugwbc.evaluation.paper import ERROR_NAMES
from hugwbc.evaluation.picture_data import XY, Curves
from hugwbc.evaluation.protocols.episodes import GaitSettings, ProtocolResult, Run, SettledJudge, mean
from hugwbc.evaluation.protocols.protocol import Measured, PlannedProtocol, count_text, failure_lines
from hugwbc.evaluation.protocols.single_command import Episode, judged, sampled_commands, stratified_samples
from hugwbc.evaluation.tables import format_table
from hugwbc.gait import Gait

NOMINAL = "nominal"
# Fields of Conditions, and the values of each.
GRID: Mapping[str, tuple[float, ...]] = {
    "payload": (-2.0, 5.0, 10.0, 15.0),  # [kg]
    "friction": (0.2, 0.4, 0.6, 1.2),
    "latency": (0.005, 0.01, 0.02, 0.04),  # [s]
    "gain": (0.8, 0.9, 1.1, 1.2),
    "strength": (0.7, 0.8, 0.9, 1.1),
    "terrain_roughness": (0.01, 0.02, 0.03),  # [m]
    "slope": (-0.087, 0.087),  # [rad], 5 degrees down and up
}
GRID_UNITS = {"payload": "kg", "latency": "s", "terrain_roughness": "m", "slope": "rad"}


@dataclasses.dataclass(frozen=True)
class RobustnessConfig(GaitSettings):
    """Settings of the robustness protocol, in addition to `GaitSettings`.

    Attributes:
        samples: number of episodes of each value, split evenly over the commands of the gait.
    """

    samples: int = 8

    def __post_init__(self) -> None:
        super().__post_init__()
        least = len(sampled_commands(self.gait))
        if self.samples < least:
            raise ConfigError(f"samples is {self.samples}; the {self.gait.label} gait needs at least {least}")
        for slope in GRID["slope"]:
            dataclasses.replace(self.conditions, slope=slope).check_duration(self.duration)

    @property
    def episodes(self) -> int:
        """Number of episodes in all, those of the unchanged robot included."""
        return self.samples * (1 + sum(len(values) for values in GRID.values()))


@dataclasses.dataclass(frozen=True)
class RobustnessEpisode(Episode):
    """One episode of a single command on a changed robot, in addition to `Episode`.

    Attributes:
        factor: what differs, a key of `GRID`, or "nominal".
        level: value of the factor; 0 for "nominal".
    """

    factor: str
    level: float


@dataclasses.dataclass(frozen=True)
class RobustnessLevel:
    """Summary of one value of one factor.

    Attributes:
        factor: what differs, a key of `GRID`, or "nominal".
        level: value of the factor; 0 for "nominal".
        falls: number of episodes in which the robot fell.
        episodes: number of episodes.
        errors: mean of the episodes' errors by the paper's names, without episodes with a fall.
        ratio: error over the unchanged robot's error, averaged over the paper's errors; only commands with which
            neither robot fell count. None if there is none.
    """

    factor: str
    level: float
    falls: int
    episodes: int
    errors: dict[str, float | None]
    ratio: float | None


@dataclasses.dataclass(frozen=True, kw_only=True)
class RobustnessResult(ProtocolResult[RobustnessEpisode]):
    """Result of the robustness protocol, in addition to `ProtocolResult`.

    Attributes:
        samples: number of episodes of each value.
        levels: summary of each value, that of the unchanged robot first.
    """

    samples: int
    levels: tuple[RobustnessLevel, ...]


def grid_levels() -> list[tuple[str, float]]:
    """Return factor and value of all cells, the unchanged robot first."""
    return [(NOMINAL, 0.0), *((factor, value) for factor, values in GRID.items() for value in values)]


def robustness_level(rows: Sequence[RobustnessEpisode], nominal: Sequence[RobustnessEpisode]) -> RobustnessLevel:
    """Summarise the episodes of one value.

    Args:
        rows: episodes of that value.
        nominal: episodes of the unchanged robot, with the same commands in the same order.
    """
    upright = [(row, base) for row, base in zip(rows, nominal, strict=True) if not (row.fell or base.fell)]

    def error(name: str, part: int) -> float | None:
        return mean(pair[part].error for pair in upright if pair[0].error_name == name)

    both = {name: (error(name, 0), error(name, 1)) for name in ERROR_NAMES}
    return RobustnessLevel(
        factor=rows[0].factor,
        level=rows[0].level,
        falls=sum(row.fell for row in rows),
        episodes=len(rows),
        errors={
            name: mean(row.error for row in rows if row.error_name == name and not row.fell) for name in ERROR_NAMES
        },
        ratio=mean(own / base for own, base in both.values() if own is not None and base),
    )


class RobustnessJudge(SettledJudge):
    """Judge that reads factor, value and sampled command from the plan's label."""

    def __call__(self, index: int, run: Run) -> RobustnessEpisode:
        """Return the row of one episode."""
        factor, level, name = run.plan.label.split()
        row = judged(run, name, self.settle)
        return RobustnessEpisode(**dataclasses.asdict(row), factor=factor, level=float(level))


class RobustnessProtocol(PlannedProtocol[RobustnessConfig, RobustnessEpisode, RobustnessResult]):
    """Single commands on robots that differ from their description."""

    name = "robustness"
    summary = "payload, friction, latency, gains, motors and ground, one at a time"
    settings = RobustnessConfig
    result = RobustnessResult
    report_title = "Robustness"
    report_text = (
        "One factor at a time differs from the robot that the controllers know. Errors are relative to those of the "
        "unchanged robot on the same commands. Episodes with a fall are left out of them and counted."
    )

    def plans(self, settings: RobustnessConfig) -> list[EpisodePlan]:
        """Return the same sampled commands for every value, the unchanged robot first."""
        samples = stratified_samples(settings, settings.samples)
        plans = []
        for name, value in grid_levels():
            change = {} if name == NOMINAL else {name: value}
            conditions = dataclasses.replace(settings.conditions, **change)
            label = f"{name} {value!r}"
            plans += [
                EpisodePlan(command, conditions=conditions, draw=draw, label=f"{label} {sampled}")
                for draw, (sampled, command) in enumerate(samples)
            ]
        return plans

    def judge(self, settings: RobustnessConfig) -> RobustnessJudge:
        """Return the judge of the sampled command's error."""
        return RobustnessJudge(settings.settle)

    def summarise(self, settings: RobustnessConfig, rows: Sequence[RobustnessEpisode]) -> dict[str, Any]:
        """Return the summary of each value."""
        parts = [rows[start : start + settings.samples] for start in range(0, len(rows), settings.samples)]
        return {
            "samples": settings.samples,
            "levels": tuple(robustness_level(part, parts[0]) for part in parts),
        }

    def describe(self, result: RobustnessResult) -> str:
        """Return falls and relative errors for each value of each factor."""
        rows = []
        for level in result.levels:
            value = "" if level.factor == NOMINAL else f" {level.level:g} {GRID_UNITS.get(level.factor, '')}".rstrip()
            name = level.factor.replace("terrain_roughness", "roughness")
            rows.append((f"{name}{value}", count_text(level.falls, level.episodes), level.ratio))
        table = format_table((f"{result.gait}, {result.controller}", "falls", "errors over nominal"), rows)
        return "\n".join([table, *failure_lines(result.rows)])

    def quick(self) -> list[RobustnessConfig]:
        """Return one short episode of each value and command of standing."""
        return [RobustnessConfig(Gait.STANDING, samples=3, duration=2.5)]

    def full(self) -> list[RobustnessConfig]:
        """Return 64 episodes of each value, standing and walking."""
        return [RobustnessConfig(gait, samples=64) for gait in (Gait.STANDING, Gait.WALKING)]

    def figures(self, controller: str, result: Mapping[str, Any]) -> list[Figure]:
        """Return what each value costs: the error relative to the unchanged robot's, and the falls."""
        title, ratios, falls = f"Robustness, {result['gait']}", [], []
        for level in result["levels"]:
            factor = level["factor"]
            label = factor if factor == NOMINAL else f"{factor} {level['level']:g} {GRID_UNITS.get(factor, '')}".strip()
            rows = [r for r in result["rows"] if (r["factor"], r["level"]) == (factor, level["level"])]
            estimate = Estimate(level["ratio"], None, None, len(rows))
            ratios.append(Figure(f"{title}: error over the unchanged robot's", label, "", controller, estimate))
            fell = wilson_percentage([row["fell"] for row in rows])
            falls.append(Figure(f"{title}: falls", label, "% of episodes", controller, fell))
        return [*ratios[1:], *falls]

    def pictures(self, measured: Sequence[Measured], controllers: Sequence[str]) -> list[Curves]:
        """Return the relative error over the value of each factor, for each gait."""
        pictures = []
        for gait in dict.fromkeys(result["gait"] for _, result in measured):
            found = {name: result["levels"] for name, result in measured if result["gait"] == gait}
            for factor in dict.fromkeys(level["factor"] for levels in found.values() for level in levels[1:]):
                series = {name: _levels(found.get(name, ()), factor) for name in controllers}
                extent = np.concatenate([x for x, _ in series.values()])
                one = (np.array([extent.min(), extent.max()]), np.ones(2))
                labels = (f"{factor} {GRID_UNITS.get(factor, '')}".strip(), "times the error")
                pictures.append(Curves(f"{factor}, {gait}", series, labels, dashed=one, bottom=0.0))
        return pictures


def _levels(levels: Sequence[Mapping[str, Any]], factor: str) -> XY:
    """Return the values of a factor in rising order, and the relative errors."""
    mine = sorted((level["level"], level["ratio"]) for level in levels if level["factor"] == factor)
    return np.array([x for x, _ in mine]), np.array([math.nan if y is None else y for _, y in mine])

"""The paper's test on the real robot, in simulation: p and w go from their minimum to their maximum, in five runs.

Each run uses another robot: ground friction, payload and joint gains are drawn from the training's ranges.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hugwbc.commands import Command, command_ranges, default_command
from hugwbc.errors import ConfigError
from hugwbc.evaluation.engine import EpisodePlan, Knot, Schedule
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import Estimate, bootstrap_mean
from hugwbc.evaluation.metrics import tracking_errors
from hugwbc.evaluation.paper import real_robot_errors
from hugwbc.evaluation.picture_data import XY, Curves
from hugwbc.evaluation.protocols.episodes import CountedSettings, GroupedResult, Run, SettledJudge, known, mean
from hugwbc.evaluation.protocols.protocol import (
    INTERVAL,
    INTERVAL_NOTE,
    Measured,
    PlannedProtocol,
    beside_paper,
    count_text,
)
from hugwbc.evaluation.tables import format_table
from hugwbc.gait import Gait
from hugwbc.kinematics import MEASURED_NAMES

RAMPED = ("p", "w")
_START, _APPROACH = 1.0, 2.0  # [s] at the default command, and from there to the minimum
_CURVE_POINTS = 21


@dataclasses.dataclass(frozen=True)
class RampConfig(CountedSettings):
    """Settings of the ramp protocol, in addition to `CountedSettings`.

    Attributes:
        episodes: number of runs of each command.
        duration: length of an episode, with which the ramp ends [s].
        settle: start of the ramp [s].
    """

    episodes: int = 5
    _: dataclasses.KW_ONLY
    duration: float = 14.0
    settle: float = 4.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.settle < _START + _APPROACH:
            raise ConfigError(f"the ramp begins at settle = {self.settle} s; give {_START + _APPROACH} s or more")
        if self.gait.hops:
            raise ConfigError("hopping does not command p and w; choose another gait")


@dataclasses.dataclass(frozen=True)
class RampEpisode:
    """One run.

    Attributes:
        command: "p" or "w".
        error: mean absolute error during the ramp [rad]; None if the robot fell before the ramp began.
        curve: measured value [rad] by commanded value, at up to 21 commanded values; without those after a fall.
        fell: whether the robot fell.
        survived_s: time until the fall, or the whole episode [s].
        payload, friction, gain: of this run's robot, as in `Conditions`.
    """

    command: str
    error: float | None
    curve: dict[str, float]
    fell: bool
    survived_s: float
    payload: float
    friction: float | None
    gain: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class RampResult(GroupedResult[RampEpisode]):
    """Result of the ramp protocol, whose groups are the commands, in addition to `GroupedResult`.

    Attributes:
        errors: mean of the runs' errors, E_p and E_w [rad].
        intervals: the same means with their intervals.
        paper: the paper's errors on the real robot [rad].
    """

    errors: dict[str, float | None]
    intervals: dict[str, Estimate] = dataclasses.field(default_factory=dict)
    paper: dict[str, float]


def ramp_schedule(config: RampConfig, name: str) -> Schedule:
    """Go from the default command to one command's minimum, then linearly from `settle` to the end to its maximum."""
    low, high = command_ranges(config.gait)[name].finishing
    start = default_command(config.gait)

    def at(value: float) -> Command:
        return dataclasses.replace(start, **{name: value})

    ramp = config.duration - config.settle
    return Schedule((Knot(0.0, start), Knot(_START, at(low), _APPROACH), Knot(config.settle, at(high), ramp)))


class RampJudge(SettledJudge):
    """Judge of a run by the command that its plan's label names."""

    def __call__(self, index: int, run: Run) -> RampEpisode:
        """Return the row of one run."""
        name, trace, conditions = run.plan.label, run.trace, run.plan.conditions
        assert conditions is not None and isinstance(run.plan.commands, Schedule)
        last = run.plan.commands.knots[-1]
        times = last.time + last.ramp * np.arange(_CURVE_POINTS) / (_CURVE_POINTS - 1)
        samples = np.searchsorted(trace.time, times - 1e-9)
        measured = trace.measured[:, MEASURED_NAMES.index(name)]
        low, high = command_ranges(run.command.gait)[name].finishing
        values = np.linspace(low, high, _CURVE_POINTS)
        # The end of the ramp is the end of the episode, one sample after the last.
        samples = np.where(math.isclose(trace.survived_s, times[-1]), np.minimum(samples, len(measured) - 1), samples)
        kept = samples < len(measured)
        return RampEpisode(
            command=name,
            error=known(tracking_errors(trace, self.settle)[name]),
            curve={f"{v:.3f}": float(m) for v, m in zip(values[kept], measured[samples[kept]], strict=True)},
            fell=trace.fell,
            survived_s=trace.survived_s,
            payload=conditions.payload,
            friction=conditions.friction,
            gain=conditions.gain,
        )


class RampProtocol(PlannedProtocol[RampConfig, RampEpisode, RampResult]):
    """The paper's ramps of p and w."""

    name = "ramp"
    summary = "ramp p and w from their minimum to their maximum, as on the paper's real robot"
    settings = RampConfig
    result = RampResult
    fixed = frozenset({"payload", "friction", "gain"})  # drawn for every run
    report_title = "Ramp"
    report_text = (
        "p and w go from minimum to maximum. Every run has a robot with other friction, payload and gains. The paper's "
        "figures are from its real robot, ours from simulation."
    )

    def plans(self, settings: RampConfig) -> list[EpisodePlan]:
        """Return the runs of p, then those of w, on the same drawn robots."""
        return [
            EpisodePlan(
                ramp_schedule(settings, name),
                conditions=settings.conditions.of_a_drawn_robot(np.random.default_rng((settings.seed, draw))),
                draw=draw,
                label=name,
            )
            for name in RAMPED
            for draw in range(settings.episodes)
        ]

    def judge(self, settings: RampConfig) -> RampJudge:
        """Return the judge of the error during the ramp."""
        return RampJudge(settings.settle)

    def summarise(self, settings: RampConfig, rows: Sequence[RampEpisode]) -> dict[str, Any]:
        """Return falls and mean errors of both commands, with the paper's."""
        parts = {name: [row for row in rows if row.command == name] for name in RAMPED}
        return {
            "episodes": settings.episodes,
            "falls": {name: sum(row.fell for row in part) for name, part in parts.items()},
            "errors": {f"E_{name}": mean(row.error for row in part) for name, part in parts.items()},
            "intervals": {f"E_{name}": bootstrap_mean(row.error for row in part) for name, part in parts.items()},
            "paper": dict(real_robot_errors(settings.gait)),
        }

    def describe(self, result: RampResult) -> str:
        """Return the errors during the ramps with the paper's on the real robot, and the falls."""
        rows = [
            beside_paper(name, error, result.intervals.get(name), result.paper.get(name))
            for name, error in result.errors.items()
        ]
        header = (f"{result.gait}, ramp [rad]", result.controller, INTERVAL, "paper (real robot)", "ratio")
        falls = ", ".join(f"{name} {count_text(n, result.episodes, 'runs')}" for name, n in result.falls.items())
        return f"{format_table(header, rows)}\n\nfalls: {falls}\n{INTERVAL_NOTE}"

    def quick(self) -> list[RampConfig]:
        """Return two short runs of each command."""
        return [RampConfig(gait, episodes=2, duration=10.0) for gait in (Gait.STANDING, Gait.WALKING, Gait.JUMPING)]

    def full(self) -> list[RampConfig]:
        """Return the paper's five runs of each command."""
        return [RampConfig(gait, episodes=5) for gait in (Gait.STANDING, Gait.WALKING, Gait.JUMPING)]

    def figures(self, controller: str, result: Mapping[str, Any]) -> list[Figure]:
        """Return the errors of p and w, and the falls."""
        table = f"Ramp, {result['gait']}"
        figures = [
            Figure(
                table,
                f"E_{command}",
                "rad",
                controller,
                bootstrap_mean([row["error"] for row in result["rows"] if row["command"] == command]),
                result["paper"].get(f"E_{command}"),
            )
            for command in RAMPED
        ]
        return [*figures, falls_figure(table, controller, result["rows"])]

    def pictures(self, measured: Sequence[Measured], controllers: Sequence[str]) -> list[Curves]:
        """Return measured over commanded value, averaged over the runs, for each gait and command."""
        pictures = []
        for gait in dict.fromkeys(result["gait"] for _, result in measured):
            for command in RAMPED:
                found = {name: _mean_curve(r["rows"], command) for name, r in measured if r["gait"] == gait}
                nothing = (np.zeros(0), np.zeros(0))
                series = {name: found.get(name, nothing) for name in controllers}
                commanded = np.unique(np.concatenate([x for x, _ in series.values()]))
                labels = (f"commanded {command} [rad]", "measured [rad]")
                pictures.append(Curves(f"{command}, {gait}", series, labels, dashed=(commanded, commanded)))
        return pictures


def _mean_curve(rows: Sequence[Mapping[str, Any]], command: str) -> XY:
    """Return the commanded values, and the mean of what the runs that got there measured."""
    curves = [row["curve"] for row in rows if row["command"] == command]
    values = sorted({float(value) for curve in curves for value in curve})
    means = [float(np.mean([m for c in curves for v, m in c.items() if float(v) == value])) for value in values]
    return np.array(values), np.array(means)

"""The paper's table of single-command tracking errors.

Each command is sampled over its finishing range while the others stay at their defaults, one episode per sample. The
samples are stratified: the range of a command is cut into as many equal parts as it has episodes, and each part gets
one uniform sample, so that even few episodes cover the whole range.
"""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from hugwbc.commands import COMMAND_NAMES, Command, command_ranges, default_command
from hugwbc.evaluation import metrics
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import Estimate, bootstrap_mean
from hugwbc.evaluation.paper import ERROR_NAMES, ERROR_UNITS, error_name, other_controllers, single_command_errors
from hugwbc.evaluation.protocols.episodes import (
    CountedResult,
    CountedSettings,
    GaitSettings,
    Run,
    SettledJudge,
    known,
    mean,
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
from hugwbc.evaluation.tables import format_table
from hugwbc.gait import Gait
from hugwbc.runtime.trace import Trace

# Figures of `metrics.Impact` that are summarised, with their names and units.
IMPACTS = {
    "speed_median": ("touch-down speed, median", "m/s"),
    "speed_p95": ("touch-down speed, 95th percentile", "m/s"),
    "total_speed_median": ("touch-down speed with its horizontal part, median", "m/s"),
    "peak_mean": ("peak foot force of 10 ms, mean of stances", "body weights"),
    "peak_max": ("peak foot force of 10 ms, maximum", "body weights"),
}
SLOW_SPEED = 0.6  # [m/s]; falls at commanded speeds up to this are counted separately


@dataclasses.dataclass(frozen=True)
class SingleCommandConfig(CountedSettings):
    """Settings of the single-command protocol, in addition to `CountedSettings`.

    Attributes:
        episodes: number of episodes in all, split evenly over the commands of the gait.
        ends: draw each command at the two ends of its range, half of its episodes at each, instead of inside.
    """

    episodes: int = 128  # 16 for each of the eight commands of walking
    _: dataclasses.KW_ONLY
    ends: bool = False

    @property
    def least(self) -> tuple[int, str]:
        """One episode for each command of the gait."""
        return len(sampled_commands(self.gait)), f"one per command of the {self.gait.label} gait"


@dataclasses.dataclass(frozen=True)
class Episode:
    """One episode of a single command.

    Attributes:
        gait: label of the gait.
        command: name of the sampled command.
        value: value of the sampled command.
        error_name: the paper's name of the error that the episode counts towards.
        error: that error; None if the robot fell before it could be measured.
        fell: whether the robot fell.
        survived_s: time until the fall, or the whole episode [s].
        arm_error: mean distance of the arm joints to their external targets [rad]; None without such targets.
        foot_travel: summed path length of both feet after the settling time [m]; standing only.
        foot_creep: part of `foot_travel` that is MuJoCo's creep of firmly standing feet [m].
        held_foot_contact: fraction of the time in which the held leg touched the ground; hopping only.
        hop_frequency_error: mean difference between hops per second and the clock's frequency [Hz]; hopping only.
        impact: `metrics.Impact` of the episode; None without a touch-down.
        failures: number of exceptions of the controller that the safety filter caught.
    """

    gait: str
    command: str
    value: float
    error_name: str
    error: float | None
    fell: bool
    survived_s: float
    arm_error: float | None
    foot_travel: float | None
    foot_creep: float | None
    held_foot_contact: float | None
    hop_frequency_error: float | None
    impact: dict[str, float] | None
    failures: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class SingleCommandResult(CountedResult[Episode]):
    """Result of the single-command protocol, in addition to `CountedResult`.

    Attributes:
        episodes_slow: number of episodes with a commanded horizontal speed of at most 0.6 m/s.
        falls_slow: number of these in which the robot fell.
        fall_rate_slow: falls_slow / episodes_slow.
        errors: mean error of the episodes by the paper's names; None where the gait has no such command.
        intervals: the same means with their intervals.
        impact: means over the episodes of the figures in `IMPACTS`, with their intervals, but the maximum over all
            episodes of the largest peak, without an interval. Empty if no foot ever came down.
        arm_error: mean over the episodes with external control of the arms [rad].
        foot_travel: mean over the episodes without a fall, whose paths would be short [m]; standing only.
        held_foot_contact: mean over the episodes; hopping only.
        hop_frequency_error: mean over the episodes [Hz]; hopping only. The paper has no such figure.
        paper: the paper's errors under the same intervention, for the names that it reports.
    """

    episodes_slow: int
    falls_slow: int
    fall_rate_slow: float
    errors: dict[str, float | None]
    intervals: dict[str, Estimate] = dataclasses.field(default_factory=dict)
    impact: dict[str, Estimate] = dataclasses.field(default_factory=dict)
    arm_error: float | None
    foot_travel: float | None
    held_foot_contact: float | None
    hop_frequency_error: float | None
    paper: dict[str, float]


def sampled_commands(gait: Gait) -> tuple[str, ...]:
    """Return the commands whose range under a gait is more than one value; foot commands are left out for standing."""
    names = [name for name, limits in command_ranges(gait).items() if limits.finishing[0] < limits.finishing[1]]
    return tuple(name for name in names if gait is not Gait.STANDING or name not in ("f", "l"))


def stratified_samples(config: GaitSettings, episodes: int, *, ends: bool = False) -> list[tuple[str, Command]]:
    """Sample single commands, stratified over their finishing ranges.

    Args:
        config: settings, of which gait and seed are used.
        episodes: number of samples in all, split evenly over the commands of the gait.
        ends: take the two ends of each range, each half of the times, instead of samples of its inside.

    Returns:
        Name of the sampled command and the whole command, for every episode.
    """
    rng = np.random.default_rng(config.seed)
    names = sampled_commands(config.gait)
    share, rest = divmod(episodes, len(names))
    samples: list[tuple[str, Command]] = []
    for position, name in enumerate(names):
        count = share + (position < rest)
        low, high = command_ranges(config.gait)[name].finishing
        # One uniform sample in each of `count` equal parts of the range.
        values = low + (high - low) * (np.arange(count) + rng.uniform(size=count)) / count
        if ends:
            values = np.where(np.arange(count) < count / 2, low, high)
        for index, value in enumerate(values):
            samples.append(
                (name, dataclasses.replace(default_command(config.alternating[index % 2]), **{name: float(value)}))
            )
    return samples


class SingleCommandJudge(SettledJudge):
    """Judge of an episode by the error of the command that its plan's label names."""

    def __call__(self, index: int, run: Run) -> Episode:
        """Return the row of one episode."""
        return judged(run, run.plan.label, self.settle)


def judged(run: Run, name: str, settle: float) -> Episode:
    """Return the row of an episode in which the command `name` was sampled, without its first `settle` seconds."""
    command, trace = run.command, run.trace
    value = float(command.array()[COMMAND_NAMES.index(name)])
    standing = command.gait is Gait.STANDING
    impact = metrics.impact(trace, settle)
    return Episode(
        gait=command.gait.label,
        command=name,
        value=value,
        error_name=error_name(name, value),
        error=known(episode_error(trace, name, settle)),
        fell=trace.fell,
        survived_s=trace.survived_s,
        arm_error=known(run.arm_error),
        foot_travel=known(metrics.foot_travel(trace, settle)) if standing else None,
        foot_creep=known(metrics.foot_creep(trace, settle)) if standing else None,
        held_foot_contact=known(metrics.held_foot_contact(trace, settle)),
        hop_frequency_error=known(metrics.frequency_error(trace, settle)) if command.gait.hops else None,
        impact=None if impact is None else dataclasses.asdict(impact),
        failures=trace.safety.failures,
    )


def episode_error(trace: Trace, command: str, settle: float) -> float:
    """Return the error of one command over a run; NaN if the run did not last beyond `settle` [s]."""
    if command == "f":
        return metrics.frequency_error(trace, settle)
    if command == "l":
        return metrics.swing_height_error(trace, settle)
    return metrics.tracking_errors(trace, settle)[command]


def impact_estimates(impacts: Iterable[Mapping[str, float] | None]) -> dict[str, Estimate]:
    """Return the figures of `IMPACTS` over all episodes; nothing if no foot ever came down.

    Args:
        impacts: `Episode.impact` of each episode.
    """
    known_impacts = [impact for impact in impacts if impact is not None]
    if not known_impacts:
        return {}
    found = {name: bootstrap_mean(impact[name] for impact in known_impacts) for name in IMPACTS}
    # The maximum grows with the number of episodes, so that a mean or its interval would say nothing about it.
    found["peak_max"] = Estimate(max(i["peak_max"] for i in known_impacts), None, None, len(known_impacts))
    return found


class SingleCommandProtocol(PlannedProtocol[SingleCommandConfig, Episode, SingleCommandResult]):
    """The paper's tracking errors of single commands."""

    name = "single-command"
    summary = "sample each command over its range, the others at their defaults"
    settings = SingleCommandConfig
    result = SingleCommandResult
    report_title = "Single commands"
    report_text = (
        "One command is sampled over its range while the others stay at their defaults. Foot commands (f, l) are "
        "judged over complete gait cycles, the others over control steps. The impact of a "
        "foot after a swing is the sole's vertical speed in the physics step before the touch-down, and the largest "
        "vertical force on the foot in the stance after it. The figures of HOVER and ExBody are the paper's; they were "
        "not run here."
    )

    def plans(self, settings: SingleCommandConfig) -> list[EpisodePlan]:
        """Return an episode for each stratified sample; its label names the sampled command."""
        samples = stratified_samples(settings, settings.episodes, ends=settings.ends)
        return [EpisodePlan(command, label=name) for name, command in samples]

    def judge(self, settings: SingleCommandConfig) -> SingleCommandJudge:
        """Return the judge of the sampled command's error."""
        return SingleCommandJudge(settings.settle)

    def summarise(self, settings: SingleCommandConfig, rows: Sequence[Episode]) -> dict[str, Any]:
        """Return mean errors by the paper's names, and the falls at low speeds."""
        errors = {error: [row.error for row in rows if row.error_name == error] for error in ERROR_NAMES}
        slow = [row for row in rows if row.command not in ("v_x", "v_y") or abs(row.value) <= SLOW_SPEED]
        falls_slow = sum(row.fell for row in slow)
        return {
            "episodes_slow": len(slow),
            "falls_slow": falls_slow,
            "fall_rate_slow": falls_slow / len(slow) if slow else 0.0,
            "errors": {error: mean(values) for error, values in errors.items()},
            "intervals": {error: bootstrap_mean(values) for error, values in errors.items()},
            "impact": impact_estimates(row.impact for row in rows),
            "arm_error": mean(row.arm_error for row in rows),
            "foot_travel": mean(row.foot_travel for row in rows if not row.fell),
            "held_foot_contact": mean(row.held_foot_contact for row in rows),
            "hop_frequency_error": mean(row.hop_frequency_error for row in rows),
            "paper": dict(single_command_errors(settings.gait, settings.conditions.intervention)),
        }

    def describe(self, result: SingleCommandResult) -> str:
        """Return the errors as a table with the paper's, the impacts of the feet, and the falls."""
        rows = []
        for name, unit in ERROR_UNITS.items():
            error, paper = result.errors[name], result.paper.get(name)
            if error is None and paper is None:
                continue
            ratio = error / paper if error is not None and paper is not None else None
            interval = interval_text(result.intervals.get(name))
            rows.append((name, unit, four_decimals(error), interval, paper, ratio))
        lines = [format_table(("error", "unit", result.controller, INTERVAL, "paper", "ratio"), rows), ""]
        if result.impact:
            impacts = [
                (*IMPACTS[name], f"{found.value:.3f}", interval_text(found, 3)) for name, found in result.impact.items()
            ]
            lines += [format_table(("impact", "unit", result.controller, INTERVAL), impacts), ""]
        lines.append(f"falls: {count_text(result.falls, result.episodes)}; ")
        lines[-1] += f"at |v| <= 0.6 m/s {count_text(result.falls_slow, result.episodes_slow)}"
        if result.foot_travel is not None:
            seconds = result.duration - result.settle
            lines.append(f"foot travel: {result.foot_travel:.3f} m of both feet in {seconds:g} s")
        if result.held_foot_contact is not None:
            lines.append(f"held foot on the ground: {100 * result.held_foot_contact:.1f} % of the time")
        if result.hop_frequency_error is not None:
            lines.append(f"hops per second: {result.hop_frequency_error:.3f} Hz from the clock's frequency")
        if result.arm_error is not None:
            lines.append(f"arm joints: {result.arm_error:.3f} rad from their external targets on average")
        return "\n".join([*lines, INTERVAL_NOTE, *failure_lines(result.rows)])

    def quick(self) -> list[SingleCommandConfig]:
        """Return few episodes of every gait."""
        episodes = {Gait.STANDING: 6, Gait.WALKING: 16, Gait.JUMPING: 16, Gait.HOPPING_LEFT: 8}
        return [SingleCommandConfig(g, g.hops, episodes=count, duration=5.0) for g, count in episodes.items()]

    def full(self) -> list[SingleCommandConfig]:
        """Return 256 episodes of every gait, 20 s after the settling time as in the paper."""
        gaits = (Gait.STANDING, Gait.WALKING, Gait.JUMPING, Gait.HOPPING_LEFT)
        return [SingleCommandConfig(gait, gait.hops, episodes=256, duration=21.0) for gait in gaits]

    def figures(self, controller: str, result: Mapping[str, Any]) -> list[Figure]:
        """Return the tracking errors by the paper's names, the impacts of the feet, and the falls."""
        table, figures = _table(result["gait"]), []
        for error in ERROR_NAMES:
            errors = [row["error"] for row in result["rows"] if row["error_name"] == error]
            paper = result["paper"].get(error)
            if errors or paper is not None:
                figures.append(Figure(table, error, ERROR_UNITS[error], controller, bootstrap_mean(errors), paper))
        for name, estimate in impact_estimates(row.get("impact") for row in result["rows"]).items():
            quantity, unit = IMPACTS[name]
            figures.append(Figure(table, quantity, unit, controller, estimate))
        return [*figures, falls_figure(table, controller, result["rows"])]

    def published(self, measured: Sequence[Measured]) -> list[Figure]:
        """Return what the paper prints for other controllers' walking."""
        return [
            Figure(_table(Gait.WALKING.label), error, ERROR_UNITS[error], name, None, published=value)
            for name, errors in (other_controllers() if measured else {}).items()
            for error, value in errors.items()
        ]


def _table(gait: str) -> str:
    return f"Single command, {gait}"

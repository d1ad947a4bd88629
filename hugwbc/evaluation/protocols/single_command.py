"""The paper's table of single-command tracking errors.

Each command is sampled over its finishing range while the others stay at their defaults; one episode per sample. The
samples of a command are stratified: its range is cut into as many equal parts as it has episodes, and each part gets
one uniform sample, so that few episodes cover the whole range as well.
"""

import dataclasses
from collections.abc import Callable

import numpy as np

from hugwbc.commands import COMMAND_NAMES, Command, command_ranges, default_command
from hugwbc.evaluation import metrics
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.paper import ERROR_NAMES, error_name, single_command_errors
from hugwbc.evaluation.protocols.episodes import (
    ControllerFactory,
    CountedResult,
    CountedSettings,
    GaitSettings,
    Run,
    known,
    mean,
    run_episodes,
)
from hugwbc.gait import Gait
from hugwbc.runtime.trace import Trace

SLOW_SPEED = 0.6  # [m/s]; falls at commanded speeds up to this are counted apart


@dataclasses.dataclass(frozen=True)
class SingleCommandConfig(CountedSettings):
    """Settings of the protocol, beside those of any of one gait.

    Attributes:
        episodes: in all, split evenly over the commands of the gait.
    """

    episodes: int = 32

    @property
    def least(self) -> tuple[int, str]:
        """One for each command of the gait."""
        return len(sampled_commands(self.gait)), f"one per command of the {self.gait.label} gait"


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
        arm_error: mean distance of the arm joints to their external targets [rad].
        foot_travel: length of both feet's paths after the settling time, standing only [m].
        foot_creep: the part of it that is MuJoCo's creep of feet that stand firm [m].
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
    arm_error: float | None
    foot_travel: float | None
    foot_creep: float | None
    held_foot_contact: float | None
    failures: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class SingleCommandResult(CountedResult[Episode]):
    """Outcome of the protocol, beside what any has.

    Attributes:
        episodes_slow: episodes with a commanded horizontal speed of at most 0.6 m/s.
        falls_slow: in how many of these the robot fell.
        fall_rate_slow: falls_slow / episodes_slow.
        errors: mean of the episodes' errors by the paper's names; None where the gait has no such command.
        arm_error: mean over the episodes with external control of the arms [rad].
        foot_travel: mean over the episodes without a fall, which would have short paths, standing only [m].
        held_foot_contact: mean over the episodes, hopping only.
        paper: the paper's errors under the same intervention, for the names that it reports.
    """

    episodes_slow: int
    falls_slow: int
    fall_rate_slow: float
    errors: dict[str, float | None]
    arm_error: float | None
    foot_travel: float | None
    held_foot_contact: float | None
    paper: dict[str, float]


def sampled_commands(gait: Gait) -> tuple[str, ...]:
    """The commands whose range under a gait is more than one value; for standing without the foot commands."""
    names = [name for name, limits in command_ranges(gait).items() if limits.finishing[0] < limits.finishing[1]]
    return tuple(name for name in names if gait is not Gait.STANDING or name not in ("f", "l"))


def stratified_samples(config: GaitSettings, episodes: int) -> list[tuple[str, Command]]:
    """Name of the sampled command, and the whole command, of every episode, stratified over the finishing ranges.

    Args:
        config: whose gait and seed count.
        episodes: in all, split evenly over the commands of the gait.
    """
    rng = np.random.default_rng(config.seed)
    names = sampled_commands(config.gait)
    share, rest = divmod(episodes, len(names))
    samples: list[tuple[str, Command]] = []
    for position, name in enumerate(names):
        count = share + (position < rest)
        low, high = command_ranges(config.gait)[name].finishing
        values = low + (high - low) * (np.arange(count) + rng.uniform(size=count)) / count
        for index, value in enumerate(values):
            samples.append(
                (name, dataclasses.replace(default_command(config.alternating[index % 2]), **{name: float(value)}))
            )
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
    plans = [EpisodePlan(command, label=name) for name, command in stratified_samples(config, config.episodes)]
    rows = run_episodes(factory, plans, SingleCommandJudge(config.settle), config, on_episode)
    slow = [row for row in rows if row.command not in ("v_x", "v_y") or abs(row.value) <= SLOW_SPEED]
    falls_slow = sum(row.fell for row in slow)
    return SingleCommandResult.of(
        factory,
        config,
        rows,
        episodes_slow=len(slow),
        falls_slow=falls_slow,
        fall_rate_slow=falls_slow / len(slow) if slow else 0.0,
        errors={error: mean(row.error for row in rows if row.error_name == error) for error in ERROR_NAMES},
        arm_error=mean(row.arm_error for row in rows),
        foot_travel=mean(row.foot_travel for row in rows if not row.fell),
        held_foot_contact=mean(row.held_foot_contact for row in rows),
        paper=dict(single_command_errors(config.gait, config.conditions.intervention)),
    )


@dataclasses.dataclass(frozen=True)
class SingleCommandJudge:
    """Judges an episode by the error of the command that its plan's label names.

    Attributes:
        settle: start of the episode that is left out [s].
    """

    settle: float

    def __call__(self, index: int, run: Run) -> Episode:
        """The row of one episode."""
        return judged(run, run.plan.label, self.settle)


def judged(run: Run, name: str, settle: float) -> Episode:
    """The row of an episode in which the command `name` was sampled, without its first `settle` seconds."""
    command, trace = run.command, run.trace
    value = float(command.array()[COMMAND_NAMES.index(name)])
    standing = command.gait is Gait.STANDING
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
        failures=trace.safety.failures,
    )


def episode_error(trace: Trace, command: str, settle: float) -> float:
    """The error of one command over a run, NaN if it did not last beyond `settle` [s]."""
    if command == "f":
        return metrics.frequency_error(trace, settle)
    if command == "l":
        return metrics.swing_height_error(trace, settle)
    return metrics.tracking_errors(trace, settle)[command]

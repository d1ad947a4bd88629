"""Are small velocities followed, or ignored?

A reward that is flat near zero error gives a robot that stands still nearly all of its tracking reward at 0.1 m/s, and
the mean error of the paper's protocol hardly shows it. Here every episode commands v_x or v_y alone, 0.1 to 0.3 m/s
in either direction, and the figure is the fraction of it that is executed.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from hugwbc.commands import Command, default_command
from hugwbc.errors import ConfigError
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.intervals import Estimate, bootstrap_mean
from hugwbc.evaluation.protocols.episodes import CountedResult, CountedSettings, Run, SettledJudge, known, mean
from hugwbc.evaluation.protocols.protocol import (
    INTERVAL,
    INTERVAL_NOTE,
    PlannedProtocol,
    count_text,
    failure_lines,
    interval_text,
)
from hugwbc.evaluation.tables import format_table
from hugwbc.gait import Gait
from hugwbc.kinematics import MEASURED_NAMES

SMALL = (0.1, 0.3)  # [m/s]
DIRECTIONS = ("forward", "backward", "left", "right")


@dataclasses.dataclass(frozen=True)
class SmallVelocitiesConfig(CountedSettings):
    """Settings of the small-velocities protocol, in addition to `CountedSettings`.

    Attributes:
        episodes: number of episodes in all, split evenly over forward, backward, left and right.
    """

    episodes: int = 16

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gait is Gait.STANDING:
            raise ConfigError("standing has no velocities; choose another gait")

    @property
    def least(self) -> tuple[int, str]:
        """One episode for each direction."""
        return len(DIRECTIONS), "one per direction"


@dataclasses.dataclass(frozen=True)
class SmallVelocityEpisode:
    """One episode of a small velocity.

    Attributes:
        gait: label of the gait.
        direction: one of `DIRECTIONS`.
        speed: commanded speed [m/s].
        executed: mean velocity in that direction after the settling time, as a fraction of the commanded one; None
            if the robot fell before.
        fell: whether the robot fell.
        failures: number of exceptions of the controller that the safety filter caught.
    """

    gait: str
    direction: str
    speed: float
    executed: float | None
    fell: bool
    failures: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class SmallVelocitiesResult(CountedResult[SmallVelocityEpisode]):
    """Result of the small-velocities protocol, in addition to `CountedResult`.

    Attributes:
        executed: mean executed fraction by direction, over the episodes without a fall: 1 followed, 0 ignored.
        intervals: the same means with their intervals.
    """

    executed: dict[str, float | None]
    intervals: dict[str, Estimate] = dataclasses.field(default_factory=dict)


def sample_episodes(config: SmallVelocitiesConfig) -> list[Command]:
    """Return the command of every episode: directions in turn, speeds stratified over `SMALL`."""
    rng = np.random.default_rng(config.seed)
    rounds = -(-config.episodes // len(DIRECTIONS))
    commands = []
    for index in range(config.episodes):
        turn, direction = divmod(index, len(DIRECTIONS))
        speed = float(SMALL[0] + (SMALL[1] - SMALL[0]) * (turn + rng.uniform()) / rounds)
        gait = config.alternating[turn % 2]
        name, sign = ("v_x", "v_y")[direction // 2], 1.0 - 2.0 * (direction % 2)
        commands.append(dataclasses.replace(default_command(gait), **{name: sign * speed}))
    return commands


class SmallVelocitiesJudge(SettledJudge):
    """Judge of the executed fraction of the commanded velocity."""

    def __call__(self, index: int, run: Run) -> SmallVelocityEpisode:
        """Return the row of one episode."""
        trace, name = run.trace, "v_x" if run.command.v_x else "v_y"
        commanded = float(getattr(run.command, name))
        measured = trace.measured[trace.time >= self.settle, MEASURED_NAMES.index(name)]
        return SmallVelocityEpisode(
            gait=run.command.gait.label,
            direction=DIRECTIONS[index % len(DIRECTIONS)],
            speed=abs(commanded),
            executed=known(float(measured.mean()) / commanded) if measured.size else None,
            fell=trace.fell,
            failures=trace.safety.failures,
        )


class SmallVelocitiesProtocol(PlannedProtocol[SmallVelocitiesConfig, SmallVelocityEpisode, SmallVelocitiesResult]):
    """Small velocities in four directions."""

    name = "small-velocities"
    summary = "executed fraction of commanded speeds of 0.1 to 0.3 m/s"
    settings = SmallVelocitiesConfig
    result = SmallVelocitiesResult

    def plans(self, settings: SmallVelocitiesConfig) -> list[EpisodePlan]:
        """Return an episode for each sampled velocity."""
        return [EpisodePlan(command) for command in sample_episodes(settings)]

    def judge(self, settings: SmallVelocitiesConfig) -> SmallVelocitiesJudge:
        """Return the judge of the executed fraction."""
        return SmallVelocitiesJudge(settings.settle)

    def summarise(self, settings: SmallVelocitiesConfig, rows: Sequence[SmallVelocityEpisode]) -> dict[str, Any]:
        """Return the mean executed fraction of each direction."""
        upright = [row for row in rows if not row.fell]
        executed = {name: [row.executed for row in upright if row.direction == name] for name in DIRECTIONS}
        return {
            "executed": {name: mean(parts) for name, parts in executed.items()},
            "intervals": {name: bootstrap_mean(parts) for name, parts in executed.items()},
        }

    def describe(self, result: SmallVelocitiesResult) -> str:
        """Return the executed fraction by direction, and the falls."""
        rows = [(name, part, interval_text(result.intervals.get(name), 3)) for name, part in result.executed.items()]
        table = format_table(("0.1 to 0.3 m/s", "executed part", INTERVAL), rows)
        falls = f"falls: {count_text(result.falls, result.episodes)}"
        return "\n".join([table, "", falls, INTERVAL_NOTE, *failure_lines(result.rows)])

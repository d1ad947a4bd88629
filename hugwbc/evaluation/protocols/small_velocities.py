"""Are small velocities followed, or ignored?

A reward that is flat near zero error pays a robot that stands still nearly all of its tracking reward at 0.1 m/s, and
the mean error of the paper's protocol hardly shows it. Here every episode commands v_x or v_y alone, 0.1 to 0.3 m/s
either way, and the figure is the executed part of it.
"""

import dataclasses
from collections.abc import Callable

import numpy as np

from hugwbc.commands import Command, default_command
from hugwbc.errors import ConfigError
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.protocols.episodes import (
    ControllerFactory,
    CountedResult,
    CountedSettings,
    Run,
    known,
    mean,
    run_episodes,
)
from hugwbc.gait import Gait
from hugwbc.kinematics import MEASURED_NAMES

SMALL = (0.1, 0.3)  # [m/s]
DIRECTIONS = ("forward", "backward", "left", "right")


@dataclasses.dataclass(frozen=True)
class SmallVelocitiesConfig(CountedSettings):
    """Settings of the protocol, beside those of any of one gait.

    Attributes:
        episodes: in all, split evenly over `DIRECTIONS`.
    """

    episodes: int = 16

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gait is Gait.STANDING:
            raise ConfigError("standing has no velocities; choose another gait")

    @property
    def least(self) -> tuple[int, str]:
        """One for each direction."""
        return len(DIRECTIONS), "one per direction"


@dataclasses.dataclass(frozen=True)
class SmallVelocityEpisode:
    """One episode.

    Attributes:
        gait: label.
        direction: one of `DIRECTIONS`.
        speed: commanded [m/s].
        executed: mean velocity in that direction after the settling time, as a part of the commanded; None if the
            robot fell before.
        fell: whether the robot fell.
        failures: exceptions of the controller that the safety filter caught.
    """

    gait: str
    direction: str
    speed: float
    executed: float | None
    fell: bool
    failures: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class SmallVelocitiesResult(CountedResult[SmallVelocityEpisode]):
    """Outcome of the protocol, beside what any has.

    Attributes:
        executed: mean executed part by direction, of the episodes without a fall: 1 followed, 0 ignored.
    """

    executed: dict[str, float | None]


def sample_episodes(config: SmallVelocitiesConfig) -> list[Command]:
    """The command of every episode: directions in turn, speeds stratified over `SMALL`."""
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


def run_small_velocities(
    factory: ControllerFactory,
    config: SmallVelocitiesConfig,
    on_episode: Callable[[SmallVelocityEpisode], None] | None = None,
) -> SmallVelocitiesResult:
    """Run the protocol.

    Args:
        factory: makes the controller; with more than one worker it must be picklable.
        config: settings.
        on_episode: called with every finished episode, in order.
    """
    plans = [EpisodePlan(command) for command in sample_episodes(config)]
    rows = run_episodes(factory, plans, _Judge(config.settle), config, on_episode)
    return SmallVelocitiesResult.of(
        factory,
        config,
        rows,
        executed={name: mean(r.executed for r in rows if r.direction == name and not r.fell) for name in DIRECTIONS},
    )


@dataclasses.dataclass(frozen=True)
class _Judge:
    settle: float

    def __call__(self, index: int, run: Run) -> SmallVelocityEpisode:
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

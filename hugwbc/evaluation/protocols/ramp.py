"""The paper's test on the real robot, in simulation: p and w go from their minimum to their maximum, in five runs.

Each run is on another robot: ground friction, payload and joint gains are drawn from the training's ranges.
"""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from hugwbc.commands import Command, command_ranges, default_command
from hugwbc.errors import ConfigError
from hugwbc.evaluation.engine import EpisodePlan, Knot, Schedule
from hugwbc.evaluation.metrics import tracking_errors
from hugwbc.evaluation.paper import real_robot_errors
from hugwbc.evaluation.protocols.episodes import (
    ControllerFactory,
    CountedSettings,
    ProtocolResult,
    Run,
    known,
    mean,
    run_episodes,
)
from hugwbc.kinematics import MEASURED_NAMES

RAMPED = ("p", "w")
_START, _APPROACH = 1.0, 2.0  # [s] at the default command, and from there to the minimum
_CURVE_POINTS = 21


@dataclasses.dataclass(frozen=True)
class RampConfig(CountedSettings):
    """Settings of the protocol, beside those of any of one gait.

    Attributes:
        episodes: runs of each command.
        duration: the ramp ends with the episode [s].
        settle: when the ramp begins [s].
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
        error: mean absolute error during the ramp; None if the robot fell before it began.
        curve: the measured value at each of 21 commanded ones, by that one; those before a fall.
        fell: whether the robot fell.
        survived_s: [s].
        payload, friction, gain: of this robot.
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
class RampResult(ProtocolResult[RampEpisode]):
    """Outcome of the protocol, beside what any has.

    Attributes:
        episodes: runs of each command.
        falls: in how many runs the robot fell, by command.
        errors: mean of the runs' errors, E_p and E_w [rad].
        paper: the paper's, on the real robot.
    """

    episodes: int
    falls: dict[str, int]
    errors: dict[str, float | None]
    paper: dict[str, float]


def ramp_schedule(config: RampConfig, name: str) -> Schedule:
    """From the default command to one command's minimum, and from `settle` to the end linearly to its maximum."""
    low, high = command_ranges(config.gait)[name].finishing
    start = default_command(config.gait)

    def at(value: float) -> Command:
        return dataclasses.replace(start, **{name: value})

    ramp = config.duration - config.settle
    return Schedule((Knot(0.0, start), Knot(_START, at(low), _APPROACH), Knot(config.settle, at(high), ramp)))


def run_ramp(
    factory: ControllerFactory, config: RampConfig, on_episode: Callable[[RampEpisode], None] | None = None
) -> RampResult:
    """Run the protocol.

    Args:
        factory: makes the controller; with more than one worker it must be picklable.
        config: settings.
        on_episode: called with every finished run, in order.
    """
    plans = [
        EpisodePlan(
            ramp_schedule(config, name),
            conditions=config.conditions.of_a_drawn_robot(np.random.default_rng((config.seed, draw))),
            draw=draw,
            label=name,
        )
        for name in RAMPED
        for draw in range(config.episodes)
    ]
    rows = run_episodes(factory, plans, RampJudge(config.settle), config, on_episode)
    parts = {name: [row for row in rows if row.command == name] for name in RAMPED}
    return RampResult.of(
        factory,
        config,
        rows,
        episodes=config.episodes,
        falls={name: sum(row.fell for row in part) for name, part in parts.items()},
        errors={f"E_{name}": mean(row.error for row in part) for name, part in parts.items()},
        paper=dict(real_robot_errors(config.gait)),
    )


@dataclasses.dataclass(frozen=True)
class RampJudge:
    """Judges a run by the command that its plan's label names.

    Attributes:
        settle: when the ramp begins [s].
    """

    settle: float

    def __call__(self, index: int, run: Run) -> RampEpisode:
        """The row of one run."""
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

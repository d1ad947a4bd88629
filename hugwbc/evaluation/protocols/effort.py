"""What a controller's motion costs at several speeds, and how long the controller takes to think.

Cost of transport from the joints' mechanical power, use of torque and speed limits, roughness, and the time of a call.
The times are those of this machine with whatever else runs on it; everything else is not.
"""

import dataclasses
from collections.abc import Callable

from hugwbc.commands import command_ranges, default_command
from hugwbc.errors import ConfigError
from hugwbc.evaluation import metrics
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.protocols.episodes import (
    ControllerFactory,
    CountedResult,
    GaitSettings,
    Run,
    known,
    run_episodes,
)
from hugwbc.gait import Gait
from hugwbc.sim.scene import robot_mass

SPEEDS = (0.0, 0.25, 0.5, 1.0, 1.5)  # [m/s]
_MEASURED = (
    *("speed", "power", "cost_of_transport", "torque_rms", "torque_peak", "joint_speed_rms", "joint_speed_peak"),
    *("torque_rate", "target_jerk"),
)
_NOTHING: dict[str, float | None] = dict.fromkeys(_MEASURED)


@dataclasses.dataclass(frozen=True)
class EffortConfig(GaitSettings):
    """Settings of the protocol, beside those of any of one gait.

    Attributes:
        speeds: forward velocities to command [m/s]; those that the gait does not admit are left out.
    """

    speeds: tuple[float, ...] = SPEEDS

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.admitted:
            low, high = command_ranges(self.gait)["v_x"].finishing
            raise ConfigError(f"speeds are {self.speeds}; {self.gait.label} admits {low:g} to {high:g} m/s")

    @property
    def admitted(self) -> tuple[float, ...]:
        """Speeds that the gait admits [m/s]."""
        low, high = command_ranges(self.gait)["v_x"].finishing
        return tuple(speed for speed in self.speeds if low <= speed <= high)

    @property
    def episodes(self) -> int:
        """One for each speed."""
        return len(self.admitted)


@dataclasses.dataclass(frozen=True)
class EffortEpisode:
    """One speed; of a robot that fell only the times, as falling costs little.

    Attributes:
        v_x: commanded [m/s].
        speed: executed [m/s].
        power: mechanical [W].
        cost_of_transport: power over weight times speed [1]; None on the spot.
        torque_rms, torque_peak: of the joint that uses most of its limit, as a part of it.
        joint_speed_rms, joint_speed_peak: likewise.
        torque_rate: root mean square change of the torques [N*m/s].
        target_jerk: mean squared jerk of the commanded joint positions [rad^2/s^6].
        tick_p50_ms, tick_p99_ms: time of a call of the controller [ms].
        period_ms: between two calls [ms].
        fell: whether the robot fell.
        survived_s: [s].
    """

    v_x: float
    speed: float | None
    power: float | None
    cost_of_transport: float | None
    torque_rms: float | None
    torque_peak: float | None
    joint_speed_rms: float | None
    joint_speed_peak: float | None
    torque_rate: float | None
    target_jerk: float | None
    tick_p50_ms: float | None
    tick_p99_ms: float | None
    period_ms: float
    fell: bool
    survived_s: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class EffortResult(CountedResult[EffortEpisode]):
    """Outcome of the protocol, beside what any has.

    Attributes:
        mass: of the robot with its payload [kg].
    """

    mass: float


def run_effort(
    factory: ControllerFactory, config: EffortConfig, on_episode: Callable[[EffortEpisode], None] | None = None
) -> EffortResult:
    """Run the protocol.

    Args:
        factory: makes the controller; with more than one worker it must be picklable.
        config: settings.
        on_episode: called with every finished episode, in order.
    """
    starts = [default_command(config.alternating[index % 2]) for index in range(config.episodes)]
    commands = [dataclasses.replace(start, v_x=v) for start, v in zip(starts, config.admitted, strict=True)]
    plans = [EpisodePlan(command, timed=True) for command in commands]
    mass = robot_mass() + config.conditions.payload
    rows = run_episodes(factory, plans, EffortJudge(config.settle, mass), config, on_episode)
    return EffortResult.of(
        factory,
        config,
        rows,
        mass=mass,
    )


@dataclasses.dataclass(frozen=True)
class EffortJudge:
    """Measures the cost of an episode.

    Attributes:
        settle: start of the episode that is left out [s].
        mass: of the robot with its payload [kg].
    """

    settle: float
    mass: float

    def __call__(self, index: int, run: Run) -> EffortEpisode:
        """The row of one episode."""
        trace = run.trace
        ticks = metrics.percentiles(trace.tick_ms)
        return EffortEpisode(
            v_x=run.command.v_x,
            **(_NOTHING if trace.fell else self._measured(run)),
            tick_p50_ms=ticks["p50"],
            tick_p99_ms=ticks["p99"],
            period_ms=1e3 * trace.survived_s / max(trace.steps - trace.fell, 1),
            fell=trace.fell,
            survived_s=trace.survived_s,
        )

    def _measured(self, run: Run) -> dict[str, float | None]:
        trace, settle = run.trace, self.settle
        unknown = {"rms": None, "peak": None}
        torque = metrics.torque_use(trace, settle) or unknown
        joint_speed = metrics.joint_speed_use(trace, settle) or unknown
        moves = run.command.gait is not Gait.STANDING and run.command.v_x != 0.0
        return {
            "speed": known(metrics.speed(trace, settle)),
            "power": known(metrics.mechanical_power(trace, settle)),
            "cost_of_transport": known(metrics.cost_of_transport(trace, self.mass, settle)) if moves else None,
            "torque_rms": torque["rms"],
            "torque_peak": torque["peak"],
            "joint_speed_rms": joint_speed["rms"],
            "joint_speed_peak": joint_speed["peak"],
            "torque_rate": known(metrics.torque_rate(trace, settle)),
            "target_jerk": known(metrics.target_jerk(trace, settle)),
        }

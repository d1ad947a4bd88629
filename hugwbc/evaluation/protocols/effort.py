"""Cost of a controller's motion at several speeds, and the time that the controller takes to compute it.

Measured are the cost of transport from the joints' mechanical power, the use of torque and speed limits, the roughness,
and the time of a call. The times depend on this machine and its load; the other figures do not.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hugwbc.commands import command_ranges, default_command
from hugwbc.errors import ConfigError
from hugwbc.evaluation import metrics
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import Estimate
from hugwbc.evaluation.picture_data import Curves
from hugwbc.evaluation.protocols.episodes import CountedResult, GaitSettings, Run, SettledJudge, known
from hugwbc.evaluation.protocols.protocol import Measured, PlannedProtocol
from hugwbc.evaluation.tables import format_table
from hugwbc.gait import Gait
from hugwbc.robot import load_robot

SPEEDS = (0.0, 0.25, 0.5, 1.0, 1.5)  # [m/s]
_MEASURED = (
    *("speed", "power", "cost_of_transport", "torque_rms", "torque_peak", "joint_speed_rms", "joint_speed_peak"),
    *("torque_rate", "target_jerk"),
)
# The fields of a row as the terminal shows them.
_TERMINAL_ROWS = {
    "executed [m/s]": "speed",
    "power [W]": "power",
    "cost of transport": "cost_of_transport",
    "torque, rms of limit": "torque_rms",
    "torque, peak": "torque_peak",
    "joint speed, rms of limit": "joint_speed_rms",
    "joint speed, peak": "joint_speed_peak",
    "torque rate, rms [N*m/s]": "torque_rate",
    "target jerk [rad^2/s^6]": "target_jerk",
    "tick, median [ms]": "tick_p50_ms",
    "tick, p99 [ms]": "tick_p99_ms",
    "fell": "fell",
}
# The fields of a row in the report: name, unit, and factor to that unit.
_REPORT_ROWS = {
    "power": ("mechanical power", "W", 1.0),
    "cost_of_transport": ("cost of transport", "", 1.0),
    "torque_rms": ("torque, RMS, of the busiest joint", "% of limit", 100.0),
    "torque_peak": ("torque, peak", "% of limit", 100.0),
    "joint_speed_peak": ("joint speed, peak", "% of limit", 100.0),
    "torque_rate": ("change of torques, RMS", "N·m/s", 1.0),
    "tick_p50_ms": ("time of a call, median", "ms", 1.0),
    "tick_p99_ms": ("time of a call, 99th percentile", "ms", 1.0),
}
_NOTHING: dict[str, float | None] = dict.fromkeys(_MEASURED)


@dataclasses.dataclass(frozen=True)
class EffortConfig(GaitSettings):
    """Settings of the effort protocol, in addition to `GaitSettings`.

    Attributes:
        speeds: forward velocities to command [m/s], one episode each; those that the gait does not admit are left out.
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
        """Number of episodes: one for each speed."""
        return len(self.admitted)


@dataclasses.dataclass(frozen=True)
class EffortEpisode:
    """One speed; None for all but the times if the robot fell, as falling costs little.

    Attributes:
        v_x: commanded forward velocity [m/s].
        speed: executed speed [m/s].
        power: mechanical power [W].
        cost_of_transport: power over weight times speed [1]; None on the spot.
        torque_rms, torque_peak: torque of the joint that uses most of its limit, as a fraction of the limit.
        joint_speed_rms, joint_speed_peak: speed of the joint that uses most of its limit, as a fraction of the limit.
        torque_rate: root mean square rate of change of the torques [N*m/s].
        target_jerk: mean squared jerk of the commanded joint positions [rad^2/s^6].
        tick_p50_ms, tick_p99_ms: median and 99th percentile of the time of a call of the controller [ms].
        period_ms: mean time between two calls [ms].
        fell: whether the robot fell.
        survived_s: time until the fall, or the whole episode [s].
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
    """Result of the effort protocol, in addition to `CountedResult`.

    Attributes:
        mass: mass of the robot with its payload [kg].
    """

    mass: float


@dataclasses.dataclass(frozen=True)
class EffortJudge(SettledJudge):
    """Judge that measures the cost of an episode, in addition to `SettledJudge`.

    Attributes:
        mass: mass of the robot with its payload [kg].
    """

    mass: float

    def __call__(self, index: int, run: Run) -> EffortEpisode:
        """Return the row of one episode."""
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


class EffortProtocol(PlannedProtocol[EffortConfig, EffortEpisode, EffortResult]):
    """The cost of motion at several speeds."""

    name = "effort"
    summary = "cost of transport, use of the limits, roughness and time of a call, at several speeds"
    settings = EffortConfig
    result = EffortResult
    report_title = "Effort"
    report_text = (
        "What the motion costs. A robot that fell has computing times only. Times depend on the machine that made this "
        "report, and on its load."
    )

    def plans(self, settings: EffortConfig) -> list[EpisodePlan]:
        """Return an episode for each admitted speed."""
        starts = [default_command(settings.alternating[index % 2]) for index in range(settings.episodes)]
        commands = [dataclasses.replace(start, v_x=v) for start, v in zip(starts, settings.admitted, strict=True)]
        return [EpisodePlan(command) for command in commands]

    def judge(self, settings: EffortConfig) -> EffortJudge:
        """Return the judge of the cost."""
        return EffortJudge(settings.settle, _mass(settings))

    def summarise(self, settings: EffortConfig, rows: Sequence[EffortEpisode]) -> dict[str, Any]:
        """Return the mass that the cost of transport refers to."""
        return {"mass": _mass(settings)}

    def describe(self, result: EffortResult) -> str:
        """Return power, cost of transport, use of the limits, roughness and times, by commanded speed."""
        header = (f"{result.gait}, {result.controller}", *(f"{row.v_x:g} m/s" for row in result.rows))
        rows = [(label, *(_three_digits(getattr(r, f)) for r in result.rows)) for label, f in _TERMINAL_ROWS.items()]
        about = f"{result.mass:.1f} kg; use of the joint that uses most of its limit; times of this machine"
        return f"{format_table(header, rows)}\n\n{about}"

    def quick(self) -> list[EffortConfig]:
        """Return three speeds of walking."""
        return [EffortConfig(Gait.WALKING, speeds=(0.0, 0.5, 1.0), duration=5.0)]

    def full(self) -> list[EffortConfig]:
        """Return all speeds of three gaits."""
        return [EffortConfig(gait) for gait in (Gait.STANDING, Gait.WALKING, Gait.JUMPING)]

    def figures(self, controller: str, result: Mapping[str, Any]) -> list[Figure]:
        """Return what the motion costs, a table for each speed."""
        figures = []
        for row in result["rows"]:
            table = f"Effort, {result['gait']}, {row['v_x']:g} m/s"
            for field, (quantity, unit, factor) in _REPORT_ROWS.items():
                if row[field] is not None:
                    estimate = Estimate(factor * row[field], None, None, 1)
                    figures.append(Figure(table, quantity, unit, controller, estimate))
            figures.append(falls_figure(table, controller, [row]))
        return figures

    def pictures(self, measured: Sequence[Measured], controllers: Sequence[str]) -> list[Curves]:
        """Return the cost of transport over the executed speed, for each gait that moves."""
        pictures = []
        for gait in dict.fromkeys(result["gait"] for _, result in measured):
            series = {}
            for name in controllers:
                rows = [row for n, r in measured if (n, r["gait"]) == (name, gait) for row in r["rows"]]
                points = [(r["speed"], r["cost_of_transport"]) for r in rows if r["cost_of_transport"] is not None]
                series[name] = (np.array([x for x, _ in points]), np.array([y for _, y in points]))
            if any(len(x) for x, _ in series.values()):
                pictures.append(Curves(f"Cost of transport, {gait}", series, ("m/s", ""), bottom=0.0))
        return pictures


def _mass(settings: EffortConfig) -> float:
    return load_robot(settings.conditions.chosen.robot).mass + settings.conditions.payload


def _three_digits(value: float | bool | None) -> object:
    """Format a number with three significant digits, whatever its size."""
    return value if value is None or isinstance(value, bool) else f"{value:#.3g}".rstrip(".")

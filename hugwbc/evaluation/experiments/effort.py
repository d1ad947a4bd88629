"""Cost of a controller's motion at several speeds, and the time that the controller takes to compute it.

Measured are the cost of transport from the joints' mechanical power, the use of torque and speed limits, the roughness,
and the time of a call. The times depend on this machine and its load; the other figures do not.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
import polars as pl

from hugwbc.commands import command_ranges, default_command
from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.evaluation import metrics
from hugwbc.evaluation.episode import Row, Settings, ending, simulate
from hugwbc.evaluation.experiment import Experiment, Measured, Section
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import known, scaled, single
from hugwbc.evaluation.plans import Plan
from hugwbc.gait import Gait
from hugwbc.robot import load_robot
from hugwbc.runtime.trace import Trace
from hugwbc.settings import settings
from hugwbc.viz import charts
from hugwbc.viz.plots import Panel

# The columns of a row as figures: name, unit, and factor to that unit.
COLUMNS = {
    "speed": ("executed speed", "m/s", 1.0),
    "power": ("mechanical power", "W", 1.0),
    "cost_of_transport": ("cost of transport", "", 1.0),
    "torque_rms": ("torque, RMS, of the busiest joint", "% of limit", 100.0),
    "torque_peak": ("torque, peak", "% of limit", 100.0),
    "joint_speed_rms": ("joint speed, RMS, of the fastest joint", "% of limit", 100.0),
    "joint_speed_peak": ("joint speed, peak", "% of limit", 100.0),
    "torque_rate": ("change of torques, RMS", "N·m/s", 1.0),
    "target_jerk": ("jerk of the joint targets, mean square", "rad²/s⁶", 1.0),
    "tick_p50_ms": ("time of a call, median", "ms", 1.0),
    "tick_p99_ms": ("time of a call, 99th percentile", "ms", 1.0),
}


@settings(kw_only=True)
class EffortSettings(Settings):
    """Settings of effort, in addition to `Settings`."""

    # forward velocities to command [m/s], one episode each; those that the gait does not admit are left out
    speeds: tuple[float, ...] = (0.0, 0.25, 0.5, 1.0, 1.5)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.admitted:
            low, high = command_ranges(self.gaits[0])["v_x"].finishing
            raise ConfigError(f"speeds are {self.speeds}; {self.gait} admits {low:g} to {high:g} m/s")

    @property
    def admitted(self) -> tuple[float, ...]:
        """Speeds that the gait admits [m/s]."""
        low, high = command_ranges(self.gaits[0])["v_x"].finishing
        return tuple(speed for speed in self.speeds if low <= speed <= high)


def plan(settings: EffortSettings) -> list[Plan]:
    """Return an episode for each admitted speed."""
    return [
        Plan(draw, dataclasses.replace(default_command(settings.gaits[draw % 2]), v_x=speed), {"v_x": speed})
        for draw, speed in enumerate(settings.admitted)
    ]


def episode(controller: Controller, settings: EffortSettings, plan: Plan) -> Row:
    """Return `COLUMNS`; of a robot that fell the times alone, as falling costs little."""
    trace = simulate(controller, settings, plan).trace
    ticks = metrics.percentiles(trace.tick_ms)
    return {
        **dict.fromkeys(COLUMNS),
        **({} if trace.fell else _cost(trace, settings, plan)),
        "tick_p50_ms": ticks["p50"],
        "tick_p99_ms": ticks["p99"],
        "period_ms": 1e3 * trace.survived_s / max(trace.steps - trace.fell, 1),
        **ending(trace),
    }


def _cost(trace: Trace, settings: EffortSettings, plan: Plan) -> Row:
    settle, unknown = settings.settle, {"rms": None, "peak": None}
    torque = metrics.torque_use(trace, settle) or unknown
    joint_speed = metrics.joint_speed_use(trace, settle) or unknown
    moves = plan.command.gait is not Gait.STANDING and plan.command.v_x != 0.0
    mass = load_robot(settings.conditions.chosen.robot).mass + settings.conditions.payload
    return {
        "speed": known(metrics.speed(trace, settle)),
        "power": known(metrics.mechanical_power(trace, settle)),
        "cost_of_transport": known(metrics.cost_of_transport(trace, mass, settle)) if moves else None,
        "torque_rms": torque["rms"],
        "torque_peak": torque["peak"],
        "joint_speed_rms": joint_speed["rms"],
        "joint_speed_peak": joint_speed["peak"],
        "torque_rate": known(metrics.torque_rate(trace, settle)),
        "target_jerk": known(metrics.target_jerk(trace, settle)),
    }


def figures(settings: EffortSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return what the motion costs, a table for each speed."""
    found = []
    for row in rows.iter_rows(named=True):
        table = f"Effort, {settings.gait}, {row['v_x']:g} m/s"
        for column, (quantity, unit, factor) in COLUMNS.items():
            if row[column] is not None:
                found.append(Figure(table, quantity, unit, scaled(single(row[column]), factor)))
        found.append(falls_figure(table, [row["fell"]]))
    return found


def pictures(measured: Sequence[Measured], controllers: Sequence[str]) -> list[Panel]:
    """Return the cost of transport over the executed speed, for each gait that moves."""
    drawn = []
    for gait in dict.fromkeys(chosen.gait for _, chosen, _ in measured):
        series = {name: (np.zeros(0), np.zeros(0)) for name in controllers}
        for name, chosen, rows in measured:
            if chosen.gait == gait:
                points = rows.select(pl.col("speed", "cost_of_transport").cast(pl.Float64)).drop_nulls()
                series[name] = (points["speed"].to_numpy(), points["cost_of_transport"].to_numpy())
        if any(len(x) for x, _ in series.values()):
            drawn.append(charts.curves(f"Cost of transport, {gait}", series, ("m/s", ""), bottom=0.0))
    return drawn


EXPERIMENT = Experiment(
    "effort",
    "cost of transport, use of the limits, roughness and time of a call, at several speeds",
    EffortSettings,
    plan,
    episode,
    figures,
    note="Times are those of this machine.",
    section=Section(
        "Effort",
        "What the motion costs. A robot that fell has computing times only. Times depend on the machine that made this "
        "report, and on its load.",
        lambda: [EffortSettings(speeds=(0.0, 0.5, 1.0), duration=5.0)],
        lambda: [EffortSettings(gait=gait) for gait in ("standing", "walking", "jumping")],
        pictures,
    ),
)

"""How does a controller answer each command? Gain, bias and dead zone.

One command at a time takes values spread over its range, the others stay at their defaults. What users ask of a policy
that plays well and deploys badly: are slow commands ignored, and does it drift at zero?
"""

import dataclasses
from collections.abc import Sequence
from typing import Annotated

import numpy as np
import polars as pl
from pydantic import Field

from hugwbc.commands import COMMAND_UNITS, VELOCITY_NAMES, command_ranges
from hugwbc.controller import Controller
from hugwbc.evaluation.episode import Row, Settings, ending, simulate
from hugwbc.evaluation.experiment import Experiment, Measured, Section
from hugwbc.evaluation.experiments.single_command import sampled_commands
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import known, single
from hugwbc.evaluation.metrics import executed_means
from hugwbc.evaluation.plans import Plan
from hugwbc.settings import settings
from hugwbc.viz import evaluation_plots
from hugwbc.viz.plots import Panel

SLOW = (0.1, 0.2)  # [m/s], [rad/s], in both directions: velocities that are often ignored


@settings(kw_only=True)
class ResponseSettings(Settings):
    """Settings of response."""

    # values of each command, spread evenly over its range; its default is added, for velocities also 0.1 and 0.2 both
    # ways
    points: Annotated[int, Field(ge=2)] = 5


def values(settings: ResponseSettings, name: str) -> list[float]:
    """Return the values of a command, its default among them."""
    low, high = command_ranges(settings.gaits[0], settings.robot)[name].finishing
    chosen = {getattr(settings.default_command(), name), *np.linspace(low, high, settings.points).tolist()}
    if name in VELOCITY_NAMES:
        chosen |= {sign * slow for slow in SLOW for sign in (-1.0, 1.0) if low <= sign * slow <= high}
    return sorted(chosen)


def plan(settings: ResponseSettings) -> list[Plan]:
    """Return an episode for each value of each command."""
    places = [
        (name, value)
        for name in sampled_commands(settings.gaits[0], settings.robot)
        for value in values(settings, name)
    ]
    return [
        Plan(
            draw,
            dataclasses.replace(settings.default_command(draw), **{name: value}),
            {"command": name, "value": value},
        )
        for draw, (name, value) in enumerate(places)
    ]


def episode(controller: Controller, settings: ResponseSettings, plan: Plan) -> Row:
    """Return the mean executed value of the command after `settle`; None after a fall."""
    trace = simulate(controller, settings, plan)
    return {"executed": known(executed_means(trace, settings.settle)[str(plan.tags["command"])]), **ending(trace)}


def figures(settings: ResponseSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return for each command gain, bias at the default and, of velocities, dead zone; and the falls.

    The gain is the slope of the executed over the commanded values, of episodes without a fall. The dead zone is the
    largest slow velocity of which less than half is executed.
    """
    found, table = [], f"Response, {settings.gait}"
    for name in rows["command"].unique(maintain_order=True).to_list():
        kept = rows.filter((pl.col("command") == name) & pl.col("executed").is_not_null()).sort("value")
        value, executed = kept["value"].to_numpy(), kept["executed"].to_numpy()
        default = value == getattr(settings.default_command(), name)
        gain = float(np.polyfit(value, executed, 1)[0]) if len(value) > 1 else None
        bias = float((executed - value)[default].mean()) if default.any() else None
        found.append(Figure(table, f"{name}: gain", "", single(gain)))
        found.append(Figure(table, f"{name}: bias", COMMAND_UNITS[name], single(bias)))
        if name in VELOCITY_NAMES:
            slow = (value != 0.0) & (np.abs(value) <= max(SLOW))
            ignored = np.abs(value[slow])[executed[slow] / value[slow] < 0.5]
            zone = float(max(ignored, default=0.0)) if slow.any() else None
            found.append(Figure(table, f"{name}: dead zone", COMMAND_UNITS[name], single(zone)))
    return [*found, falls_figure(table, rows["fell"])]


def pictures(measured: Sequence[Measured], controllers: Sequence[str]) -> list[Panel]:
    """Return executed over commanded value for each gait and command."""
    drawn = []
    for gait in dict.fromkeys(chosen.gait for _, chosen, _ in measured):
        tables = {name: rows for name, chosen, rows in measured if chosen.gait == gait}
        for command in dict.fromkeys(name for rows in tables.values() for name in rows["command"].to_list()):
            series = {}
            for name in controllers:
                rows = tables[name].filter(pl.col("command") == command).drop_nulls("executed").sort("value")
                series[name] = rows["value"].to_numpy(), rows["executed"].to_numpy()
            labels = (f"commanded {command} [{COMMAND_UNITS[command]}]", "executed")
            drawn.append(evaluation_plots.curves(f"{command}, {gait}", series, labels))
    return drawn


EXPERIMENT = Experiment(
    "response",
    "gain, bias and dead zone of each command",
    ResponseSettings,
    plan,
    episode,
    figures,
    section=Section(
        "Response",
        "Each command alone at values over its range. The gain is the slope of executed over commanded values, the "
        "bias the error at the default, the dead zone the largest slow velocity of which less than half is executed.",
        lambda: [ResponseSettings(points=2, duration=4.0)],
        lambda: [ResponseSettings(gait=gait) for gait in ("standing", "walking", "jumping")],
        pictures,
    ),
)

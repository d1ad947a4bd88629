"""The paper's heat maps: the errors of two commands over the ranges of both, for every pair of commands.

All other commands are at their defaults. Each command is also scanned alone over the same values, which gives the
single-command error that the summary compares with. The paper calls commands orthogonal if they do not significantly
affect one another's tracking, without a number; here that means an error within 1.5 times the single-command error.
"""

import dataclasses
import itertools
import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np
import polars as pl
from pydantic import Field

from hugwbc.commands import COMMAND_NAMES, command_ranges, default_command
from hugwbc.controller import Controller
from hugwbc.evaluation.episode import Row, Settings, ending, simulate
from hugwbc.evaluation.experiment import Experiment, Measured, Section
from hugwbc.evaluation.experiments.single_command import episode_error, sampled_commands
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import Estimate, bootstrap_mean, known
from hugwbc.evaluation.plans import Plan
from hugwbc.settings import settings
from hugwbc.viz import charts
from hugwbc.viz.plots import Panel

ORTHOGONAL = 1.5  # times the single-command error


@settings(kw_only=True)
class HeatmapSettings(Settings):
    """Settings of heatmap."""

    # number of values of each command, evenly spaced over its finishing range, ends included
    points: Annotated[int, Field(ge=2)] = 5

    @property
    def names(self) -> tuple[str, ...]:
        """The scanned commands."""
        return sampled_commands(self.gaits[0])

    def values(self, name: str) -> list[float]:
        """Return the scanned values of a command."""
        return np.linspace(*command_ranges(self.gaits[0])[name].finishing, self.points).tolist()


def plan(settings: HeatmapSettings) -> list[Plan]:
    """Return each command alone, then each pair, row by row of its map."""
    scans: list[dict[str, float]] = [{name: value} for name in settings.names for value in settings.values(name)]
    scans += [
        {first: a, second: b}
        for first, second in itertools.combinations(settings.names, 2)
        for a in settings.values(first)
        for b in settings.values(second)
    ]
    return [
        Plan(
            draw,
            dataclasses.replace(default_command(settings.gaits[draw % 2]), **values),
            dict(zip(("first", "second"), (*values, ""), strict=False)),
        )
        for draw, values in enumerate(scans)
    ]


def episode(controller: Controller, settings: HeatmapSettings, plan: Plan) -> Row:
    """Return the commands and the errors of all commands of the gait; None if the robot fell too early."""
    run = simulate(controller, settings, plan)
    return {
        **dict(zip(COMMAND_NAMES, run.command.array().tolist(), strict=True)),
        **{f"error_{name}": known(episode_error(run.trace, name, settings.settle)) for name in settings.names},
        **ending(run.trace),
    }


def alone(settings: HeatmapSettings, rows: pl.DataFrame) -> dict[str, Estimate]:
    """Return the error of each command scanned alone, without episodes with a fall."""
    upright = rows.filter((pl.col("second") == "") & ~pl.col("fell"))
    return {name: bootstrap_mean(upright.filter(pl.col("first") == name)[f"error_{name}"]) for name in settings.names}


def error_map(settings: HeatmapSettings, rows: pl.DataFrame, tracked: str, against: str) -> np.ndarray:
    """Return the errors of one command over its values (rows) and those of another one (columns); NaN in a fall."""
    first, second = sorted((tracked, against), key=settings.names.index)
    pair = rows.filter((pl.col("first") == first) & (pl.col("second") == second))
    errors = [None if fell else error for fell, error in pair.select("fell", f"error_{tracked}").iter_rows()]
    found = np.array(errors, dtype=float).reshape(settings.points, settings.points)
    return found if tracked == first else found.T


@dataclasses.dataclass(frozen=True)
class OrthogonalRange:
    """The range of one command in which it does not affect another command's tracking.

    It lies about the default, up to the first scanned values that fail; it is None if even the nearest one fails.
    """

    low: float | None
    high: float | None
    share: float  # fraction of the scanned values in that range


def orthogonal_range(
    settings: HeatmapSettings, against: str, errors: np.ndarray, single: float | None
) -> OrthogonalRange:
    """Return where the mean error over the columns of a map stays within `ORTHOGONAL` times the error alone."""
    values = settings.values(against)
    good = [_multiple(column, single) <= ORTHOGONAL for column in errors.T]
    default = command_ranges(settings.gaits[0])[against].default
    low = high = int(np.argmin(np.abs(np.array(values) - default)))
    if not good[low]:
        return OrthogonalRange(None, None, 0.0)
    while low > 0 and good[low - 1]:
        low -= 1
    while high + 1 < len(good) and good[high + 1]:
        high += 1
    return OrthogonalRange(values[low], values[high], (high - low + 1) / len(good))


def _multiple(errors: np.ndarray, single: float | None) -> float:
    """Return the mean of some errors as a multiple of the error alone; infinite with a fall."""
    if single is None or np.isnan(errors).any():
        return math.inf
    error = float(np.mean(errors))
    if single == 0.0:
        return 1.0 if error == 0.0 else math.inf
    return error / single


def figures(settings: HeatmapSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return in what part of the other commands' ranges each is tracked as well as alone; and where, for each pair."""
    table, ranges = f"Orthogonality, {settings.gait}", f"Part of the column's range, {settings.gait}"
    single, found, pairs = alone(settings, rows), [], []
    for name in settings.names:
        found.append(Figure(f"Scanned alone, {settings.gait}", f"error of {name}", "", single[name]))
    for tracked in settings.names:
        shares = []
        for against in (name for name in settings.names if name != tracked):
            errors = error_map(settings, rows, tracked, against)
            entry = orthogonal_range(settings, against, errors, single[tracked].value)
            shares.append(100.0 * entry.share)
            where = "none" if entry.low is None else f"{entry.low:g} to {entry.high:g}"
            estimate = Estimate(shares[-1], None, None, settings.points)
            pairs.append(
                Figure(ranges, f"error of {tracked} over {against} ({where})", "%", estimate, higher_is_better=True)
            )
        if shares:
            share = Estimate(sum(shares) / len(shares), None, None, len(shares))
            found.append(Figure(table, f"error of {tracked}", "% of ranges", share, higher_is_better=True))
    return [*found, falls_figure(table, rows["fell"]), *pairs]


def pictures(measured: Sequence[Measured], controllers: Sequence[str]) -> list[Panel]:
    """Return the maps of all pairs relative to the errors alone, for each gait and controller."""
    drawn = []
    for name, chosen, rows in measured:
        single = alone(chosen, rows)
        maps = {
            (tracked, against): error_map(chosen, rows, tracked, against) / (single[tracked].value or math.nan)
            for tracked, against in itertools.permutations(chosen.names, 2)
        }
        drawn.append(charts.heat_maps(f"{chosen.gait}, {name}", chosen.names, maps, "times the error alone"))
    return drawn


EXPERIMENT = Experiment(
    "heatmap",
    "errors over each pair of commands, and where one leaves the other alone",
    HeatmapSettings,
    plan,
    episode,
    figures,
    note=f"In brackets: where the error stays within {ORTHOGONAL} times the error alone, about the default.",
    section=Section(
        "Pairs of commands",
        "Every pair of commands over the ranges of both. Maps: the error of one command (rows) against another one "
        "(columns), both rising to the right and up, relative to its error when it is scanned alone; crosses are "
        "falls. Table: the part of the other commands' ranges, about their defaults, in which the error stays within "
        "1.5 times that; the paper shows maps without such a number.",
        # Jumping has as many pairs as walking, and is left to the full profile.
        lambda: [HeatmapSettings(gait=g, points=n, duration=2.5) for g, n in (("standing", 3), ("walking", 2))],
        lambda: [HeatmapSettings(gait=g, points=7) for g in ("standing", "walking", "jumping", "hopping")],
        pictures,
    ),
)

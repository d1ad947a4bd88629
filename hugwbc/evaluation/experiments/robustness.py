"""How much a robot may differ from its description: one factor at a time, over a grid of values.

The factors are payload, friction, sensor latency, joint gains, motor strength, roughness and slope of the ground. Every
value is tested with the same sampled single commands as the unchanged robot, so that the ratio of the errors is the
cost of the difference.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
import polars as pl

from hugwbc.evaluation.episode import Settings
from hugwbc.evaluation.experiment import Experiment, Measured, Section
from hugwbc.evaluation.experiments.single_command import check_enough, episode, stratified_samples
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import Estimate, bootstrap_mean
from hugwbc.evaluation.paper import ERROR_NAMES
from hugwbc.evaluation.plans import Plan
from hugwbc.settings import Count, settings
from hugwbc.viz import charts
from hugwbc.viz.plots import Panel

NOMINAL = "nominal"
# Fields of Conditions, and the values of each.
GRID: Mapping[str, tuple[float, ...]] = {
    "payload": (-2.0, 5.0, 10.0, 15.0),  # [kg]
    "friction": (0.2, 0.4, 0.6, 1.2),
    "latency": (0.005, 0.01, 0.02, 0.04),  # [s]
    "gain": (0.8, 0.9, 1.1, 1.2),
    "strength": (0.7, 0.8, 0.9, 1.1),
    "terrain_roughness": (0.01, 0.02, 0.03),  # [m]
    "slope": (-0.087, 0.087),  # [rad], 5 degrees down and up
}
GRID_UNITS = {"payload": "kg", "latency": "s", "terrain_roughness": "m", "slope": "rad"}
# Factor and value of all cells, the unchanged robot first.
LEVELS = ((NOMINAL, 0.0), *((factor, value) for factor, values in GRID.items() for value in values))


@settings(kw_only=True)
class RobustnessSettings(Settings):
    """Settings of robustness."""

    samples: Count = 8  # number of episodes of each value, split evenly over the commands of the gait

    def __post_init__(self) -> None:
        super().__post_init__()
        check_enough(self, "samples", self.samples)
        for slope in GRID["slope"]:
            dataclasses.replace(self.conditions, slope=slope).check_duration(self.duration)


def plan(settings: RobustnessSettings) -> list[Plan]:
    """Return the same sampled commands for every value, the unchanged robot first."""
    samples, plans = stratified_samples(settings, settings.samples), []
    for factor, level in LEVELS:
        conditions = dataclasses.replace(settings.conditions, **({} if factor == NOMINAL else {factor: level}))
        plans += [
            Plan(draw, command, {"factor": factor, "level": level, "command": name}, conditions=conditions)
            for draw, (name, command) in enumerate(samples)
        ]
    return plans


def error_ratio(rows: pl.DataFrame, nominal: pl.DataFrame) -> float | None:
    """Return the error over the unchanged robot's error, averaged over the paper's errors.

    Both data frames have the same commands in the same order. Only commands with which neither robot fell count; None
    if there is none.
    """
    both = pl.DataFrame(
        {
            "name": rows["error_name"],
            "own": rows["error"],
            "base": nominal["error"],
            "fell": rows["fell"] | nominal["fell"],
        }
    ).filter(~pl.col("fell"))
    ratios = []
    for name in ERROR_NAMES:
        own, base = (bootstrap_mean(both.filter(pl.col("name") == name)[part]).value for part in ("own", "base"))
        ratios.append(own / base if own is not None and base else None)
    return bootstrap_mean(ratios).value


def ratios(rows: pl.DataFrame) -> list[tuple[str, float, pl.DataFrame, float | None]]:
    """Return factor, value, episodes and `error_ratio` of every value, that of the unchanged robot first."""
    parts = [rows.filter((pl.col("factor") == factor) & (pl.col("level") == level)) for factor, level in LEVELS]
    return [(*cell, part, error_ratio(part, parts[0])) for cell, part in zip(LEVELS, parts, strict=True)]


def figures(settings: RobustnessSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return what each value costs: the error relative to the unchanged robot's, and the falls."""
    title, errors, falls = f"Robustness, {settings.gait}", [], []
    for factor, level, part, ratio in ratios(rows):
        label = factor if factor == NOMINAL else f"{factor} {level:g} {GRID_UNITS.get(factor, '')}".strip()
        estimate = Estimate(ratio, None, None, len(part))
        errors.append(Figure(f"{title}: error over the unchanged robot's", label, "", estimate))
        falls.append(dataclasses.replace(falls_figure(f"{title}: falls", part["fell"]), quantity=label))
    return [*errors[1:], *falls]


def pictures(measured: Sequence[Measured], controllers: Sequence[str]) -> list[Panel]:
    """Return the relative error over the value of each factor, for each gait."""
    drawn = []
    for gait in dict.fromkeys(chosen.gait for _, chosen, _ in measured):
        found = {name: ratios(rows) for name, chosen, rows in measured if chosen.gait == gait}
        for factor, values in GRID.items():
            series = {name: _curve(found.get(name, ()), factor) for name in controllers}
            one = (np.array([min(values), max(values)]), np.ones(2))
            labels = (f"{factor} {GRID_UNITS.get(factor, '')}".strip(), "times the error")
            drawn.append(charts.curves(f"{factor}, {gait}", series, labels, dashed=one, bottom=0.0))
    return drawn


def _curve(
    found: Sequence[tuple[str, float, pl.DataFrame, float | None]], factor: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return the values of a factor in rising order, and the relative errors."""
    mine = sorted((level, math.nan if ratio is None else ratio) for name, level, _, ratio in found if name == factor)
    return np.array([x for x, _ in mine]), np.array([y for _, y in mine])


EXPERIMENT = Experiment(
    "robustness",
    "payload, friction, latency, gains, motors and ground, one at a time",
    RobustnessSettings,
    plan,
    episode,
    figures,
    section=Section(
        "Robustness",
        "One factor at a time differs from the robot that the controllers know. Errors are relative to those of the "
        "unchanged robot on the same commands. Episodes with a fall are left out of them and counted.",
        lambda: [RobustnessSettings(gait="standing", samples=3, duration=2.5)],
        lambda: [RobustnessSettings(gait=gait, samples=64) for gait in ("standing", "walking")],
        pictures,
    ),
)

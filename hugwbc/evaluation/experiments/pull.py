"""A steady force on both hands together, from each of eight directions: does the robot stay up?"""

import numpy as np
import polars as pl

from hugwbc.controller import Controller
from hugwbc.evaluation.episode import Row
from hugwbc.evaluation.experiment import Experiment
from hugwbc.evaluation.experiments.hand_forces import (
    BEGIN,
    DIRECTIONS,
    RISE,
    ForceWatch,
    HandForceSettings,
    Newtons,
    heading,
    play,
    source_of,
)
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import bootstrap_rms, wilson_percentage
from hugwbc.evaluation.plans import Plan
from hugwbc.settings import settings
from hugwbc.sim.hand_pull import HandPull
from hugwbc.state import RobotState

PULLED = 5.0  # [s] of the full pull


@settings(kw_only=True)
class PullSettings(HandForceSettings):
    """Settings of pull."""

    force: Newtons = 40.0  # steady force on both hands together [N]


def plan(settings: PullSettings) -> list[Plan]:
    """Return the episodes of each direction."""
    return [Plan(draw, tags={"direction": d}) for d in DIRECTIONS for draw in range(settings.episodes)]


def episode(controller: Controller, settings: PullSettings, plan: Plan) -> Row:
    """Return whether the robot fell, how far it was pulled [m], and the error of the estimated force [N]."""
    duration = BEGIN + RISE + PULLED
    simulation = settings.conditions.simulation(duration, (settings.seed, plan.draw))
    pull = HandPull(simulation, settings.force * heading(float(plan.tags["direction"])), BEGIN, RISE)
    watch = ForceWatch(lambda truth: np.asarray(pull.force))

    def on_step(truth: RobotState, estimate: RobotState) -> None:
        pull.update(truth)
        watch(truth, estimate)

    _, end = play(controller, settings, source_of(settings), simulation, duration, on_step)
    return {**watch.row(), **end}


def figures(settings: PullSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return how often the robot stays up by direction, the error of the estimated force, and the falls."""
    table = f"Pulled with {settings.force:g} N at the hands, {settings.gait}"
    found = []
    for direction in DIRECTIONS:
        up = wilson_percentage((~rows.filter(pl.col("direction") == direction)["fell"]).to_list())
        found.append(Figure(table, f"stays up, {direction}°", "% of episodes", up, higher_is_better=True))
    error = bootstrap_rms(rows["estimate_error"])
    return [
        *found,
        Figure(table, "error of the estimated force on a hand, RMS", "N", error),
        falls_figure(table, rows["fell"]),
    ]


EXPERIMENT = Experiment(
    "pull",
    "a steady pull at the hands from eight directions: does the robot stay up",
    PullSettings,
    plan,
    episode,
    figures,
)

"""Are small velocities followed, or ignored?

A reward that is flat near zero error gives a robot that stands still nearly all of its tracking reward at 0.1 m/s, and
the mean error of single commands hardly shows it. Here every episode commands v_x or v_y alone, 0.1 to 0.3 m/s in
either direction, and the figure is the fraction of it that is executed.
"""

import dataclasses
from typing import Annotated

import numpy as np
import polars as pl
from pydantic import Field

from hugwbc.commands import default_command
from hugwbc.controller import Controller
from hugwbc.evaluation.episode import MOVING, CountedSettings, Row, ending, simulate
from hugwbc.evaluation.experiment import Experiment
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import bootstrap_mean, known
from hugwbc.evaluation.plans import Plan
from hugwbc.kinematics import MEASURED_NAMES
from hugwbc.settings import settings

SMALL = (0.1, 0.3)  # [m/s]
DIRECTIONS = ("forward", "backward", "left", "right")


@settings(kw_only=True)
class SmallVelocitiesSettings(CountedSettings):
    """Settings of small-velocities, in addition to `CountedSettings`."""

    # number of episodes in all, split evenly over forward, backward, left and right
    episodes: Annotated[int, Field(ge=len(DIRECTIONS))] = 16
    possible = MOVING


def plan(settings: SmallVelocitiesSettings) -> list[Plan]:
    """Return an episode for each sampled velocity: directions in turn, speeds stratified over `SMALL`."""
    rng = np.random.default_rng(settings.seed)
    rounds = -(-settings.episodes // len(DIRECTIONS))
    plans = []
    for draw in range(settings.episodes):
        turn, direction = divmod(draw, len(DIRECTIONS))
        speed = float(SMALL[0] + (SMALL[1] - SMALL[0]) * (turn + rng.uniform()) / rounds)
        name, sign = ("v_x", "v_y")[direction // 2], 1.0 - 2.0 * (direction % 2)
        command = dataclasses.replace(default_command(settings.gaits[turn % 2]), **{name: sign * speed})
        plans.append(Plan(draw, command, {"direction": DIRECTIONS[direction], "speed": speed}))
    return plans


def episode(controller: Controller, settings: SmallVelocitiesSettings, plan: Plan) -> Row:
    """Return the mean velocity in the direction of the command, as a fraction of the commanded one."""
    trace, name = simulate(controller, settings, plan).trace, "v_x" if plan.command.v_x else "v_y"
    measured = trace.measured[trace.time >= settings.settle, MEASURED_NAMES.index(name)]
    executed = known(float(measured.mean()) / float(getattr(plan.command, name))) if measured.size else None
    return {"executed": executed, **ending(trace)}


def figures(settings: SmallVelocitiesSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return the executed fraction of the episodes without a fall: 1 followed, 0 ignored; and the falls."""
    table, upright = f"Executed part of 0.1 to 0.3 m/s, {settings.gait}", rows.filter(~pl.col("fell"))
    found = [
        Figure(table, name, "", bootstrap_mean(upright.filter(pl.col("direction") == name)["executed"]))
        for name in DIRECTIONS
    ]
    return [*found, falls_figure(table, rows["fell"])]


EXPERIMENT = Experiment(
    "small-velocities",
    "executed fraction of commanded speeds of 0.1 to 0.3 m/s",
    SmallVelocitiesSettings,
    plan,
    episode,
    figures,
)

"""A sudden push on the trunk of a walk from eight directions: the largest change of velocity that is survived."""

from collections.abc import Sequence

import numpy as np
import polars as pl

from hugwbc.controller import Controller
from hugwbc.evaluation.episode import Row
from hugwbc.evaluation.experiment import Experiment
from hugwbc.evaluation.experiments.hand_forces import (
    BEGIN,
    DIRECTIONS,
    ForceWatch,
    HandForceSettings,
    Source,
    heading,
    play,
)
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import Estimate
from hugwbc.evaluation.plans import Plan
from hugwbc.robot import load_robot
from hugwbc.sim import Force

PUSH_TIME = 0.1  # [s]
PUSH_STEP, PUSH_MOST = 0.2, 1.6  # [m/s], between two pushes and the largest one
RECOVERY = 3.0  # [s] after a push in which the robot must not fall


def following(settings: HandForceSettings, rows: Sequence[Row]) -> list[Plan]:
    """Return the next larger push of every direction and episode that survived all pushes so far."""
    plans = []
    for direction in DIRECTIONS:
        for draw in range(settings.episodes):
            steps = [row["fell"] for row in rows if (row["direction"], row["number"]) == (direction, draw)]
            if not any(steps) and len(steps) < round(PUSH_MOST / PUSH_STEP):
                plans.append(_plan(settings, direction, draw, (len(steps) + 1) * PUSH_STEP))
    return plans


def _plan(settings: HandForceSettings, direction: int, draw: int, change: float) -> Plan:
    mass = load_robot(settings.conditions.chosen.robot).mass
    vector = tuple((mass * change / PUSH_TIME * heading(direction)).tolist())
    # Pushes of one direction meet the gait at different times.
    push = Force(vector, BEGIN + 0.13 * (draw % 8), PUSH_TIME, frame="heading")
    return Plan(draw, tags={"direction": direction, "number": draw, "change": change}, forces=(push,))


def episode(controller: Controller, settings: HandForceSettings, plan: Plan) -> Row:
    """Return whether the robot fell, and how far it was moved [m]."""
    duration = BEGIN + RECOVERY
    simulation = settings.conditions.simulation(duration, (settings.seed, plan.draw))
    watch = ForceWatch(lambda truth: None)
    _, end = play(controller, settings, Source(settings.v_x), simulation, duration, watch, plan.forces)
    return {"moved": watch.row()["moved"], **end}


def survived(settings: HandForceSettings, rows: pl.DataFrame) -> dict[int, list[float]]:
    """Return the largest change of velocity that each episode survived by direction [m/s]."""
    upright = rows.filter(~pl.col("fell"))
    largest = {
        (direction, number): change
        for direction, number, change in upright.group_by("direction", "number").agg(pl.col("change").max()).iter_rows()
    }
    return {d: [largest.get((d, number), 0.0) for number in range(settings.episodes)] for d in DIRECTIONS}


def figures(settings: HandForceSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return the median of the episodes' largest survived changes of velocity, by direction and of all."""
    table, changes = f"Survived push in a walk at {settings.v_x:g} m/s", survived(settings, rows)
    medians = {f"{direction}°": found for direction, found in changes.items()}
    medians["median of all"] = [change for found in changes.values() for change in found]
    return [
        *(
            Figure(table, name, "m/s", Estimate(float(np.median(found)), None, None, len(found)), higher_is_better=True)
            for name, found in medians.items()
        ),
        falls_figure(table, rows["fell"]),
    ]


EXPERIMENT = Experiment(
    "push",
    "sudden pushes on the trunk of a walk from eight directions: the largest that is survived",
    HandForceSettings,
    lambda settings: following(settings, ()),
    episode,
    figures,
    following=following,
    note="Pushes get stronger by 0.2 m/s until the robot falls; falls are those of all pushes.",
)

"""Carry an unknown mass in each hand, standing or walking: how far do the hands sag?"""

import dataclasses
from typing import Annotated

import numpy as np
import polars as pl
from pydantic import Field

from hugwbc.controller import Controller
from hugwbc.evaluation import metrics
from hugwbc.evaluation.episode import Row
from hugwbc.evaluation.experiment import Experiment
from hugwbc.evaluation.experiments.hand_forces import (
    BEGIN,
    ForceWatch,
    HandForceSettings,
    play,
    source_of,
)
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import bootstrap_mean, bootstrap_rms, known, scaled
from hugwbc.evaluation.plans import Plan
from hugwbc.robot import SIDES
from hugwbc.runtime.trace import Trace
from hugwbc.settings import settings
from hugwbc.state import GRAVITY

CARRIED = BEGIN + 3.0  # [s], length of an episode


@settings(kw_only=True)
class CarrySettings(HandForceSettings):
    """Settings of carry."""

    load: Annotated[float, Field(ge=0, le=20)] = 3.0  # mass in each hand [kg]


def plan(settings: CarrySettings) -> list[Plan]:
    """Return the episodes, which differ in the errors of the sensors."""
    loaded = dataclasses.replace(settings.conditions, hand_payload=settings.load)
    return [Plan(draw, conditions=loaded) for draw in range(settings.episodes)]


def episode(controller: Controller, settings: CarrySettings, plan: Plan) -> Row:
    """Return how far both hands are below their targets on average [m], and the error of the estimated load [N]."""
    assert plan.conditions is not None
    simulation = plan.conditions.simulation(CARRIED, (settings.seed, plan.draw))
    weight = np.tile((0.0, 0.0, -GRAVITY * settings.load), (2, 1))
    watch = ForceWatch(lambda truth: weight)
    trace, end = play(controller, settings, source_of(settings), simulation, CARRIED, watch)
    return {"sag": sag(trace), **watch.row(), **end}


def sag(trace: Trace) -> float | None:
    """Return how far the hands are below their targets from `BEGIN` on [m], by the recorded bodies."""
    kept = trace.time >= BEGIN
    if trace.fell or not kept.any():
        return None
    hands = metrics.places(trace, [f"{side}_hand" for side in SIDES], kept)
    return known(float(np.nanmean(trace.hand_target_world[kept, :, 2] - hands[..., 2])))


def figures(settings: CarrySettings, rows: pl.DataFrame) -> list[Figure]:
    """Return the sag, the error of the estimated load, and the falls."""
    table = f"Carry {settings.load:g} kg in each hand, {settings.gait}"
    return [
        Figure(table, "sag of the hands", "cm", scaled(bootstrap_mean(rows["sag"]), 100.0)),
        Figure(table, "error of the estimated force on a hand, RMS", "N", bootstrap_rms(rows["estimate_error"])),
        falls_figure(table, rows["fell"]),
    ]


EXPERIMENT = Experiment(
    "carry",
    "a mass in each hand that nobody is told: how far the hands sag",
    CarrySettings,
    plan,
    episode,
    figures,
)

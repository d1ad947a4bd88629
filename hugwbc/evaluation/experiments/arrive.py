"""Does `walk_to` arrive? Goals at any distance and heading, with the defaults of the behaviour.

A box far away makes the place a scene, in which the robot's pose is told as by motion capture, without drift.
"""

import math

import numpy as np
import polars as pl

from hugwbc.behaviours import walk_to
from hugwbc.controller import Controller
from hugwbc.evaluation.episode import CountedSettings, Row
from hugwbc.evaluation.experiment import Experiment
from hugwbc.evaluation.experiments.behaviours import play
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import bootstrap_mean, wilson_percentage
from hugwbc.evaluation.plans import Plan
from hugwbc.rotations import wrap_angle
from hugwbc.settings import Count, Positive, settings
from hugwbc.sim import Scene
from hugwbc.sim.scenes import Box

DISTANCE = (0.3, 3.0)  # [m]
FAR = Scene((Box(name="far", position=(9.0, 9.0), size=(0.2, 0.2, 0.2), mass=1.0),))


@settings(kw_only=True)
class ArriveSettings(CountedSettings):
    """Settings of arrive."""

    episodes: Count = 20  # number of goals
    duration: Positive = 60.0  # longest time of an episode [s]


def plan(settings: ArriveSettings) -> list[Plan]:
    """Return an episode for each goal: distances and bearings are uniform, and so is the heading at the goal."""
    plans = []
    for draw in range(settings.episodes):
        rng = np.random.default_rng((settings.seed, draw))
        distance, bearing = rng.uniform(*DISTANCE), rng.uniform(-math.pi, math.pi)
        goal = {"x": distance * math.cos(bearing), "y": distance * math.sin(bearing)}
        plans.append(Plan(draw, tags={**goal, "yaw": float(rng.uniform(-math.pi, math.pi))}))
    return plans


def episode(controller: Controller, settings: ArriveSettings, plan: Plan) -> Row:
    """Return whether and when the behaviour ended with success, and how far the robot truly stood from the goal.

    - `distance`: of the pelvis from the goal [m]; `angle`: of the heading from that of the goal [deg]. None for walks
      that did not arrive.
    """
    x, y, yaw = (float(plan.tags[name]) for name in ("x", "y", "yaw"))
    row, simulation = play(controller, settings, plan, lambda view: walk_to(view, (x, y), yaw), FAR)
    if not row["success"]:
        return row | {"distance": None, "angle": None}
    state = simulation.state()
    assert state.position is not None
    away = math.hypot(state.position[0] - x, state.position[1] - y)
    return row | {"distance": away, "angle": abs(math.degrees(float(wrap_angle(state.yaw - yaw))))}


def figures(settings: ArriveSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return the share of goals that were reached, time and true error of these, and the falls."""
    table, done = "Goals of 0.3 to 3 m, any heading", rows.filter(pl.col("success"))
    found = [
        Figure(table, "arrived", "% of goals", wilson_percentage(rows["success"].to_list()), higher_is_better=True),
        Figure(table, "time", "s", bootstrap_mean(done["seconds"])),
        Figure(table, "true distance", "m", bootstrap_mean(done["distance"])),
        Figure(table, "true angle", "deg", bootstrap_mean(done["angle"])),
    ]
    return [*found, falls_figure(table, rows["fell"])]


EXPERIMENT = Experiment(
    "arrive",
    "walk_to goals of 0.3 to 3 m and any heading: how often it arrives, how fast, how exactly",
    ArriveSettings,
    plan,
    episode,
    figures,
)

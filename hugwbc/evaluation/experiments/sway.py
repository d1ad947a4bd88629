"""How much do the hands accelerate in a walk, held in the "steady" frame and with the arm joints held stiff?"""

import dataclasses

import polars as pl

from hugwbc.controller import Controller
from hugwbc.evaluation import metrics
from hugwbc.evaluation.episode import Row
from hugwbc.evaluation.experiment import Experiment
from hugwbc.evaluation.experiments.hand_forces import HANDS, HandForceSettings, Source, play
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import bootstrap_rms, known, single
from hugwbc.evaluation.plans import Plan
from hugwbc.robot import SIDES, load_robot
from hugwbc.targets import HandTargets

SWAYED_FROM = 9.0  # [s], when the acceleration of the hands counts: they have learned the stride by then
SWAYED = 6.0  # [s], for which it counts


def plan(settings: HandForceSettings) -> list[Plan]:
    """Return a walk with steady hands and one with stiff arms for each draw."""
    return [Plan(draw, tags={"arms": arms}) for draw in range(settings.episodes) for arms in ("steady", "stiff")]


def episode(controller: Controller, settings: HandForceSettings, plan: Plan) -> Row:
    """Return the root mean square of the hands' acceleration [m/s^2]; None in a fall."""
    duration, robot = SWAYED_FROM + SWAYED, load_robot(settings.conditions.chosen.robot)
    simulation = settings.conditions.simulation(duration, (settings.seed, plan.draw))
    steady = HandTargets.of(*HANDS, "steady")
    stiff = HandTargets(None, None, joints=robot.nominal[robot.arms])
    source = Source(settings.v_x, steady if plan.tags["arms"] == "steady" else stiff)
    trace, end = play(controller, settings, source, simulation, duration)
    hands = metrics.places(trace, [f"{side}_hand" for side in SIDES], trace.time >= SWAYED_FROM)
    return {"acceleration": None if trace.fell else known(metrics.hand_acceleration(hands)), **end}


def figures(settings: HandForceSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return the accelerations of the hands with both arms, their ratio, and the falls."""
    table = f"Sway of the hands at {settings.v_x:g} m/s"
    steady, stiff = (bootstrap_rms(rows.filter(pl.col("arms") == arms)["acceleration"]) for arms in ("steady", "stiff"))
    ratio = None if steady.value is None or stiff.value is None else steady.value / stiff.value
    return [
        Figure(table, "acceleration of the hands, steady frame, RMS", "m/s²", steady),
        Figure(table, "acceleration with stiff arm joints, RMS", "m/s²", stiff),
        Figure(table, "ratio", "", dataclasses.replace(single(ratio), samples=settings.episodes)),
        falls_figure(table, rows["fell"]),
    ]


EXPERIMENT = Experiment(
    "sway",
    "how much the hands accelerate in a walk, held steady and with stiff arms",
    HandForceSettings,
    plan,
    episode,
    figures,
)

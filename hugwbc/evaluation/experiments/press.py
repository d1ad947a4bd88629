"""The left hand of a standing robot presses a wall with a wanted force: how far is the contact force off?"""

import dataclasses

import numpy as np
import polars as pl

from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.evaluation.episode import Row
from hugwbc.evaluation.experiment import Experiment, numbered
from hugwbc.evaluation.experiments.hand_forces import (
    BEGIN,
    HANDS,
    TAKEN,
    ForceWatch,
    HandForceSettings,
    Newtons,
    Source,
    play,
)
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import bootstrap_mean, bootstrap_rms
from hugwbc.evaluation.plans import Plan
from hugwbc.settings import settings
from hugwbc.sim.scenes.furniture import Wall
from hugwbc.sim.scenes.scene import Scene
from hugwbc.state import RobotState
from hugwbc.targets import HandTargets

WALL = 0.42  # [m], distance of the wall's surface ahead of the start
HEIGHT = 1.1  # [m], at which the hand presses
PRESSED, STEADY = 4.0, 1.0  # [s]: press, and how long the hand has to become steady


@settings(kw_only=True)
class PressSettings(HandForceSettings):
    """Settings of press."""

    force: Newtons = 40.0  # wanted force [N]
    possible = ("standing",)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.conditions.engine != "mujoco":
            raise ConfigError("a wall to press needs the engine mujoco; leave out the engine")


@dataclasses.dataclass(frozen=True)
class PressSource(Source):
    """Holds the left hand before the wall, and presses from `BEGIN` on."""

    force: float = 0.0  # wanted force [N]

    def hands_at(self, t: float) -> HandTargets | None:
        """Return the target of the left hand, with the force while it presses."""
        if t < TAKEN:
            return None
        pressing = t >= BEGIN
        target = (WALL - (0.02 if pressing else 0.05), HANDS[0][1], HEIGHT)
        return HandTargets.of(target, None, "world", left_force=(-self.force, 0.0, 0.0) if pressing else None)


def episode(controller: Controller, settings: PressSettings, plan: Plan) -> Row:
    """Return the mean distance of the force along the wanted one to it from `STEADY` on [N]; None in a fall."""
    rising = settings.force / 100.0
    duration = BEGIN + rising + PRESSED
    wall = Wall(name="wall", position=(WALL + 0.05, 0.0), size=(0.1, 3.0, 2.5))
    simulation = settings.conditions.simulation(duration, (settings.seed, plan.draw), Scene((wall,)))
    misses: list[float] = []
    watch = ForceWatch(lambda truth: truth.hand_force)

    def on_step(truth: RobotState, estimate: RobotState) -> None:
        watch(truth, estimate)
        if truth.position is not None and truth.hand_force is not None and truth.time > BEGIN + rising + STEADY:
            misses.append(abs(-float(truth.hand_force[0, 0]) - settings.force))

    source = PressSource(None, force=settings.force)
    trace, end = play(controller, settings, source, simulation, duration, on_step)
    return {"error": float(np.mean(misses)) if misses and not trace.fell else None, **watch.row(), **end}


def figures(settings: PressSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return the error of the force, that of its estimate, and the falls."""
    table = f"Press a wall with {settings.force:g} N"
    return [
        Figure(table, "error of the force", "N", bootstrap_mean(rows["error"])),
        Figure(table, "error of the estimated force on a hand, RMS", "N", bootstrap_rms(rows["estimate_error"])),
        falls_figure(table, rows["fell"]),
    ]


EXPERIMENT = Experiment(
    "press",
    "press a wall with a wanted force: how far the contact force is off",
    PressSettings,
    numbered,
    episode,
    figures,
)

"""Do the controllers do the same in both physics engines? Errors and falls of single commands, side by side.

What holds in one simulator only is not a result. Every episode starts from a stand and gets one light push, whose
direction and time depend on its number, as do the sensors' errors; both engines have the same.
"""

import dataclasses
from typing import Annotated

import numpy as np
import polars as pl

from hugwbc.commands import Command
from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.evaluation.episode import CountedSettings, Row, ending, simulate
from hugwbc.evaluation.experiment import Experiment, Section
from hugwbc.evaluation.figures import FALLS, Figure, falls_figure
from hugwbc.evaluation.intervals import bootstrap_mean, known, paired_ratio
from hugwbc.evaluation.metrics import tracking_errors
from hugwbc.evaluation.plans import Plan
from hugwbc.gait import Gait
from hugwbc.settings import Count, Positive, check_each_once, one_of, settings
from hugwbc.sim import Force
from hugwbc.sim.arena import ENGINES
from hugwbc.sim.physx import PhysxSimulation

COMMANDS: dict[str, tuple[Gait, dict[str, float]]] = {
    "walk back": (Gait.WALKING, {"v_x": -0.3}),
    "walk": (Gait.WALKING, {"v_x": 0.5}),
    "walk fast": (Gait.WALKING, {"v_x": 1.0}),
    "turn": (Gait.WALKING, {"omega": 0.5}),
    "squat": (Gait.STANDING, {"h": -0.2}),
    "stand": (Gait.STANDING, {}),
}
ERRORS = {"v_x": "m/s", "v_y": "m/s", "omega": "rad/s"}
PUSH, PUSH_TIME = 50.0, 0.1  # [N], [s]: 5 N*s, or 0.08 m/s of an H1
_PUSHED = (1.0, 2.0)  # [s], when
_BOTH = tuple(ENGINES)


@settings(kw_only=True)
class EnginesSettings(CountedSettings):
    """Settings of engines."""

    episodes: Count = 10  # number of episodes of each command in each engine
    # names of the commands: walk back, walk, walk fast, turn, squat, stand
    commands: tuple[Annotated[str, one_of("command", lambda: COMMANDS)], ...] = tuple(COMMANDS)
    duration: Positive = 20.0  # duration of an episode [s]
    varied = frozenset({"gait", "engine", "terrain_roughness", "slope"})

    def __post_init__(self) -> None:
        super().__post_init__()
        check_each_once("commands", self.commands)
        for name in self.commands:
            command_of(self, name)


def command_of(settings: EnginesSettings, name: str) -> Command:
    """Return a command by name; refuse one beyond the robot's ranges."""
    gait, values = COMMANDS[name]
    return Command.from_mapping(values, gait, settings.robot).validate(settings.robot)


def plan(settings: EnginesSettings) -> list[Plan]:
    """Return every command in both engines, with the same pushes and the same errors of the sensors."""
    return [
        Plan(
            number,
            command_of(settings, command),
            {"command": command, "engine": engine},
            (push_of(settings, number),),
            dataclasses.replace(settings.conditions, engine=engine),
        )
        for command in settings.commands
        for number in range(settings.episodes)
        for engine in _BOTH
    ]


def push_of(settings: EnginesSettings, number: int) -> Force:
    """Return the push in an episode, the same for every command and engine."""
    rng = np.random.default_rng((settings.seed, number))
    angle, start = rng.uniform(0.0, 2.0 * np.pi), float(rng.uniform(*_PUSHED))
    vector = (float(PUSH * np.cos(angle)), float(PUSH * np.sin(angle)), 0.0)
    return Force(vector, start=start, duration=PUSH_TIME, link=settings.robot.base)


def episode(controller: Controller, settings: EnginesSettings, plan: Plan) -> Row:
    """Return the mean absolute errors of v_x, v_y and omega; None after a fall."""
    trace = simulate(controller, settings, plan)
    errors = tracking_errors(trace, settings.settle)
    return {**{f"error_{name}": None if trace.down else known(errors[name]) for name in ERRORS}, **ending(trace)}


def figures(settings: EnginesSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return a table for each command: errors in both engines, their ratio where neither fell, and the falls."""
    found = []
    for command in settings.commands:
        table = f"Both engines, {command}"
        parts = {e: rows.filter((pl.col("command") == command) & (pl.col("engine") == e)) for e in _BOTH}
        for name, unit in ERRORS.items():
            errors = {engine: part[f"error_{name}"].to_list() for engine, part in parts.items()}
            for engine, values in errors.items():
                found.append(Figure(table, f"E_{name}, {engine}", unit, bootstrap_mean(values)))
            pairs = [pair for pair in zip(*errors.values(), strict=False) if None not in pair]
            ratio = paired_ratio([physx for _, physx in pairs], [mujoco for mujoco, _ in pairs])
            found.append(Figure(table, f"E_{name}, ratio", "", ratio))
        for engine, part in parts.items():
            found.append(falls_figure(table, part["fell"], quantity=f"{FALLS}, {engine}"))
    return found


def unavailable() -> str:
    """Say how to install PhysX if it is missing."""
    try:
        PhysxSimulation.check_available()
    except ConfigError as error:
        return str(error)
    return ""


EXPERIMENT = Experiment(
    "engines",
    "single commands in both physics engines side by side: errors, their ratio, and falls",
    EnginesSettings,
    plan,
    episode,
    figures,
    note="Ratio: PhysX divided by MuJoCo, over the episodes that stay up in both.",
    section=Section(
        "Both engines",
        "The same commands in MuJoCo and in PhysX 5, each episode with one light push. What holds in one of them only "
        "is a property of that engine, not of the controller. Ratio: PhysX divided by MuJoCo, over the episodes that "
        "stay up in both.",
        lambda: [EnginesSettings(episodes=1, commands=("walk", "turn", "stand"), duration=4.0)],
        lambda: [EnginesSettings()],
        unavailable=unavailable,
    ),
)

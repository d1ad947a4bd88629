"""Do the controllers do the same in both physics engines? Errors and falls of single commands, side by side.

What holds in one simulator only is not a result. Every episode starts from a stand and gets one light push, whose
direction and time depend on its number, as do the sensors' errors; both engines have the same.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hugwbc.commands import Command
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import Estimate, bootstrap_mean, bootstrap_ratio
from hugwbc.evaluation.metrics import tracking_errors
from hugwbc.evaluation.protocols.episodes import CountedSettings, GroupedResult, Run, SettledJudge, known
from hugwbc.evaluation.protocols.protocol import INTERVAL_NOTE, PlannedProtocol, failure_lines, interval_text
from hugwbc.evaluation.tables import format_table
from hugwbc.gait import Gait
from hugwbc.sim import Force
from hugwbc.sim.arena import ENGINES
from hugwbc.sim.physx import PhysxSimulation

COMMANDS = {
    "walk back": Command(v_x=-0.3, gait=Gait.WALKING),
    "walk": Command(v_x=0.5, gait=Gait.WALKING),
    "walk fast": Command(v_x=1.0, gait=Gait.WALKING),
    "turn": Command(omega=0.5, gait=Gait.WALKING),
    "squat": Command(h=-0.2, gait=Gait.STANDING),
    "stand": Command(gait=Gait.STANDING),
}
ERRORS = {"v_x": "m/s", "v_y": "m/s", "omega": "rad/s"}
PUSH, PUSH_TIME = 50.0, 0.1  # [N], [s]: 5 N*s, or 0.08 m/s
_PUSHED = (1.0, 2.0)  # [s], when
_BOTH = tuple(ENGINES)


@dataclasses.dataclass(frozen=True)
class EnginesConfig(CountedSettings):
    """Settings of the engines protocol, in addition to `CountedSettings`.

    Attributes:
        episodes: number of episodes of each command in each engine.
        commands: names of the commands: walk back, walk, walk fast, turn, squat, stand.
    """

    episodes: int = 10
    _: dataclasses.KW_ONLY
    commands: tuple[str, ...] = tuple(COMMANDS)
    duration: float = 20.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.commands:
            if name not in COMMANDS:
                raise UnknownNameError("command", name, COMMANDS)

    def conditions_in(self, engine: str) -> Conditions:
        """Return the conditions in an engine.

        Raises:
            ConfigError: if it is not installed, or has no such ground.
        """
        return dataclasses.replace(self.conditions, engine=engine)


@dataclasses.dataclass(frozen=True)
class EnginesEpisode:
    """One episode in one engine.

    Attributes:
        command: name of the command.
        engine: name of the engine.
        errors: mean absolute errors of v_x, v_y and omega; None where the robot fell too early.
        fell: whether the robot fell.
        failures: number of exceptions of the controller that the safety filter caught.
    """

    command: str
    engine: str
    errors: dict[str, float | None]
    fell: bool
    failures: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class EnginesResult(GroupedResult[EnginesEpisode]):
    """Result of the engines protocol, in addition to `GroupedResult`, whose groups are "COMMAND, ENGINE".

    Attributes:
        ratios: error in PhysX divided by that in MuJoCo, by command and by error, with its interval.
    """

    ratios: dict[str, dict[str, Estimate]]


class EnginesJudge(SettledJudge):
    """Judge that measures the errors of an episode."""

    def __call__(self, index: int, run: Run) -> EnginesEpisode:
        """Return the row of one episode."""
        errors = tracking_errors(run.trace, self.settle)
        command, _, engine = run.plan.label.partition(", ")
        return EnginesEpisode(
            command=command,
            engine=engine,
            errors={name: known(errors.get(name, math.nan)) for name in ERRORS},
            fell=run.trace.fell,
            failures=run.trace.safety.failures,
        )


def push_of(seed: int, number: int) -> Force:
    """Return the push in an episode, the same for every command and engine."""
    rng = np.random.default_rng((seed, number))
    angle, start = rng.uniform(0.0, 2.0 * np.pi), float(rng.uniform(*_PUSHED))
    vector = (float(PUSH * np.cos(angle)), float(PUSH * np.sin(angle)), 0.0)
    return Force(vector, start=start, duration=PUSH_TIME, link="pelvis")


class EnginesProtocol(PlannedProtocol[EnginesConfig, EnginesEpisode, EnginesResult]):
    """Single commands in MuJoCo and in PhysX."""

    name = "engines"
    summary = "single commands in both physics engines side by side: errors, their ratio, and falls"
    settings = EnginesConfig
    fixed = frozenset({"engine", "terrain_roughness", "slope"})
    result = EnginesResult
    report_title = "Both engines"
    report_text = (
        "The same commands in MuJoCo and in PhysX 5, each episode with one light push. What holds in one of "
        "them only is a property of that engine, not of the controller. Ratio: PhysX divided by MuJoCo."
    )

    def unavailable(self) -> str:
        """Say how to install PhysX if it is missing."""
        try:
            PhysxSimulation.check_available()
        except ConfigError as error:
            return str(error)
        return ""

    def plans(self, settings: EnginesConfig) -> list[EpisodePlan]:
        """Return every command in both engines, with the same pushes and the same errors of the sensors."""
        return [
            EpisodePlan(
                COMMANDS[command],
                (push_of(settings.seed, number),),
                settings.conditions_in(engine),
                draw=number,
                label=f"{command}, {engine}",
            )
            for command in settings.commands
            for number in range(settings.episodes)
            for engine in _BOTH
        ]

    def judge(self, settings: EnginesConfig) -> EnginesJudge:
        """Return the judge of the errors."""
        return EnginesJudge(settings.settle)

    def summarise(self, settings: EnginesConfig, rows: Sequence[EnginesEpisode]) -> dict[str, Any]:
        """Return falls by command and engine, and the ratios of the errors."""
        groups = {(command, engine): 0 for command in settings.commands for engine in _BOTH}
        for row in rows:
            groups[row.command, row.engine] += row.fell
        found = [dataclasses.asdict(row) for row in rows]
        return {
            "episodes": settings.episodes,
            "falls": {f"{command}, {engine}": falls for (command, engine), falls in groups.items()},
            "ratios": {
                command: {name: _ratio(found, command, name) for name in ERRORS} for command in settings.commands
            },
        }

    def describe(self, result: EnginesResult) -> str:
        """Return errors in both engines, their ratios and the falls, a line for each command."""
        found = [dataclasses.asdict(row) for row in result.rows]
        tables = []
        for name, unit in ERRORS.items():
            rows: list[tuple[object, ...]] = []
            for command, ratios in result.ratios.items():
                one, other = (_mean(found, command, engine, name) for engine in _BOTH)
                rows.append((command, _digits(one), _digits(other), ratios[name].value, interval_text(ratios[name], 2)))
            head = (f"{result.controller}, E_{name} [{unit}]", "MuJoCo", "PhysX", "ratio", "95 % interval")
            tables.append(format_table(head, rows))
        lines = []
        for command in result.ratios:
            counts = [f"{engine} {result.falls[f'{command}, {engine}']}" for engine in _BOTH]
            lines.append(f"falls, {command}: {', '.join(counts)} of {result.episodes}")
        return "\n\n".join([*tables, "\n".join([*lines, INTERVAL_NOTE, *failure_lines(result.rows)])])

    def quick(self) -> list[EnginesConfig]:
        """Return one short episode of three commands."""
        return [EnginesConfig(episodes=1, commands=("walk", "turn", "stand"), duration=4.0, conditions=Conditions())]

    def full(self) -> list[EnginesConfig]:
        """Return ten episodes of every command."""
        return [EnginesConfig(conditions=Conditions())]

    def figures(self, controller: str, result: Mapping[str, Any]) -> list[Figure]:
        """Return errors in both engines, their ratio and the falls, a table for each command."""
        figures, rows = [], result["rows"]
        for command in dict.fromkeys(row["command"] for row in rows):
            table = f"Both engines, {command}"
            for name, unit in ERRORS.items():
                for engine in _BOTH:
                    estimate = _mean(rows, command, engine, name)
                    figures.append(Figure(table, f"E_{name}, {engine}", unit, controller, estimate))
                ratio = _ratio(rows, command, name)
                figures.append(Figure(table, f"E_{name}, ratio", "", controller, ratio))
            for engine in _BOTH:
                fell = falls_figure(table, controller, _of(rows, command, engine))
                figures.append(dataclasses.replace(fell, quantity=f"{fell.quantity}, {engine}"))
        return figures


def _of(rows: Sequence[Mapping[str, Any]], command: str, engine: str) -> list[Mapping[str, Any]]:
    return [row for row in rows if (row["command"], row["engine"]) == (command, engine)]


def _mean(rows: Sequence[Mapping[str, Any]], command: str, engine: str, name: str) -> Estimate:
    return bootstrap_mean(row["errors"][name] for row in _of(rows, command, engine) if not row["fell"])


def _ratio(rows: Sequence[Mapping[str, Any]], command: str, name: str) -> Estimate:
    mujoco, physx = ([row["errors"][name] for row in _of(rows, command, engine) if not row["fell"]] for engine in _BOTH)
    return bootstrap_ratio(physx, mujoco)


def _digits(estimate: Estimate) -> str | None:
    return None if estimate.value is None else f"{estimate.value:.4f}"

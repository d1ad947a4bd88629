"""The suite of loco-manipulation tasks: how often a controller does what each of them asks for, and why not."""

import collections
import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from hugwbc.commands import Command
from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.evaluation import metrics
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.intervals import wilson_of
from hugwbc.evaluation.protocols.episodes import (
    ControllerFactory,
    CountedSettings,
    ProtocolResult,
    Run,
    known,
    mean,
    run_episodes,
)
from hugwbc.evaluation.protocols.protocol import Protocol, failure_lines
from hugwbc.evaluation.tables import format_table
from hugwbc.files import file_digest
from hugwbc.runtime.trace import RECORD_PERIOD, Trace
from hugwbc.tasks.run_task import TaskRun, run_task
from hugwbc.tasks.suite import TASK_NAMES, file_of, load_task, modules_of

LONGEST = 120.0  # [s]; every task has a limit of its own below it


@dataclasses.dataclass(frozen=True)
class TasksConfig(CountedSettings):
    """Settings of the protocol of tasks, in addition to `CountedSettings`.

    Attributes:
        episodes: number of episodes of each task; the scene of each is drawn with the seed plus its number.
        task: names of the tasks, or Python files with tasks of your own; all of the suite by default.
        duration: not used; every task has its own time limit.
    """

    episodes: int = 50
    _: dataclasses.KW_ONLY
    task: tuple[str, ...] = TASK_NAMES
    duration: float = LONGEST

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.task or len(set(self.task)) < len(self.task):
            raise ConfigError(f"tasks are {', '.join(self.task) or 'none'}; give at least one, each once")
        for name in self.task:
            if load_task(name).limit > LONGEST:
                raise ConfigError(f"the time limit of task '{name}' is above {LONGEST:g} s; give a shorter one")


@dataclasses.dataclass(frozen=True)
class TaskEpisode:
    """One episode of one task.

    Attributes:
        task: its name.
        seed: seed of the scene and of the sensors; `hugwbc play --task TASK --seed SEED` shows the same episode.
        success: whether the task was done.
        reason: why not; empty for a success.
        detail: what the behaviour said when it ended.
        score: 0 to 1.
        seconds: time until the behaviour ended [s]; None if a fall or the time limit ended it.
        hand_acceleration: root mean square of the hands' acceleration [m/s^2].
        energy: mechanical energy of the joints; braking costs as much as driving [J].
        gripped: bodies that the idealised gripper held.
        hand_depth: how deep a hand was in an object, at most [m].
        fell: whether the robot fell.
        failures: number of exceptions of the controller that the safety filter caught.
    """

    task: str
    seed: int
    success: bool
    reason: str
    detail: str
    score: float
    seconds: float | None
    hand_acceleration: float | None
    energy: float | None
    gripped: tuple[str, ...]
    hand_depth: float
    fell: bool
    failures: int


@dataclasses.dataclass(frozen=True)
class TaskFigures:
    """Figures of all episodes of a task.

    Attributes:
        success: share of the episodes in which it was done, in [0, 1].
        interval: Wilson's score interval of it, low and high.
        episodes: number of episodes.
        reasons: how many episodes failed, by the reason, the most frequent first.
        seconds: mean time of the successes [s].
        score: mean score.
        hand_acceleration: mean over the episodes [m/s^2].
        energy: mean over the episodes [J].
        hand_depth: deepest that a hand was in an object in any episode [m].
        attach: whether the idealised gripper held something in any episode.
    """

    success: float
    interval: tuple[float, float]
    episodes: int
    reasons: dict[str, int]
    seconds: float | None
    score: float
    hand_acceleration: float | None
    energy: float | None
    hand_depth: float
    attach: bool


@dataclasses.dataclass(frozen=True, kw_only=True)
class TasksResult(ProtocolResult[TaskEpisode]):
    """Result of the protocol of tasks, in addition to `ProtocolResult`.

    Attributes:
        tasks: figures of each task by its name.
    """

    tasks: dict[str, TaskFigures]


@dataclasses.dataclass(frozen=True)
class TaskStage:
    """One episode of a task as a stage of the engine.

    Attributes:
        name: of the task.
    """

    name: str

    def play(self, controller: Controller, conditions: Conditions, seed: tuple[int, int]) -> tuple[Trace, TaskRun]:
        """Run the episode; the scene is drawn with the sum of the seed and the episode's number."""
        task, number = load_task(self.name), sum(seed)
        simulation = conditions.chosen.simulation(
            timestep=conditions.timestep,
            latency=conditions.latency,
            seed=number,
            variation=conditions.variation(),
            scene=task.scene,
        )
        run = run_task(task, controller, simulation, conditions.estimator())
        return run.trace, run


@dataclasses.dataclass(frozen=True)
class TaskJudge:
    """Judge of one task.

    Attributes:
        name: of the task.
        seed: seed of the first episode.
    """

    name: str
    seed: int

    @property
    def modules(self) -> tuple[str, ...]:
        """Modules on whose code the rows depend, beside this one: that of the task."""
        return modules_of(self.name)

    def identity(self) -> dict[str, Any]:
        """Return what distinguishes judges: the task, its scene, and the file of a task from outside this package."""
        path = file_of(self.name)
        code = None if path is None else file_digest(path)
        return {"task": self.name, "seed": self.seed, "scene": load_task(self.name).scene, "file": code}

    def __call__(self, index: int, run: Run) -> TaskEpisode:
        """Return the row of one episode."""
        outcome: TaskRun = run.outcome
        verdict, record, trace = outcome.verdict, outcome.record, outcome.trace
        seconds = len(trace.time) * RECORD_PERIOD
        return TaskEpisode(
            task=self.name,
            seed=self.seed + index,
            success=verdict.success,
            reason=verdict.reason,
            detail=verdict.detail,
            score=verdict.score,
            seconds=None if record.ending.time is None else float(record.ending.time),
            hand_acceleration=known(hand_acceleration(record.hands)),
            energy=known(metrics.mechanical_power(trace, settle=0.0) * seconds),
            gripped=record.gripped,
            hand_depth=max(record.depth.values(), default=0.0),
            fell=record.fell,
            failures=trace.safety.failures,
        )


def hand_acceleration(hands: np.ndarray) -> float:
    """Return the root mean square of the hands' acceleration [m/s^2]; NaN for fewer than three samples.

    Args:
        hands: positions in the world, one sample every `RECORD_PERIOD` [m], shape (T, 2, 3).
    """
    if len(hands) < 3:
        return math.nan
    acceleration = np.diff(hands, n=2, axis=0) / RECORD_PERIOD**2
    return float(np.sqrt((acceleration**2).sum(axis=2).mean()))


class TasksProtocol(Protocol[TasksConfig, TaskEpisode, TasksResult]):
    """The suite of loco-manipulation tasks."""

    name = "tasks"
    summary = "loco-manipulation tasks with objects: how often each succeeds, and why not"
    settings = TasksConfig
    fixed = frozenset(
        {"gait", "both_legs", "duration", "settle", "engine", "terrain_roughness", "slope", "intervention", "motions"}
    )

    def total(self, settings: TasksConfig) -> int:
        """Return the number of episodes of all tasks."""
        return settings.episodes * len(settings.task)

    def run(
        self, factory: ControllerFactory, settings: TasksConfig, on_episode: Callable[[TaskEpisode], None] | None = None
    ) -> TasksResult:
        """Run all episodes of each task, those with stored rows excepted; arguments as in `Protocol`."""
        rows: list[TaskEpisode] = []
        for name in settings.task:
            judge = TaskJudge(name, settings.seed)
            plans = [EpisodePlan(Command(), draw=number, stage=TaskStage(name)) for number in range(settings.episodes)]
            rows += run_episodes(factory, plans, judge, settings, on_episode)
        tasks = {name: figures_of([row for row in rows if row.task == name]) for name in settings.task}
        return TasksResult.of(factory, settings, rows, tasks=tasks)

    def describe(self, result: TasksResult) -> str:
        """Return a table of the tasks, and the reasons of all failures."""
        header = ("task", "success", "95 % interval", "time [s]", "score", "hand acc. [m/s^2]", "energy [J]", "attach")
        lines = [
            (
                name,
                f"{100.0 * figures.success:.0f} % of {figures.episodes}",
                f"{100.0 * figures.interval[0]:.0f} to {100.0 * figures.interval[1]:.0f}",
                None if figures.seconds is None else f"{figures.seconds:.1f}",
                f"{figures.score:.2f}",
                None if figures.hand_acceleration is None else f"{figures.hand_acceleration:.1f}",
                None if figures.energy is None else f"{figures.energy:.0f}",
                figures.attach,
            )
            for name, figures in result.tasks.items()
        ]
        reasons = [
            f"{name}: {reason}: {count}"
            for name, figures in result.tasks.items()
            for reason, count in figures.reasons.items()
        ]
        text = [f"{result.controller}, seed {result.seed} ({result.seed_class})", format_table(header, lines)]
        text += ["", "failures:", *reasons] if reasons else []
        return "\n".join([*text, *failure_lines(result.rows)])


def figures_of(rows: Sequence[TaskEpisode]) -> TaskFigures:
    """Return the figures of all episodes of a task, at least one."""
    done = [row for row in rows if row.success]
    interval = wilson_of(len(done), len(rows))
    assert interval.low is not None and interval.high is not None
    return TaskFigures(
        success=len(done) / len(rows),
        interval=(interval.low / 100.0, interval.high / 100.0),
        episodes=len(rows),
        reasons=dict(collections.Counter(row.reason for row in rows if not row.success).most_common()),
        seconds=mean(row.seconds for row in done),
        score=float(np.mean([row.score for row in rows])),
        hand_acceleration=mean(row.hand_acceleration for row in rows),
        energy=mean(row.energy for row in rows),
        hand_depth=max(row.hand_depth for row in rows),
        attach=any(row.gripped for row in rows),
    )

"""Compare controllers on one script: play it with each, hand targets solved by the hand IK, and sum up every run."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from hugwbc.behaviours import Behaviour, BehaviourSource
from hugwbc.behaviours.source import LONGEST
from hugwbc.commands import COMMAND_UNITS
from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.evaluation import metrics
from hugwbc.evaluation.tables import Table
from hugwbc.runtime.rollout import rollout
from hugwbc.runtime.trace import Trace
from hugwbc.scripts.command_source import CommandSource
from hugwbc.scripts.script import Script
from hugwbc.sim import Arena, Scene
from hugwbc.tasks import Task, TaskRun, run_task
from hugwbc.upper_ik import UpperBodySource

# Fields of `metrics.HandTravel` with their labels and scales, for tables.
HAND_ROWS = (
    ("arrived", "hand error once there, mean [cm]", 100.0),
    ("arrived_p95", "hand error once there, 95th percentile [cm]", 100.0),
    ("travelling", "hand error on the way, mean [cm]", 100.0),
    ("travel_time", "hands on the way [s]", 1.0),
)
HAND_NOTE = (
    f"A hand travels to a new target until it is within {100 * metrics.ARRIVED:.0f} cm of it for the first time; from "
    "then on it is there. Means over both hands."
)


@dataclasses.dataclass(frozen=True)
class Outcome:
    """The figures of one controller's run.

    Attributes:
        fell: whether the robot fell.
        survived_s: time until the fall, or the duration of the script [s].
        errors: mean absolute error of v_x, v_y, omega, h, p, w over all control steps, ramps included.
        hand_error_m: `metrics.HandErrors` [m].
        hand_travel: `metrics.HandTravel`.
        tick_ms: p50 and p99 of the controller's computing time for one call [ms].
        ik_ms: p50 and p99 of the hand IK's computing time [ms]; None where it was not called.
        steps: number of control steps.
        footsteps: number of touch-downs of both feet.
        safety: report of the safety filter.
    """

    fell: bool
    survived_s: float
    errors: dict[str, float]
    hand_error_m: dict[str, float | None]
    hand_travel: dict[str, float | None]
    tick_ms: dict[str, float | None]
    ik_ms: dict[str, float | None]
    steps: int
    footsteps: int
    safety: dict[str, Any]


def summarise(trace: Trace) -> Outcome:
    """Return the figures of one run."""
    return Outcome(
        fell=trace.fell,
        survived_s=trace.survived_s,
        errors=metrics.tracking_errors(trace, settle=0.0),
        hand_error_m=dataclasses.asdict(metrics.hand_errors(trace.hand_error, trace.reachable)),
        hand_travel=dataclasses.asdict(metrics.hand_travel(trace)),
        tick_ms=metrics.percentiles(trace.tick_ms),
        ik_ms=metrics.percentiles(trace.ik_ms),
        steps=trace.steps,
        footsteps=sum(times.size for times in trace.touch_downs),
        safety=dataclasses.asdict(trace.safety),
    )


def check_names(controllers: Sequence[Controller]) -> None:
    """Check that the controllers can be told apart by their names."""
    names = [controller.name for controller in controllers]
    if not names or len(set(names)) < len(names):
        raise ConfigError(f"controllers are {names}; give at least one, each once")


def compare(
    controllers: Sequence[Controller],
    script: Script | Behaviour,
    *,
    seed: int = 0,
    arena: Arena | None = None,
    scene: Scene | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> list[Trace]:
    """Play a script with each controller in turn, in the same simulation, and return the records.

    Args:
        controllers: at least one controller; their names must differ.
        script: commands and hand targets, or a behaviour.
        seed: seed of the sensor noise, and of what varies in the scene.
        arena: robot, drives and sensors; None for the default ones.
        scene: objects around the robot; None for none.
        on_progress: called with the fraction done.
    """
    check_names(controllers)
    arena = arena or Arena()
    traces = []
    for index, controller in enumerate(controllers):
        simulation = arena.simulation(seed=seed, scene=scene)
        source, duration, until = _source(script)

        def advance(fraction: float, done: int = index) -> None:
            if on_progress is not None:
                on_progress((done + fraction) / len(controllers))

        traces.append(
            rollout(
                controller,
                source,
                simulation,
                UpperBodySource(robot=arena.known_robot),
                duration=duration,
                on_progress=advance,
                until=until,
            )
        )
    return traces


def _source(script: Script | Behaviour) -> tuple[CommandSource, float, Callable[[], bool] | None]:
    """Return what commands the robot, for how long at most [s], and what ends it earlier."""
    if isinstance(script, Script):
        return script, script.duration, None
    source = BehaviourSource(script)
    return source, LONGEST, lambda: source.done


def compare_task(
    controllers: Sequence[Controller],
    task: Task,
    *,
    seed: int = 0,
    arena: Arena | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> list[TaskRun]:
    """Do one episode of a task with each controller in turn, and return the episodes.

    Args:
        controllers: at least one controller; their names must differ.
        task: the task.
        seed: seed of the scene and of the sensor noise.
        arena: robot, drives and sensors; None for the default ones.
        on_progress: called with the fraction done.
    """
    check_names(controllers)
    arena, runs = arena or Arena(), []
    for index, controller in enumerate(controllers):

        def advance(fraction: float, done: int = index) -> None:
            if on_progress is not None:
                on_progress((done + fraction) / len(controllers))

        simulation = arena.simulation(seed=seed, scene=task.scene)
        runs.append(run_task(task, controller, simulation, on_progress=advance))
    return runs


def task_summary(task: Task, runs: Sequence[TaskRun], *, seed: int = 0, arena: Arena | None = None) -> dict[str, Any]:
    """Return a comparison of controllers in a task as JSON: what `comparison_summary` has, and the verdicts.

    Args:
        task: the task.
        runs: an episode of each controller.
        seed: seed of the scene and of the sensor noise.
        arena: robot, drives and sensors; None for the default ones.
    """
    controllers = {
        run.trace.name: dataclasses.asdict(summarise(run.trace))
        | {"verdict": dataclasses.asdict(run.verdict), "gripped": run.record.gripped}
        for run in runs
    }
    return {
        "task": task.name,
        "limit": task.limit,
        "seed": seed,
        "arena": dataclasses.asdict(arena or Arena()),
        "controllers": controllers,
    }


def task_table(runs: Sequence[TaskRun]) -> Table:
    """Return `figure_table` with the verdicts on top."""
    figures = figure_table({run.trace.name: summarise(run.trace) for run in runs})
    rows: list[tuple[Any, ...]] = [
        ("task done", *(run.verdict.success for run in runs)),
        ("why not", *(run.verdict.reason or None for run in runs)),
        ("score", *(run.verdict.score for run in runs)),
        ("idealised gripper", *(", ".join(run.record.gripped) or None for run in runs)),
    ]
    return dataclasses.replace(figures, rows=[*rows, *figures.rows])


def comparison_summary(
    script: Script | Behaviour, outcomes: Mapping[str, Outcome], *, seed: int = 0, arena: Arena | None = None
) -> dict[str, Any]:
    """Return a comparison as JSON.

    Args:
        script: script or behaviour that was played.
        outcomes: figures by the controller's name.
        seed: seed of the sensor noise.
        arena: robot, drives and sensors; None for the default ones.
    """
    return {
        "script": script.name if isinstance(script, Script) else getattr(script, "__name__", "behaviour"),
        "duration": script.duration if isinstance(script, Script) else LONGEST,
        "seed": seed,
        "arena": dataclasses.asdict(arena or Arena()),
        "controllers": {name: dataclasses.asdict(outcome) for name, outcome in outcomes.items()},
    }


def figure_table(outcomes: Mapping[str, Outcome]) -> Table:
    """Return a table with a row for each figure and a column for each controller.

    Args:
        outcomes: figures by the controller's name, at least one.
    """
    rows: list[tuple[Any, ...]] = [
        ("fell", *(outcome.fell for outcome in outcomes.values())),
        ("survived [s]", *(outcome.survived_s for outcome in outcomes.values())),
    ]
    for name in next(iter(outcomes.values())).errors:
        label = f"error {name} [{COMMAND_UNITS[name]}]"
        rows.append((label, *(outcome.errors[name] for outcome in outcomes.values())))
    for part, label, scale in HAND_ROWS:
        values = [outcome.hand_travel[part] for outcome in outcomes.values()]
        rows.append((label, *(None if value is None else scale * value for value in values)))
    reachable = (outcome.hand_error_m["reachable_fraction"] for outcome in outcomes.values())
    rows.append(("part of targets that the IK calls reachable", *reachable))
    for part in ("p50", "p99"):
        rows.append((f"tick {part} [ms]", *(outcome.tick_ms[part] for outcome in outcomes.values())))
    for part in ("p50", "p99"):
        rows.append((f"hand IK {part} [ms]", *(outcome.ik_ms[part] for outcome in outcomes.values())))
    rows.append(("control steps", *(outcome.steps for outcome in outcomes.values())))
    rows.append(("footsteps", *(outcome.footsteps for outcome in outcomes.values())))
    return Table("Figures", ("", *outcomes), rows, HAND_NOTE)

"""The suite of loco-manipulation tasks: how often a controller succeeds at each, and why it fails."""

import polars as pl

from hugwbc.controller import Controller
from hugwbc.evaluation import metrics
from hugwbc.evaluation.episode import BY_BEHAVIOUR, CountedSettings, Row, ending
from hugwbc.evaluation.experiment import Experiment
from hugwbc.evaluation.figures import FALLS, Figure, falls_figure
from hugwbc.evaluation.intervals import bootstrap_mean, known, single, wilson_of, wilson_percentage
from hugwbc.evaluation.plans import Plan
from hugwbc.runtime.trace import RECORD_PERIOD
from hugwbc.settings import Count, Positive, check_each_once, check_seeds, settings
from hugwbc.sim import Simulation
from hugwbc.tasks.run_task import run_task
from hugwbc.tasks.task import LONGEST, TASK_NAMES, load_task
from hugwbc.tasks.verdict import stillness


@settings(kw_only=True)
class TasksSettings(CountedSettings):
    """Settings of tasks."""

    episodes: Count = 50  # number of episodes of each task; the scene of each is drawn with the seed plus its number
    # names of the tasks, or Python files with tasks of your own; all of the suite by default
    task: tuple[str, ...] = TASK_NAMES
    duration: Positive = LONGEST  # every task has its own time limit
    varied = BY_BEHAVIOUR | {"engine", "terrain_roughness", "slope", "duration"}

    def __post_init__(self) -> None:
        super().__post_init__()
        check_seeds(self.seed, self.episodes)
        tasks = [load_task(name) for name in self.task]
        check_each_once("tasks", [task.name for task in tasks])
        self.conditions.check_duration(max(task.limit for task in tasks))


def plan(settings: TasksSettings) -> list[Plan]:
    """Return the episodes of each task."""
    return [Plan(draw, tags={"task": name}) for name in settings.task for draw in range(settings.episodes)]


def episode(controller: Controller, settings: TasksSettings, plan: Plan) -> Row:
    """Run one episode of a task.

    - `seed`: of the scene and of the sensors; `hugwbc play --task TASK --seed SEED` shows the same episode.
    - `success`, `reason`: whether the task was done, and why not; `detail`: see `Verdict`.
    - `score`: 0 to 1.
    - `seconds`: time until the behaviour ended, or the limit if it was done without that [s]; None if a fall or the
      limit ended it undone.
    - `hand_acceleration`: root mean square of the hands' acceleration [m/s^2].
    - `energy`: mechanical energy of the joints; braking costs as much as driving [J].
    - `drift`: farthest way of the pelvis while told to stand [m]; `end_speed`: its speed at the end [m/s].
    - `gripped`: bodies that the idealised gripper held. `hand_depth`: how deep a hand was in an object, at most [m].
    """
    conditions, task, seed = settings.conditions, load_task(str(plan.tags["task"])), settings.seed + plan.draw
    task = task.sized(settings.robot)
    simulation = conditions.simulation(settings.duration, seed, task.scene)
    assert isinstance(simulation, Simulation)  # the settings refuse other engines
    run = run_task(task, controller, simulation, conditions.estimator(), conditions.upper_body(), strict=False)
    verdict, record, trace = run.verdict, run.record, run.trace
    drift, speed = stillness(record)
    seconds = len(trace.time) * RECORD_PERIOD
    return {
        **ending(trace),
        "seed": seed,
        "success": verdict.success,
        "reason": verdict.reason,
        "detail": verdict.detail,
        "score": verdict.score,
        "seconds": run.seconds,
        "hand_acceleration": known(metrics.hand_acceleration(record.hands)),
        "energy": known(metrics.mechanical_power(trace, settle=0.0) * seconds),
        "drift": drift,
        "end_speed": speed,
        "gripped": list(record.gripped),
        "hand_depth": max(record.depth.values(), default=0.0),
    }


def figures(settings: TasksSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return success, time, score, hands and energy of each task, and the reasons of its failures."""
    found = []
    for path in rows["task"].unique(maintain_order=True).to_list():
        name, part = load_task(path).name, rows.filter(pl.col("task") == path)
        done, failed = part.filter(pl.col("success")), part.filter(~pl.col("success"))
        success = wilson_percentage(part["success"])
        gripped = wilson_percentage([len(bodies) > 0 for bodies in part["gripped"]])
        found += [
            Figure(name, "success", "% of episodes", success, higher_is_better=True),
            Figure(name, "time of a success", "s", bootstrap_mean(done["seconds"])),
            Figure(name, "score", "", bootstrap_mean(part["score"]), higher_is_better=True),
            Figure(name, "hand acceleration of a success", "m/s²", bootstrap_mean(done["hand_acceleration"])),
            Figure(name, "energy of a success", "J", bootstrap_mean(done["energy"])),
            Figure(name, "pelvis travel while told to stand, at most", "m", single(max(part["drift"]))),
            Figure(name, "speed at the end, at most", "m/s", single(max(part["end_speed"]))),
            Figure(name, "hand in an object, at most", "m", single(max(part["hand_depth"]))),
            Figure(name, "idealised gripper", "% of episodes", gripped),
            falls_figure(name, part["fell"], quantity=f"{FALLS}, in the task"),
        ]
        reasons = failed.group_by("reason", maintain_order=True).len().sort("len", descending=True, maintain_order=True)
        for reason, count in reasons.iter_rows():
            found.append(Figure(name, f"failed: {reason}", "% of episodes", wilson_of(count, len(part))))
    return found


EXPERIMENT = Experiment(
    "tasks",
    "loco-manipulation tasks with objects: how often each succeeds, and why not",
    TasksSettings,
    plan,
    episode,
    figures,
)

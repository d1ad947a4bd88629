"""What recipes need from this room and from the QP: teachers, tables at the report seed, executed commands."""

import dataclasses
import itertools
import pathlib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hugwbc.commands import COMMAND_NAMES, Command, default_command
from hugwbc.controller import Controller
from hugwbc.errors import UnknownNameError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.episode import Row, Settings, simulate
from hugwbc.evaluation.execution import Execution
from hugwbc.evaluation.experiment import run_experiment, run_plans
from hugwbc.evaluation.experiments import experiment_of
from hugwbc.evaluation.metrics import SETTLE_S, stepping_feet, touch_downs
from hugwbc.evaluation.plans import Plan
from hugwbc.evaluation.store import Store
from hugwbc.files import finite_json
from hugwbc.gait import Gait
from hugwbc.kinematics import MEASURED_NAMES
from hugwbc.learned.imitation.imitation import Teacher
from hugwbc.learned.recipe.recipe_records import CalibrationSettings
from hugwbc.robot import Robot
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.runtime.trace import Trace
from hugwbc.seeds import REPORT_SEED

Table = Mapping[str, Any]


def executed_means(trace: Trace, settle: float = SETTLE_S) -> dict[str, float]:
    """Return the means of the executed commands after `settle` [s]; of l, that of the highest clearances of swings."""
    kept = trace.time >= settle
    if trace.fell or not kept.any():
        return dict.fromkeys((*MEASURED_NAMES, "l"), float("nan"))
    means = dict(zip(MEASURED_NAMES, trace.measured[kept].mean(axis=0).tolist(), strict=True))
    heights = []
    for foot in stepping_feet(Gait(int(trace.gait[-1]))):
        for begin, end in itertools.pairwise(touch_downs(trace, foot, settle)):
            cycle = (trace.time >= begin) & (trace.time <= end)
            heights.append(float(trace.clearance[cycle, foot].max()))
    return means | {"l": float(np.mean(heights)) if heights else float("nan")}


def _episode(controller: Controller, settings: Settings, plan: Plan) -> Row:
    return executed_means(simulate(controller, settings, plan).trace)


class RecipeServices:
    """`hugwbc.learned.recipe.stage_work.Services`: the QP as a teacher, and this room's experiments."""

    def teacher(self, robot: Robot) -> Callable[[float], Teacher]:
        """Return what makes a QP for a control period [s]."""
        from hugwbc.mbc import WholeBodyController

        return lambda period: WholeBodyController(period=period, robot=robot)

    def check_table(self, table: Table) -> None:
        """Refuse a table that cannot be run.

        Raises:
            UnknownNameError: if the experiment, the gait or a setting does not exist.
            ConfigError: if a value is out of range.
        """
        settings_of(table, REPORT_SEED)

    def simulated_seconds(self, table: Table) -> float:
        """Return how much a table simulates [s]."""
        settings = settings_of(table, REPORT_SEED)
        return len(experiment_of(table["protocol"]).plan(settings)) * settings.duration

    def run_table(
        self,
        policy: pathlib.Path,
        table: Table,
        *,
        seed: int,
        workers: int,
        folder: pathlib.Path,
        on_episode: Callable[[], None],
    ) -> dict[str, Any]:
        """Run a table with a policy; arguments as in `Services`."""
        spec = ControllerSpec("learned", str(policy))

        def on_progress(done: float, read: float) -> None:
            on_episode()

        with Execution(workers) as execution:
            result = run_experiment(
                experiment_of(table["protocol"]),
                settings_of(table, seed),
                spec,
                execution=execution,
                store=Store(folder),
                on_progress=on_progress,
            )
        content = {"seed": seed, "episodes": len(result.rows), "rows": result.rows}
        return finite_json(content | {"figures": [dataclasses.asdict(figure) for figure in result.figures]})

    def executed(
        self, policy: pathlib.Path, commands: list[dict[str, Any]], settings: CalibrationSettings, workers: int
    ) -> list[dict[str, float]]:
        """Return what a policy executes under some commands; arguments as in `Services`."""
        plans = [Plan(draw, _command(values)) for draw, values in enumerate(commands)]
        episodes = Settings(seed=settings.seed, duration=settings.duration, conditions=Conditions())
        with Execution(workers) as execution:
            spec = ControllerSpec("learned", str(policy))
            rows = dict(run_plans(_episode, episodes, spec, list(enumerate(plans)), execution))
        return [rows[index] for index in range(len(plans))]


def _command(values: Mapping[str, Any]) -> Command:
    command = default_command(Gait.parse(values["gait"]))
    return dataclasses.replace(command, **{name: float(values[name]) for name in COMMAND_NAMES if name in values})


def settings_of(table: Table, seed: int) -> Any:  # noqa: ANN401  each protocol has its own type
    """Return the settings of an experiment from a table: its name, its gait, its own settings and conditions.

    Args:
        table: values by name.
        seed: seed of the episodes.

    Raises:
        UnknownNameError: if the experiment, the gait or a setting does not exist.
        ConfigError: if a value is out of range or of the wrong type.
    """
    name = str(table.get("protocol"))
    experiment = experiment_of(name)
    around = {field.name for field in dataclasses.fields(Conditions)}
    valid = {field.name for field in dataclasses.fields(experiment.settings)} - {"seed", "conditions"}
    given = {key: value for key, value in table.items() if key != "protocol"}
    for key in given:
        if key not in valid | around:
            raise UnknownNameError(f"setting of the {name} experiment", key, sorted(valid | around))
    conditions = Conditions(**{key: value for key, value in given.items() if key in around - valid})
    return experiment.settings(
        **{key: value for key, value in given.items() if key in valid}, seed=seed, conditions=conditions
    )

"""What recipes need from packages above `learned`: how a policy responds in the arena."""

import pathlib
from collections.abc import Mapping
from typing import Any

from hugwbc.commands import COMMAND_NAMES, Command
from hugwbc.controller import Controller
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.episode import Row, Settings, simulate
from hugwbc.evaluation.execution import Execution
from hugwbc.evaluation.experiment import run_plans
from hugwbc.evaluation.metrics import executed_means
from hugwbc.evaluation.plans import Plan
from hugwbc.gait import Gait
from hugwbc.learned.config import CalibrationConfig
from hugwbc.learned.policy.records import robot_of
from hugwbc.robot import Robot, load_robot
from hugwbc.runtime.controllers import ControllerSpec


def _episode(controller: Controller, settings: Settings, plan: Plan) -> Row:
    return executed_means(simulate(controller, settings, plan))


def executed(
    policy: pathlib.Path, commands: list[dict[str, Any]], config: CalibrationConfig, workers: int = 1
) -> list[dict[str, float]]:
    """Return what a policy executes under some commands (`hugwbc.learned.recipe.calibration.Executed`).

    Commands are given as gait and values; the rest is at its default. Processes share the episodes.
    """
    name = robot_of(policy)
    plans = [Plan(draw, _command(values, load_robot(name))) for draw, values in enumerate(commands)]
    episodes = Settings(seed=config.seed, duration=config.duration, conditions=Conditions(robot=name))
    with Execution(workers) as execution:
        spec = ControllerSpec("learned", str(policy))
        rows = dict(run_plans(_episode, episodes, spec, list(enumerate(plans)), execution))
    return [rows[index] for index in range(len(plans))]


def _command(values: Mapping[str, Any], robot: Robot) -> Command:
    given = {name: float(values[name]) for name in COMMAND_NAMES if name in values}
    return Command.from_mapping(given, Gait.parse(values["gait"]), robot)

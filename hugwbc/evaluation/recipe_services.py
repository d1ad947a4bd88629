"""What recipes need from packages above `learned`: a controller that drives, and how a policy responds in the arena."""

import dataclasses
import pathlib
from collections.abc import Callable, Mapping
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
from hugwbc.learned.env.start_recorder import Teacher
from hugwbc.learned.policy.records import robot_of
from hugwbc.robot import Robot, load_robot
from hugwbc.runtime.controllers import ControllerSpec


def _episode(controller: Controller, settings: Settings, plan: Plan) -> Row:
    return executed_means(simulate(controller, settings, plan))


@dataclasses.dataclass(frozen=True)
class RecipeServices:
    """`hugwbc.learned.recipe.run.Services`: the QP drives; processes share the episodes."""

    workers: int = 1

    def teacher(self, robot: Robot) -> Callable[[float], Teacher]:
        """Return what makes a QP for a control period [s]."""
        from hugwbc.mbc import WholeBodyController

        return lambda period: WholeBodyController(period=period, robot=robot)

    def executed(
        self, policy: pathlib.Path, commands: list[dict[str, Any]], config: CalibrationConfig
    ) -> list[dict[str, float]]:
        """Return what a policy executes under some commands, given as gait and values; the rest is at its default."""
        name = robot_of(policy)
        plans = [Plan(draw, _command(values, load_robot(name))) for draw, values in enumerate(commands)]
        episodes = Settings(seed=config.seed, duration=config.duration, conditions=Conditions(robot=name))
        with Execution(self.workers) as execution:
            spec = ControllerSpec("learned", str(policy))
            rows = dict(run_plans(_episode, episodes, spec, list(enumerate(plans)), execution))
        return [rows[index] for index in range(len(plans))]


def _command(values: Mapping[str, Any], robot: Robot) -> Command:
    given = {name: float(values[name]) for name in COMMAND_NAMES if name in values}
    return Command.from_mapping(given, Gait.parse(values["gait"]), robot)

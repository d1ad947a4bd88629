"""What recipes need from packages above `learned`: how a policy responds in the arena."""

import functools
import pathlib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hugwbc.behaviours import BehaviourSource, Course, View, walk_to
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
from hugwbc.learned.recipe.calibration import Arena
from hugwbc.robot import Robot, load_robot
from hugwbc.runtime.controllers import ControllerSpec

_RUNS, _GOALS, _LONGEST = 3, (0.4, 0.0, 0.4), 60.0  # runs, goals of each [heights of the pelvis], and its limit [s]


def arena(workers: int = 1) -> Arena:
    """Return the arena of a calibration, in which so many processes share the episodes."""
    return Arena(functools.partial(executed, workers=workers), functools.partial(stop, workers=workers))


def _episode(controller: Controller, settings: Settings, plan: Plan) -> Row:
    return executed_means(simulate(controller, settings, plan))


def executed(
    policy: pathlib.Path, commands: list[dict[str, Any]], config: CalibrationConfig, workers: int = 1
) -> list[dict[str, float]]:
    """Return what a policy executes under some commands (`hugwbc.learned.recipe.calibration.Executed`).

    Commands are given as gait and values; the rest is at its default. Processes share the episodes.
    """
    robot = load_robot(robot_of(policy))
    plans = [Plan(draw, _command(values, robot)) for draw, values in enumerate(commands)]
    return _run(policy, config, config.duration, _episode, plans, workers)


def _command(values: Mapping[str, Any], robot: Robot) -> Command:
    given = {name: float(values[name]) for name in COMMAND_NAMES if name in values}
    return Command.from_mapping(given, Gait.parse(values["gait"]), robot)


def stop(policy: pathlib.Path, config: CalibrationConfig, workers: int = 1) -> tuple[float, float, float]:
    """Return by how much a stop moves the robot [m, m, rad] (`Contract.stop`).

    This is the median of the runs that stay up and stop; zeros without one.
    """
    rows = _run(policy, config, _LONGEST, _walks_episode, [Plan(draw) for draw in range(_RUNS)], workers)
    found = [row["stop"] for row in rows if row["stop"] is not None]
    x, y, yaw = np.median(found, axis=0).round(4).tolist() if found else (0.0, 0.0, 0.0)
    return x, y, yaw


_Episode = Callable[[Controller, Settings, Plan], Row]


def _run(
    policy: pathlib.Path, config: CalibrationConfig, duration: float, episode: _Episode, plans: list[Plan], workers: int
) -> list[Row]:
    """Run a policy's episodes, each of at most a duration [s], in the arena; return their rows in order."""
    settings = Settings(seed=config.seed, duration=duration, conditions=Conditions(robot=robot_of(policy)))
    with Execution(workers) as execution:
        spec = ControllerSpec("learned", str(policy))
        rows = dict(run_plans(episode, settings, spec, list(enumerate(plans)), execution))
    return [rows[index] for index in range(len(plans))]


def _walks(view: View) -> Course:
    """Walk to and fro; each walk ends with at least one stop."""
    size = view.position[2]
    for x in _GOALS:
        view = yield from walk_to(view, (x * size, 0.0), 0.0)
    return view


def _walks_episode(controller: Controller, settings: Settings, plan: Plan) -> Row:
    source = BehaviourSource(_walks)
    trace = simulate(controller, settings, plan, source=source, until=lambda: source.done)
    seen = None if trace.down or source.view is None else source.view.stop
    return {"stop": None if seen is None or not seen.any() else seen.tolist()}  # zeros: it never came to a stop

"""A recipe in which every kind of stage takes seconds, and services that stand in for the QP and the evaluations."""

import dataclasses
import pathlib
import shutil
from collections.abc import Callable, Mapping
from typing import Any

import pytest
import torch

from hugwbc.commands import Command
from hugwbc.controller import JointCommand, UpperBody
from hugwbc.errors import ConfigError
from hugwbc.learned.recipe.recipe_file import load_recipe
from hugwbc.learned.recipe.recipe_records import CalibrationSettings, Recipe
from hugwbc.learned.recipe.recipe_run import RunOptions, run_recipe
from hugwbc.robot import Robot
from hugwbc.state import RobotState

TINY = """
about: A policy of no use, in seconds.
seed: 2001
measure: {robots: 4, seconds: 0.1}
settings:
  threads: 1
  env.count: 8
  env.curriculum.warm_up_iterations: 0
stages:
  labels:
    kind: imitate
    settings: {samples: 640, batch: 64, updates: 2, starts: 16, handover: 1.0, env.command.standing_fraction: 1.0,
               env.command.walking_fraction: 0.0}
    every: 320
  gaits:
    kind: train
    inputs: {start_from: labels, ppo.labels: labels}
    every: 64
    settings: {steps: 192, ppo.horizon: 4, ppo.minibatches: 2, ppo.epochs: 1, critic_warm_up: 1,
               ppo.cloning_batch: 32, ppo.cloning_weight: 0.1, env.command.resample_steps: 3}
    schedules:
      ppo.beta: {linear: [0.5, 0.1]}
      env.randomization.push_velocity: {steps: {0: 0.1, 0.5: 0.6}}
  merged:
    kind: distil
    inputs: {start_from: gaits, standing: labels, walking: gaits}
    every: 400
    settings: {samples: 800, memory: 500, batch: 64, updates: 2, calibration: 0.2,
               env.command.standing_fraction: 0.5, env.command.walking_fraction: 0.5}
  calibrated:
    kind: calibrate
    inputs: {policy: merged}
    settings: {gaits: [walking], commands: [v_x, h], knots: 3, rounds: 2, rate: 1.0}
  figures:
    kind: evaluate
    inputs: {policy: calibrated}
    tables:
      - {protocol: single-command, gait: walking, episodes: 8}
      - {protocol: single-command, gait: standing, episodes: 4}
  policy:
    kind: export
    inputs: {policy: calibrated, snapshot: merged, figures: figures}
profiles:
  half:
    train: {steps: 96, every: 32}
"""


class Stand:
    """A teacher that holds the nominal pose."""

    phase = 0.25
    stepping = False

    def __init__(self, robot: Robot) -> None:
        self._robot = robot

    def reset(self, state: RobotState) -> None:
        pass

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        return JointCommand.position(self._robot, self._robot.nominal.copy())


@dataclasses.dataclass
class FakeServices:
    """Services without physics: a policy executes 0.8 of what it is asked for."""

    tables: list[Mapping[str, Any]] = dataclasses.field(default_factory=list)
    asked: list[tuple[pathlib.Path, list[dict[str, Any]]]] = dataclasses.field(default_factory=list)

    def teacher(self, robot: Robot) -> Callable[[float], Stand]:
        return lambda period: Stand(robot)

    def check_table(self, table: Mapping[str, Any]) -> None:
        if table.get("protocol") != "single-command":
            raise ConfigError(f"unknown protocol '{table.get('protocol')}'")

    def simulated_seconds(self, table: Mapping[str, Any]) -> float:
        return 10.0 * table.get("episodes", 1)

    def run_table(self, policy: pathlib.Path, table: Mapping[str, Any], **options: Any) -> dict[str, Any]:
        self.tables.append(table)
        for _ in range(table["episodes"]):
            options["on_episode"]()
        return {"errors": {"E_vx_low": 0.03, "E_l": None}, "falls": 0, "seed": options["seed"], "rows": [1, 2]}

    def executed(
        self, policy: pathlib.Path, commands: list[dict[str, Any]], settings: CalibrationSettings, workers: int
    ) -> list[dict[str, float]]:
        from hugwbc.commands import COMMAND_NAMES, default_command
        from hugwbc.gait import Gait
        from hugwbc.learned.policy import load_policy
        from hugwbc.learned.policy.feed_forward import FeedForward

        self.asked.append((policy, commands))
        feed_forward = FeedForward(load_policy(policy).contract.feed_forward)
        rows = []
        for values in commands:
            gait = Gait.parse(values["gait"])
            given = {name: value for name, value in values.items() if name != "gait"}
            command = dataclasses.replace(default_command(gait), **given).array()[None]
            asked = feed_forward.asked(command, torch.tensor([int(gait)]).numpy())[0]
            rows.append({name: 0.8 * float(asked[COMMAND_NAMES.index(name)]) for name in given})
        return rows


@pytest.fixture
def services() -> FakeServices:
    torch.set_num_threads(1)
    return FakeServices()


@pytest.fixture
def make_recipe(tmp_path: pathlib.Path) -> Callable[..., Recipe]:
    """Return a function that reads a recipe from text, the tiny one by default, with replacements."""

    def make(text: str = TINY, *replacements: tuple[str, str], profile: str | None = None) -> Recipe:
        for old, new in replacements:
            assert old in text, old
            text = text.replace(old, new)
        path = tmp_path / "tiny.yaml"
        path.write_text(text)
        return load_recipe(path, profile=profile)

    return make


@pytest.fixture
def tiny() -> str:
    return TINY


@pytest.fixture(scope="session")
def _finished(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    torch.set_num_threads(1)
    folder = tmp_path_factory.mktemp("finished")
    (folder / "tiny.yaml").write_text(TINY)
    assert run_recipe(load_recipe(folder / "tiny.yaml"), RunOptions(folder / "run"), FakeServices())
    return folder / "run"


@pytest.fixture
def finished(_finished: pathlib.Path, tmp_path: pathlib.Path) -> pathlib.Path:
    """Return the folder of a finished run of the tiny recipe, a copy that a test may damage."""
    shutil.copytree(_finished, tmp_path / "finished")
    return tmp_path / "finished"

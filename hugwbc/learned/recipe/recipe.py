"""Recipe files: stages in order, each of which trains or calibrates a policy."""

import dataclasses
import pathlib
from typing import Annotated, Literal

from pydantic import Field

from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.learned.config import CalibrationConfig, TrainConfig
from hugwbc.learned.policy.network_files import POLICY_FILE, SNAPSHOT_FILE
from hugwbc.robot_tables import models_dir
from hugwbc.settings import TRAINING_SEED, settings
from hugwbc.settings_file import named_path, parse, read_text

TAKEN = {"start_from": SNAPSHOT_FILE, "policy": POLICY_FILE}  # what a stage takes of another one, by setting
_OF_THE_RUN = ("out", "resume", "hours", "seed")  # settings of a training that are one for all stages of a recipe
_SMOKE_STEPS = 1536


@settings(kw_only=True)
class Stage:
    """A step of a recipe: it trains a policy, or calibrates one.

    `start_from` and `policy` may name an earlier stage in place of a file: its snapshot or policy is taken.
    """

    about: str = ""
    train: TrainConfig | None = None
    calibrate: CalibrationConfig | None = None

    def __post_init__(self) -> None:
        """Require exactly one of train and calibrate."""
        if (self.train is None) == (self.calibrate is None):
            raise ConfigError("a stage does one thing; give one of train, calibrate")

    @property
    def kind(self) -> Literal["train", "calibrate"]:
        """What the stage does."""
        return "calibrate" if self.train is None else "train"

    @property
    def config(self) -> TrainConfig | CalibrationConfig:
        """The settings."""
        return getattr(self, self.kind)

    def inputs(self) -> dict[str, pathlib.Path]:
        """Return what the stage takes, by the name of the setting: the path of a file, or the name of a stage."""
        given = {setting: getattr(self.config, setting, None) for setting in TAKEN}
        return {setting: path for setting, path in given.items() if path is not None}

    def smoke(self) -> "Stage":
        """Return the same stage with small sizes, so that it takes a few seconds."""
        config = self.config
        if isinstance(config, CalibrationConfig):
            few = {"gaits": ("standing", "walking"), "commands": ("v_x", "h")}
            return dataclasses.replace(
                self, calibrate=dataclasses.replace(config, knots=2, rounds=1, duration=1.5, **few)
            )
        factor = _SMOKE_STEPS / config.steps
        small = dataclasses.replace(
            config,
            steps=_SMOKE_STEPS,
            evaluation_steps=_SMOKE_STEPS / 2,
            evaluation_robots=16,
            evaluation_seconds=1.2,
            critic_warm_up=min(config.critic_warm_up, 1),
            env=dataclasses.replace(config.env, count=16),
            ppo=dataclasses.replace(config.ppo, horizon=8, epochs=1, minibatches=2),
            schedules={name: one.stretched(factor) for name, one in config.schedules.items()},
        )
        return dataclasses.replace(self, train=small)


@settings(kw_only=True)
class Recipe:
    """A sequence of stages that makes a policy.

    Attributes:
        name: its name.
        source: text of the file.
        about: what it makes, a sentence.
        seed: seed of its stages, one of training (2000 to 2999).
        stages: by name, each after those that it takes something from; the last one makes the policy.
    """

    name: str
    source: str
    about: str = ""
    seed: Annotated[int, Field(ge=2000, le=2999)] = TRAINING_SEED
    stages: Annotated[dict[str, Stage], Field(min_length=1)]

    def __post_init__(self) -> None:
        """Check that each stage takes from an earlier stage or an existing file, and sets nothing of the whole run."""
        earlier: list[str] = []
        for name, stage in self.stages.items():
            if not name.replace("-", "_").isidentifier():
                raise ConfigError(f"a stage is called '{name}'; use letters, digits, _ and -", at=("stages", name))
            for setting in _OF_THE_RUN if stage.train is not None else ():
                value = getattr(stage.train, setting)
                if value != getattr(TrainConfig, setting) and (setting != "seed" or value != self.seed):
                    raise ConfigError(
                        f"{setting} is not for a stage: the recipe has the seed, --out is the folder, the same command "
                        "continues, and Ctrl-C stops; leave it out",
                        at=("stages", name, "train", setting),
                    )
            for setting, path in stage.inputs().items():
                # All stages write a policy; only a training writes a snapshot besides.
                writing = [label for label in earlier if setting == "policy" or self.stages[label].kind == "train"]
                if str(path) not in writing and (str(path) in self.stages or not path.exists()):
                    valid = [*writing, "the path of a file"]
                    at = ("stages", name, stage.kind, setting)
                    what = f"earlier stage that writes {TAKEN[setting]}, in {setting}"
                    raise UnknownNameError(what, path, valid, at=at)
                if str(path) not in writing and not path.is_file():
                    problem = f"{setting} is the folder {path}; give the file in it, {path / TAKEN[setting]}"
                    raise ConfigError(problem, at=("stages", name, stage.kind, setting))
            earlier.append(name)

    def line(self, name: str) -> list[str]:
        """Return a stage and the stages that led to it, the latest first; each takes from at most one other."""
        found: list[str] = []
        while name in self.stages:
            found.append(name)
            name = next(map(str, self.stages[name].inputs().values()), "")
        return found


def load_recipe(name_or_path: str | pathlib.Path, *, smoke: bool = False) -> Recipe:
    """Read a recipe, given the name of a shipped one of any robot, or the path of a file.

    Args:
        name_or_path: such as "h1", or a path that ends in .yaml.
        smoke: whether to make all sizes small, to see in a minute that the whole recipe runs.
    """
    path = named_path("recipe", name_or_path, *sorted(models_dir().glob("*/recipes")))
    text = read_text(path)
    recipe = parse(Recipe, text, path, name=path.stem, source=text)
    if smoke:
        stages = {name: stage.smoke() for name, stage in recipe.stages.items()}
        recipe = dataclasses.replace(recipe, name=f"{recipe.name} --smoke", stages=stages)
    return recipe

"""Recipe files: stages in order, each of which records starts, trains, or calibrates a policy."""

import dataclasses
import pathlib
from typing import Annotated

from pydantic import Field

from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.files import read_file
from hugwbc.learned.config import CalibrationConfig, RecordConfig, TrainConfig
from hugwbc.robot_tables import models_dir
from hugwbc.settings import TRAINING_SEED, settings
from hugwbc.settings_file import LARGEST_FILE, named_path, parse

POLICY, SNAPSHOT, STARTS = "policy.safetensors", "snapshot.safetensors", "starts.safetensors"
KINDS = ("record", "train", "calibrate")
TAKEN = {"env.starts": STARTS, "start_from": SNAPSHOT, "policy": POLICY}  # of another stage, by the setting's name
_WRITTEN = {"record": (STARTS,), "train": (SNAPSHOT, POLICY), "calibrate": (POLICY,)}  # by the kind of the stage
_SMOKE_STEPS = 1536
Config = RecordConfig | TrainConfig | CalibrationConfig


@settings(kw_only=True)
class Stage:
    """A step of a recipe: one of `KINDS`, with its settings.

    Settings that are paths may name an earlier stage instead: its snapshot, policy or starts are taken.
    """

    about: str = ""
    record: RecordConfig | None = None
    train: TrainConfig | None = None
    calibrate: CalibrationConfig | None = None

    def __post_init__(self) -> None:
        """Require one kind."""
        if sum(getattr(self, kind) is not None for kind in KINDS) != 1:
            raise ConfigError(f"a stage does one thing; give one of {', '.join(KINDS)}")

    @property
    def kind(self) -> str:
        """What the stage does, one of `KINDS`."""
        return next(kind for kind in KINDS if getattr(self, kind) is not None)

    @property
    def config(self) -> Config:
        """The settings."""
        return getattr(self, self.kind)

    def inputs(self) -> dict[str, pathlib.Path]:
        """Return the files that the stage reads, or the stages that write them, by the name of the setting."""
        config = self.config
        if isinstance(config, CalibrationConfig):
            return {"policy": config.policy}
        found = {"env.starts": config.env.starts}
        if isinstance(config, TrainConfig):
            found["start_from"] = config.start_from
        return {name: path for name, path in found.items() if path is not None}

    def smoke(self) -> "Stage":
        """Return the same stage with every size divided, so that it takes a few seconds."""
        small: Config
        if self.record is not None:
            env = dataclasses.replace(self.record.env, count=8)
            small = dataclasses.replace(self.record, states=64, env=env)
        elif self.train is not None:
            t, factor = self.train, _SMOKE_STEPS / self.train.steps
            small = dataclasses.replace(
                t,
                steps=_SMOKE_STEPS,
                evaluation_steps=_SMOKE_STEPS / 2,
                evaluation_robots=16,
                evaluation_seconds=1.2,
                critic_warm_up=min(t.critic_warm_up, 1),
                env=dataclasses.replace(t.env, count=16),
                ppo=dataclasses.replace(t.ppo, horizon=8, epochs=1, minibatches=2),
                schedules={name: one.stretched(factor) for name, one in t.schedules.items()},
            )
        else:
            assert self.calibrate is not None
            small = dataclasses.replace(
                self.calibrate, knots=2, rounds=1, duration=1.5, gaits=("standing", "walking"), commands=("v_x", "h")
            )
        return dataclasses.replace(self, **{self.kind: small})


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
        """Check that what a stage takes is there: an earlier stage, or a file."""
        earlier: dict[str, Stage] = {}
        for name, stage in self.stages.items():
            if not name.replace("-", "_").isidentifier():
                raise ConfigError(f"a stage is called '{name}'; use letters, digits, _ and -", at=("stages", name))
            for setting, path in stage.inputs().items():
                writing = [label for label, one in earlier.items() if TAKEN[setting] in _WRITTEN[one.kind]]
                if str(path) not in writing and (str(path) in earlier or not path.exists()):
                    valid = [*writing, "the path of a file"]
                    at = ("stages", name, stage.kind, *setting.split("."))
                    what = f"earlier stage that writes {TAKEN[setting]}, in {setting}"
                    raise UnknownNameError(what, path, valid, at=at)
            earlier[name] = stage


def load_recipe(name_or_path: str | pathlib.Path, *, smoke: bool = False) -> Recipe:
    """Read a recipe, given the name of a shipped one of any robot, or the path of a file.

    Args:
        name_or_path: such as "h1", or a path that ends in .yaml.
        smoke: whether to divide every size, to see in a minute that all of it runs.
    """
    path = named_path("recipe", name_or_path, *sorted(models_dir().glob("*/recipes")))
    try:
        text = read_file(path, LARGEST_FILE).decode()
    except (OSError, ValueError) as error:
        raise ConfigError(f"cannot read {path}: {error}; give a YAML file in UTF-8") from error
    recipe = parse(Recipe, text, path, name=path.stem, source=text)
    if smoke:
        stages = {name: stage.smoke() for name, stage in recipe.stages.items()}
        recipe = dataclasses.replace(recipe, name=f"{recipe.name} --smoke", stages=stages)
    return recipe

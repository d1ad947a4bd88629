"""`hugwbc train`: reinforcement learning of a policy, by options, by settings in Python, or by a recipe."""

import dataclasses
import itertools
import math
import os
import pathlib
import shlex
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from hugwbc import extensions
from hugwbc.cli import INTERRUPTED, USAGE_ERROR
from hugwbc.cli.output import output_folder, parse, parse_known, parse_settings, progress, say, take
from hugwbc.errors import ConfigError
from hugwbc.files import digest
from hugwbc.learned.config import TrainConfig
from hugwbc.learned.config.schedules import value_of
from hugwbc.settings import Count, settings

if TYPE_CHECKING:
    from hugwbc.learned.recipe.recipe import Recipe

LINE_INTERVAL = 10.0  # [s] between two lines of figures
_CALIBRATION = 3e6  # environment steps that take about as long as a calibration
_DESCRIPTION = """Train a policy. Ctrl-C saves and stops; --resume continues.

With --config FILE.py, the CONFIG of a Python file takes the place of the defaults: docs/how-to/change-the-training.md.
With --recipe NAME, the stages of a recipe are run in order instead: `hugwbc train --recipe h1 --help`. Options change
a recipe with one stage that trains.
With --processes N, N processes on this machine train as one, each with --env.count robots and --threads threads."""


@settings
class RecipeOptions:
    """Make a policy by a recipe, or continue its run; Ctrl-C stops, and the same command continues.

    Options of `hugwbc train` change a recipe with one stage that trains.
    """

    recipe: str  # Name of a shipped recipe, or path of a recipe file that ends in .yaml
    out: pathlib.Path | None = None  # Folder of the run; runs/NAME by default
    smoke: bool = False  # Divide every size, to see in a minute that all of it runs
    workers: Count = 1  # Processes that share the episodes of a calibration


def run(words: Sequence[str]) -> int:
    """Parse the options, train, report."""
    processes, words = take(words, "train", "--processes", type=int, default=1)
    cores = os.cpu_count() or 1
    if not 1 <= processes <= cores:
        raise ConfigError(f"processes is {processes}; give 1 to {cores}, the cores of this machine")
    if processes > 1:
        return _train_together(processes, words)
    if any(word.partition("=")[0] == "--recipe" for word in words):
        return _run_recipe(words)
    config = _parse(words)
    with output_folder(config.out), progress(f"training {config.out}") as advance:
        from hugwbc.learned.rl import train

        line = _Line()

        def report(figures: Mapping[str, float], gates: Mapping[str, str]) -> None:
            advance(figures["progress"])
            line(figures, gates)

        trainer = train(config, report, say)
    if trainer.leads:
        before = trainer.begin["iteration"]
        ancestor = f", after {before} iterations, {trainer.begin['steps']:.3g} steps of another run" if before else ""
        own = f"{trainer.iteration - before} iterations, {trainer.run_steps:.3g} steps{ancestor}"
        say(f"stopped after {own}; saved in {config.out}")
    return INTERRUPTED if trainer.stop.requested else 0


def _train_together(processes: int, words: Sequence[str]) -> int:
    """Let torchrun start processes that train as one, and wait for them."""
    from torch.distributed import run as torchrun
    from torch.distributed.elastic.multiprocessing.api import SignalException
    from torch.distributed.elastic.multiprocessing.errors import ChildFailedError

    try:
        torchrun.main(["--standalone", f"--nproc-per-node={processes}", "-m", "hugwbc.cli", "train", *words])
    except ChildFailedError:  # the process has said why
        return USAGE_ERROR
    except (SignalException, KeyboardInterrupt):  # which the processes have got too, so they have saved
        return INTERRUPTED
    return 0


def _parse(words: Sequence[str]) -> TrainConfig:
    """Return the settings: options over those of a Python file, if one is given, or over the defaults."""
    given, words = take(words, "train", "--config")
    if given is None:
        return parse_settings(TrainConfig, words, "train", description=_DESCRIPTION)
    name = given if extensions.names_object(given) else f"{given}:CONFIG"
    found = extensions.load_object(name, "CONFIG")
    if not isinstance(found, TrainConfig):
        raise ConfigError(f"{name} is a {type(found).__name__}; make it a hugwbc.learned.config.TrainConfig")
    path, _ = extensions.split_object(name)
    default = dataclasses.replace(found, source=f"{path.name} {digest(path.read_bytes())}")
    config = parse_settings(TrainConfig, words, "train", description=_DESCRIPTION, default=default)
    _check_options(config, default)
    return config


def _check_options(config: TrainConfig, default: TrainConfig) -> None:
    """Refuse options for settings that follow a schedule, which replaces them."""
    for name in default.schedules:
        if value_of(config, name) != value_of(default, name):
            raise ConfigError(f"{name} follows a schedule, which an option does not change; change it in the file")


def _run_recipe(words: Sequence[str]) -> int:
    from hugwbc.evaluation.recipe_services import arena
    from hugwbc.learned.recipe.recipe import load_recipe
    from hugwbc.learned.recipe.run import run_recipe

    if any(word.partition("=")[0] == "--config" for word in words):
        raise ConfigError("--recipe and --config are both given, and each has all settings; give one or the other")
    options, changes = parse_known(RecipeOptions, words, "train")
    recipe = load_recipe(options.recipe, smoke=options.smoke)
    recipe = _changed(recipe, changes) if changes else recipe
    out = options.out or pathlib.Path("runs") / pathlib.Path(options.recipe).stem
    sizes = {name: getattr(stage.config, "steps", _CALIBRATION) for name, stage in recipe.stages.items()}
    line = _Line()
    with output_folder(out), progress(f"recipe {recipe.name}") as advance:

        def report(stage: str, figures: Mapping[str, float], gates: Mapping[str, str]) -> None:
            before = sum(sizes[name] for name in itertools.takewhile(lambda name: name != stage, sizes))
            advance((before + figures["progress"] * sizes[stage]) / sum(sizes.values()))
            if "iteration" in figures:
                line(figures, gates)

        finished = run_recipe(recipe, out, arena(options.workers), report=report, say=say)
    return 0 if finished else INTERRUPTED


def _changed(recipe: "Recipe", words: list[str]) -> "Recipe":
    """Return a recipe with options of `hugwbc train` in the place of its one training's settings; its text says so."""
    trained = {name: stage.train for name, stage in recipe.stages.items() if stage.train is not None}
    if len(trained) != 1:
        raise ConfigError(
            f"{words[0]} changes recipes with one stage that trains; {recipe.name} has {', '.join(trained) or 'none'}. "
            "Change a copy of its file, and give --recipe its path"
        )
    ((name, train),) = trained.items()
    train = dataclasses.replace(train, seed=recipe.seed)
    config = parse(TrainConfig, words, "train", default=train)
    _check_options(config, train)
    return dataclasses.replace(
        recipe,
        source=f"# hugwbc train {shlex.join(words)}\n{recipe.source}",
        seed=config.seed,
        stages=recipe.stages | {name: dataclasses.replace(recipe.stages[name], train=config)},
    )


class _Line:
    """Prints a line of figures now and then, and every evaluation."""

    def __init__(self) -> None:
        self._last = -LINE_INTERVAL

    def __call__(self, figures: Mapping[str, float], gates: Mapping[str, str]) -> None:
        evaluation = {name: value for name, value in figures.items() if name.startswith("evaluation/")}
        if any(math.isfinite(value) for value in evaluation.values()):
            parts = [f"{name.removeprefix('evaluation/')} {value:.3f}" for name, value in evaluation.items()]
            say(f"evaluation at iteration {figures['iteration']:.0f}: {', '.join(parts)}")
        if time.monotonic() - self._last < LINE_INTERVAL:
            return
        self._last = time.monotonic()
        say(
            f"iteration {figures['iteration']:.0f}  steps {figures['steps']:.3g}  "
            f"{figures['steps_per_second']:.0f} steps/s  reward {figures['reward']:.3f}  "
            f"episode {figures['episode_length']:.0f} steps  falls {figures['falls']:.0f}  "
            + "; ".join(f"{gate}: {state}" for gate, state in gates.items())
        )

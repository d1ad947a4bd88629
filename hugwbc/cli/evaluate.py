"""`hugwbc evaluate EXPERIMENT`: one experiment with one controller; each is a subcommand with its own options."""

import contextlib
import dataclasses
import pathlib
from collections.abc import Sequence
from typing import Any

import tyro

from hugwbc.cli.output import check_writable, output_folder, parse, progress, say, write_json
from hugwbc.errors import ConfigError
from hugwbc.evaluation.execution import Execution
from hugwbc.evaluation.experiment import Experiment, Result, run_experiment
from hugwbc.evaluation.experiments import EXPERIMENTS, experiment_of
from hugwbc.evaluation.store import DEFAULT_FOLDER, Store
from hugwbc.evaluation.tables import figures_text
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.seeds import seed_class
from hugwbc.source import source_commit

DEFAULT = "single-command"


@dataclasses.dataclass(frozen=True)
class ControllerOptions:
    """Which controller is evaluated."""

    # name of the controller: learned, qp, hold (a baseline that only holds its pose) or a plug-in; FILE.py:NAME; or the
    # path of a policy, or of a contract for somebody else's policy (docs/evaluation.md)
    controller: str = "learned"
    # name of a shipped policy or path of a policy for the learned controller; path of a network for somebody else's
    # policy
    policy: str | None = None


@dataclasses.dataclass(frozen=True)
class ExecutionOptions:
    """Where episodes run and where their rows go."""

    workers: int = 1  # number of processes that share the episodes
    # address of a Dask scheduler, such as tcp://127.0.0.1:8786, whose workers run the episodes instead
    cluster: str | None = None
    # folder in which finished episodes are stored; those already stored are not run again. None stores none
    results: pathlib.Path | None = DEFAULT_FOLDER
    fresh: bool = False  # run all episodes again; the new rows take the place of the stored ones
    json: pathlib.Path | None = None  # file to write figures and rows to; without a path, they go to standard output


def run(words: Sequence[str]) -> int:
    """Parse, run the experiment, print and write its figures."""
    experiment, spec, options = parse_experiment(words)
    place: ExecutionOptions = options.execution
    if EXPERIMENTS.get(experiment.name) is not experiment and (place.workers > 1 or place.cluster is not None):
        raise ConfigError("an experiment of a file runs in one process; leave out --workers and --cluster")
    store = Store(place.results, fresh=place.fresh)
    results = contextlib.nullcontext() if place.results is None else output_folder(place.results)
    check_writable(place.json)
    execution = Execution(place.workers, cluster=place.cluster)
    with results, progress(f"{spec.label}, {experiment.name}") as advance, execution:
        result = run_experiment(
            experiment, options.experiment, spec, execution=execution, store=store, on_progress=advance
        )
    say(describe(experiment, result), place.json)
    write_json(place.json, to_json(result))
    return 0


def parse_experiment(words: Sequence[str]) -> tuple[Experiment[Any], ControllerSpec, Any]:
    """Return experiment, controller and options (`experiment`, `execution`) of the words of `hugwbc evaluate`."""
    name, words = _name(list(words))
    experiment = experiment_of(name)
    options = _parse(experiment, words)
    return experiment, ControllerSpec(options.controller.controller, options.controller.policy), options


def describe(experiment: Experiment[Any], result: Result) -> str:
    """Return the figures as tables, with the experiment's note and the controller's exceptions."""
    failures = sum(row.get("failures") or 0 for row in result.rows)
    lines = [figures_text(result.figures, result.controller)]
    lines += [experiment.note] if experiment.note else []
    lines += [f"The controller raised {failures} exceptions, which the safety filter caught."] if failures else []
    return "\n".join([*lines, f"{len(result.rows)} episodes, seed {result.settings.seed}"])


def to_json(result: Result) -> dict[str, Any]:
    """Return a result as JSON: the figures before what may be thousands of rows."""
    return {
        "experiment": result.experiment,
        "controller": result.controller,
        "commit": source_commit(),
        "settings": dataclasses.asdict(result.settings),
        "seed_class": seed_class(result.settings.seed),
        "figures": [dataclasses.asdict(figure) for figure in result.figures],
        "rows": result.rows,
    }


def _name(words: list[str]) -> tuple[str, list[str]]:
    """Return the experiment that the words name, and the remaining words; print the list on request."""
    if words and not words[0].startswith("-"):
        return words[0], words[1:]
    if {"-h", "--help"} & set(words):
        width = max(map(len, EXPERIMENTS))
        lines = [f"  {name:<{width}}  {experiment.summary}" for name, experiment in EXPERIMENTS.items()]
        print("usage: hugwbc evaluate EXPERIMENT [OPTIONS]\n")
        print("Run an experiment with one controller, and print its figures together with the paper's.\n")
        print("\n".join(lines))
        print("\n`hugwbc evaluate EXPERIMENT --help` lists the options of one. FILE.py:NAME runs one of your own.")
        print(f"Without EXPERIMENT, {DEFAULT} runs.")
        raise SystemExit(0)
    return DEFAULT, words


def _parse(experiment: Experiment[Any], words: Sequence[str]) -> Any:  # noqa: ANN401  its class is made here
    """Return the options: groups of the controller, of the experiment, of its conditions, and of the execution."""
    parts = {"controller": ControllerOptions, "experiment": experiment.settings, "execution": ExecutionOptions}
    fields = [(name, kind, dataclasses.field(default_factory=kind)) for name, kind in parts.items()]
    options = tyro.conf.OmitArgPrefixes[dataclasses.make_dataclass("Options", fields)]  # type: ignore[valid-type]
    summary = experiment.summary
    return parse(options, words, f"evaluate {experiment.name}", f"{summary[:1].upper()}{summary[1:]}.")

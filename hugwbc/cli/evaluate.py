"""`hugwbc evaluate EXPERIMENT`: one experiment with one controller; each is a subcommand with its own options."""

import contextlib
import dataclasses
import pathlib
from collections.abc import Sequence
from typing import Any

import tyro

from hugwbc.cli.output import check_writable, option_names, output_folder, parse, progress, remark, say, write_json
from hugwbc.errors import ConfigError
from hugwbc.evaluation.execution import Execution
from hugwbc.evaluation.experiment import Experiment, Result
from hugwbc.evaluation.experiments import EXPERIMENTS, experiment_of
from hugwbc.evaluation.store import DEFAULT_FOLDER, Store
from hugwbc.evaluation.study import Entry, remarks, run_study
from hugwbc.evaluation.tables import INTERVAL_NOTE, Table, figure_tables, format_table
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.settings import seed_class
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
    entry, place = parse_entry(words)
    check_writable(place.json)
    results = measured([entry], place)
    say_figures(tables_of(results), [INTERVAL_NOTE, *notes([entry], results)], place.json)
    write_json(place.json, to_json(results[0]))
    return 0


def tables_of(results: Sequence[Result]) -> list[Table]:
    """Return tables of what was measured."""
    return figure_tables(figure for result in results for figure in result.figures if figure.estimate is not None)


def say_figures(tables: Sequence[Table], lines: Sequence[str], json_path: pathlib.Path | None) -> None:
    """Print tables, and lines below them."""
    say(
        "\n\n".join(
            [*(format_table((table.title, *table.columns[1:]), table.rows) for table in tables), "\n".join(lines)]
        ),
        json_path,
    )


def parse_entry(words: Sequence[str]) -> tuple[Entry, ExecutionOptions]:
    """Return what the words of `hugwbc evaluate` run, and where."""
    name, words = _name(list(words))
    experiment = experiment_of(name)
    options = parse_options(f"evaluate {experiment.name}", experiment, words, ControllerOptions)
    spec = ControllerSpec(options.controller.controller, options.controller.policy)
    return Entry(experiment, options.experiment, spec), options.execution


def measured(entries: Sequence[Entry], place: ExecutionOptions) -> list[Result]:
    """Run entries of one experiment where the options say."""
    experiment = entries[0].experiment
    if EXPERIMENTS.get(experiment.name) is not experiment and (place.workers > 1 or place.cluster is not None):
        raise ConfigError("an experiment of a file runs in one process; leave out --workers and --cluster")
    store, execution = Store(place.results, fresh=place.fresh), Execution(place.workers, cluster=place.cluster)
    results = contextlib.nullcontext() if place.results is None else output_folder(place.results)
    what = f"{', '.join(entry.label or entry.spec.label for entry in entries)}, {experiment.name}"
    with results, progress(what) as advance, execution:
        return run_study(
            entries,
            execution=execution,
            store=store,
            on_progress=advance,
            tell=lambda text: remark(f"{what}: {text}"),
        )


def notes(entries: Sequence[Entry], results: Sequence[Result]) -> list[str]:
    """Return what belongs below the figures: the experiment's note, settings, exceptions, too few episodes, seed."""
    experiment, settings, lines = entries[0].experiment, entries[0].settings, []  # as given, before they are adapted
    lines += [experiment.note] if experiment.note else []
    lines += [f"Not the default: {settings.remark}."] if settings.remark else []
    for result in results:
        if mistakes := sum(row.get("mistakes") or 0 for row in result.rows):
            lines.append(
                f"{result.controller}: {mistakes} exceptions or unusable answers of the controller or of the source of "
                "targets were caught; `hugwbc play` shows the first one."
            )
    numbers = dict.fromkeys(f"{len(result.rows)} episodes" for result in results)
    seed = f"seed {settings.seed} ({seed_class(settings.seed)})"
    return [*lines, *remarks(results), f"{' or '.join(numbers)}, {seed}"]


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


def parse_options(verb: str, experiment: Experiment[Any], words: Sequence[str], controller: type[Any]) -> Any:  # noqa: ANN401
    """Return options whose class is made here: `controller`, then `experiment` with its conditions, and `execution`."""
    parts = {"controller": controller, "experiment": experiment.settings, "execution": ExecutionOptions}
    names = [name for kind in parts.values() for name in option_names(kind)]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ConfigError(
            f"experiment '{experiment.name}' has a setting '{twice[0]}', which is an option of all experiments; give "
            "it another name"
        )
    fields = [(name, kind, dataclasses.field(default_factory=kind)) for name, kind in parts.items()]
    options = tyro.conf.OmitArgPrefixes[dataclasses.make_dataclass("Options", fields)]  # type: ignore[valid-type]
    return parse(options, words, verb, description=f"{experiment.summary[:1].upper()}{experiment.summary[1:]}.")

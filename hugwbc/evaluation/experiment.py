"""An experiment: settings, plans, a row of each episode, figures of all rows; and its run with a controller."""

import dataclasses
import threading
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Generic, TypeVar

import polars as pl

from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.evaluation.episode import CountedSettings, Row, Settings
from hugwbc.evaluation.execution import Execution
from hugwbc.evaluation.figures import Figure, judged_fairly
from hugwbc.evaluation.plans import Plan
from hugwbc.evaluation.store import READ, Store, StoredTable, controller_digest
from hugwbc.files import digest_of, noting
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.viz.plots import Panel

S = TypeVar("S", bound=Settings)
Measured = tuple[str, Any, pl.DataFrame]
"""A controller's label, the settings, and the rows."""


@dataclasses.dataclass(frozen=True)
class Section(Generic[S]):
    """What the report says of an experiment."""

    title: str  # heading
    text: str  # how the figures are measured
    # returns the settings of its runs in the report's quick profile: few and short episodes
    quick: Callable[[], Sequence[S]]
    full: Callable[[], Sequence[S]]  # returns the settings of its runs in the full profile: the paper's sizes
    # returns the pictures of all results, given the labels of the report's controllers
    pictures: Callable[[Sequence[Measured], Sequence[str]], Sequence[Panel]] = lambda measured, controllers: ()
    # returns why this installation cannot run it, as a sentence; empty if it can
    unavailable: Callable[[], str] = lambda: ""


@dataclasses.dataclass(frozen=True)
class Experiment(Generic[S]):
    """An experiment for any controller.

    Attributes:
        name: name on the command line and in reports.
        summary: a line for `hugwbc evaluate --help`.
        settings: class of its settings, whose fields are the options of the command line.
        plan: returns the episodes.
        episode: runs one episode with a controller, and returns what it adds to the row beside the plan's tags.
        figures: makes figures of the settings and the rows of all episodes, a polars data frame.
        following: returns the next episodes of a search, given all rows so far; none ends it.
        adapt: returns the settings for a controller.
        note: a sentence below the tables in the terminal.
        section: of the report; None leaves the experiment out.
    """

    name: str
    summary: str
    settings: type[S]
    plan: Callable[[S], Sequence[Plan]]
    episode: Callable[[Controller, S, Plan], Row]
    figures: Callable[[S, pl.DataFrame], list[Figure]]
    _: dataclasses.KW_ONLY
    following: Callable[[S, Sequence[Row]], Sequence[Plan]] = lambda settings, rows: ()
    adapt: Callable[[S, ControllerSpec], S] = lambda settings, spec: settings
    note: str = ""
    section: Section[S] | None = None


@dataclasses.dataclass(frozen=True)
class Result:
    """The rows of an experiment with a controller."""

    experiment: str  # name of the experiment
    controller: str  # label of the controller
    settings: Settings  # settings of the experiment
    plans: list[Plan]  # of the episodes
    rows: list[Row]  # one for each episode, in the order of the plans
    figures: list[Figure]  # figures of all rows


def run_experiment(
    experiment: Experiment[S],
    settings: S,
    spec: ControllerSpec,
    *,
    label: str = "",
    execution: Execution | None = None,
    store: Store | None = None,
    on_progress: Callable[[float], object] = lambda done: None,
) -> Result:
    """Run the episodes of an experiment that are not stored, and return all rows and figures.

    Without a label the controller's own is shown, without an execution the episodes run in this process, and without a
    store the rows are kept in memory only. `on_progress` is called with the part of the planned episodes that is done.
    """
    settings, table = _table(experiment, settings, spec, store)
    known = spec.told(settings.conditions.told_arena)
    made_of = controller_digest(known)
    rows: list[Row] = []
    done: list[Plan] = []
    measured = 0  # of the rows; the others were stored
    plans = list(experiment.plan(settings))
    if not plans:
        raise ConfigError(f"experiment '{experiment.name}' plans no episode; let its `plan` return at least one")
    while plans:
        found = {index: row for index, plan in enumerate(plans) if (row := table.get(plan)) is not None}
        missing = [(index, plan) for index, plan in enumerate(plans) if index not in found]
        if missing and controller_digest(known) != made_of:
            raise ConfigError(
                f"the files of {spec.label} have changed during the run; run it again with what they are now"
            )
        for index, row in run_plans(experiment.episode, settings, known, missing, execution):
            found[index] = table.add(plans[index], row)
            measured += 1
            on_progress((len(rows) + len(found)) / (len(rows) + len(plans)))
        rows += [found[index] for index in range(len(plans))]
        done += plans
        plans = list(experiment.following(settings, rows))
    try:
        summary = experiment.figures(settings, frame_of(rows))
    except (pl.exceptions.PolarsError, TypeError, ValueError) as error:
        if measured == len(rows):
            raise
        raise ConfigError(
            f"{table.path} has rows that experiment '{experiment.name}' did not write ({error}); remove it, and its "
            "episodes run again"
        ) from error
    figures = [
        dataclasses.replace(figure, controller=label or spec.label) if figure.estimate is not None else figure
        for figure in judged_fairly(summary, settings.conditions.robot)
    ]
    return Result(experiment.name, label or spec.label, settings, done, rows, figures)


def stored_episodes(
    experiment: Experiment[S], settings: S, spec: ControllerSpec, store: Store | None
) -> tuple[int, int]:
    """Return the number of planned episodes that are stored, and the number of all planned ones.

    A search is planned as far as its stored episodes go.
    """
    settings, table = _table(experiment, settings, spec, store)
    rows: list[Row | None] = []
    plans = list(experiment.plan(settings))
    while plans:
        rows += map(table.get, plans)
        found = [row for row in rows if row is not None]
        plans = list(experiment.following(settings, found)) if len(found) == len(rows) else []
    return len(rows) - rows.count(None), len(rows)


def _table(experiment: Experiment[S], settings: S, spec: ControllerSpec, store: Store | None) -> tuple[S, StoredTable]:
    """Return the settings for a controller, and the table of its episodes."""
    settings = experiment.adapt(settings, spec)
    known = spec.told(settings.conditions.told_arena)
    return settings, (store or Store(None)).table(experiment.name, experiment.episode, settings, known)


def numbered(settings: CountedSettings) -> list[Plan]:
    """Return a plan for each episode; they differ in what is drawn by their number, such as the errors of sensors."""
    return [Plan(draw) for draw in range(settings.episodes)]


def frame_of(rows: Iterable[Row]) -> pl.DataFrame:
    """Return rows as a data frame."""
    return pl.DataFrame(list(rows), infer_schema_length=None, strict=False)


def run_plans(
    episode: Callable[[Controller, S, Plan], Row],
    settings: S,
    spec: ControllerSpec,
    plans: Iterable[tuple[int, Plan]],
    execution: Execution | None = None,
) -> Iterable[tuple[int, Row]]:
    """Run numbered plans, and yield number and row of each as they finish; the tags of a plan come first in its row.

    `episode` must be a function of a module, so that other processes find it.
    """
    digest = controller_digest(spec)
    jobs = [(episode, settings, spec, digest, index, plan) for index, plan in plans]
    yield from (execution or Execution()).run(_run_job, jobs)


def _run_job(job: tuple[Callable[..., Row], Settings, ControllerSpec, str, int, Plan]) -> tuple[int, Row]:
    episode, settings, spec, digest, index, plan = job
    controller = _controller(spec, digest)
    with noting() as read:
        row = episode(controller, settings, plan)
    read = {**_last.read, **read}
    if spec.is_own:  # what it reads in its first episode may serve it in all
        _last.read = read
    if twice := sorted(plan.tags.keys() & row.keys()):
        raise ConfigError(f"an episode's row has {', '.join(twice)}, as its plan's tags do; give it another name")
    return index, {**plan.tags, **row, READ: read}


class _Last(threading.local):
    """The last controller of a thread: a controller has a state, and a worker may run several threads."""

    key: object = None
    read: Mapping[str, str] = types.MappingProxyType({})
    controller: Controller | None = None


_last = _Last()


def _controller(spec: ControllerSpec, digest: str) -> Controller:
    """Return the controller, made once in each thread as long as it and its files stay the same."""
    same = _last.key == (spec, digest)
    if spec.is_own:
        same = same and all(digest_of(name) == found for name, found in _last.read.items())
    if _last.controller is None or not same:
        with noting() as read:
            _last.key, _last.controller = (spec, digest), spec.build()
        known = set(map(str, spec.files()))  # its digest has them already
        _last.read = {name: found for name, found in read.items() if name not in known}
    return _last.controller

"""Run the episodes of a protocol by plan and keep what a judge makes of each.

`run_episodes` reads the rows that are already stored, hands each missing episode to the execution as a job, and stores
each row as it comes back. A job runs in any process: `run_job` makes the controller, simulates the episode and calls
the judge.
"""

import dataclasses
import functools
import inspect
import math
import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from hugwbc.commands import Command
from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine.execution import Execution
from hugwbc.evaluation.engine.identity import (
    code_identity,
    controller_identity,
    digest,
    judge_module,
    row_type,
    to_json,
)
from hugwbc.evaluation.engine.plans import EpisodePlan
from hugwbc.evaluation.engine.store import ResultStore, plain
from hugwbc.evaluation.metrics import SETTLE_S
from hugwbc.runtime.estimate_watch import EstimateRecord, EstimateWatch
from hugwbc.runtime.rollout import rollout
from hugwbc.runtime.trace import Trace
from hugwbc.seeds import REPORT_SEED

if TYPE_CHECKING:
    from hugwbc.evaluation.moved_arms import ArmIntervention

ControllerFactory = Callable[[], Controller]
"""Builds the controller of an episode."""
Row = TypeVar("Row")
"""The row that is kept of an episode: a dataclass of plain numbers."""
Judge = Callable[[int, "Run"], Row]
"""Makes the row of an episode from its index and its run."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EpisodeSettings:
    """Settings that every protocol has.

    Attributes:
        seed: seed of the sampled commands, the ground, the sensor noise and the arm motion; its class is in
            `hugwbc.seeds`.
        duration: duration of an episode [s].
        settle: start of an episode that is left out of the errors [s].
        conditions: physics, ground, robot, sensors and arms.
        execution: where the episodes run and where their results are stored; it does not change a result.
    """

    seed: int = REPORT_SEED
    duration: float = 10.0
    settle: float = SETTLE_S
    conditions: Conditions = dataclasses.field(default_factory=Conditions)
    execution: Execution = dataclasses.field(default_factory=Execution, compare=False)

    def __post_init__(self) -> None:
        if not 0.0 <= self.settle < self.duration < math.inf:
            raise ConfigError(
                f"duration is {self.duration} s and settle {self.settle} s; give 0 <= settle < duration, finite"
            )
        if self.seed < 0:
            raise ConfigError(f"seed is {self.seed}; give 0 or more")
        self.conditions.check_duration(self.duration)


@dataclasses.dataclass(frozen=True, eq=False)
class Run:
    """One episode that has been simulated.

    Attributes:
        plan: plan of the episode.
        trace: record of the rollout.
        arm_error: mean distance of the arm joints to their external targets after the settling time [rad]; NaN without
            external control.
        estimates: errors of the state estimator, if the plan asks for them and the arena has one.
        outcome: what the plan's stage returned; None without a stage.
    """

    plan: EpisodePlan
    trace: Trace
    arm_error: float
    estimates: EstimateRecord | None = None
    outcome: Any = None

    @property
    def command(self) -> Command:
        """The command at the start; without a schedule or tour, that of the whole episode."""
        return self.plan.command


def run_episodes(
    factory: ControllerFactory,
    plans: Sequence[EpisodePlan],
    judge: Judge[Row],
    settings: EpisodeSettings,
    on_episode: Callable[[Row], None] | None = None,
) -> list[Row]:
    """Run every episode that is not stored yet and return the judge's rows in the order of the plans.

    Args:
        factory: makes the controller; with more than one worker it must be picklable.
        plans: one plan per episode.
        judge: called with the index and the run of every episode; with more than one worker it must be picklable. If
            results are stored, its return annotation must be a dataclass. The rows depend on the code that its module
            imports, and on that of its attribute `modules`, dotted names, if it has one.
        settings: settings of the episodes.
        on_episode: called with every row, in order.

    Raises:
        ResultFileError: if the file of the results cannot be used.
        WorkerError: if a worker process ends or the cluster cannot be used.
    """
    cell = None if settings.execution.store is None else _StoredRows(settings.execution.store, factory, judge, settings)
    rows: dict[int, Row] = {} if cell is None else cell.stored(plans)
    reported = 0

    def report() -> None:
        nonlocal reported
        while reported in rows:
            if on_episode is not None:
                on_episode(rows[reported])
            reported += 1

    report()
    missing = [(index, plan) for index, plan in enumerate(plans) if index not in rows]
    for index, row in settings.execution.run(run_job, _jobs(factory, judge, settings, missing)):
        if cell is not None:
            cell.keep(index, plans[index], row)
        rows[index] = row
        report()
    return [rows[index] for index in range(len(plans))]


@dataclasses.dataclass(frozen=True)
class Job(Generic[Row]):
    """An episode that one process runs.

    Attributes:
        factory: makes the controller.
        judge: makes the row of an episode.
        seed: seed of ground, sensor noise and arm motion, together with an episode's draw.
        duration: duration of an episode [s].
        settle: start of an episode that is left out of the errors [s].
        conditions: conditions of an episode whose plan has none of its own.
        index, plan: of the episode.
    """

    factory: ControllerFactory
    judge: Judge[Row]
    seed: int
    duration: float
    settle: float
    conditions: Conditions
    index: int
    plan: EpisodePlan


def _jobs(
    factory: ControllerFactory, judge: Judge[Row], settings: EpisodeSettings, episodes: list[tuple[int, EpisodePlan]]
) -> list[Job[Row]]:
    """Return a job for each episode."""
    _own.controller = None  # the file of an equal factory's policy may be another one since the last call
    make = functools.partial(
        Job, factory, judge, settings.seed, settings.duration, settings.settle, settings.conditions
    )
    return [make(index, plan) for index, plan in episodes]


class _StoredRows(Generic[Row]):
    """The stored rows of one call of `run_episodes`."""

    def __init__(
        self, store: ResultStore, factory: ControllerFactory, judge: Judge[Row], settings: EpisodeSettings
    ) -> None:
        self._store = store
        self._row_type = row_type(judge)
        self._file = store.cell(*_cell_of(factory, judge, settings))

    def stored(self, plans: Sequence[EpisodePlan]) -> dict[int, Row]:
        """Return the rows that are in the file, by index."""
        keys = {index: _key(index, plan) for index, plan in enumerate(plans)}
        rows = {index: self._restore(self._file[key]) for index, key in keys.items() if key in self._file}
        self._store.restored += len(rows)
        return rows

    def keep(self, index: int, plan: EpisodePlan, row: Row) -> None:
        """Append a row to the file."""
        self._file.add(_key(index, plan), plain(row))

    def _restore(self, stored: Any) -> Row:  # noqa: ANN401  whatever JSON holds
        return _restored(self._row_type, stored)


def stored_rows(factory: ControllerFactory, judge: Judge[Row], settings: EpisodeSettings) -> list[Row]:
    """Return the rows of all episodes that a judge's protocol has stored, whatever their plans.

    Seed, duration, settling time, conditions and code are the same as in `settings`. Nothing is run.

    Args:
        factory: makes the controller.
        judge: judge of the other protocol.
        settings: settings of the episodes; without a store there are no rows.

    Raises:
        ResultFileError: if the file of the results cannot be used.
    """
    store = settings.execution.store
    file = None if store is None else store.peek(*_cell_of(factory, judge, settings))
    kind: type[Row] = row_type(judge)
    return [] if file is None else [_restored(kind, row) for row in file.rows()]


def _cell_of(factory: ControllerFactory, judge: Judge[Row], settings: EpisodeSettings) -> tuple[str, dict[str, Any]]:
    """Return label and identity of the file with the rows that a judge makes under some settings."""
    controller = controller_identity(factory)
    module = judge_module(judge)
    identity = {
        "judge": to_json(judge),
        "seed": settings.seed,
        "duration": settings.duration,
        "settle": settings.settle,
        "conditions": to_json(settings.conditions),
        "controller": controller,
        **code_identity([module, *getattr(judge, "modules", ()), *controller.get("modules", ())]),
    }
    return f"{module.rpartition('.')[2]}-{controller['name']}", identity


def _restored(kind: type[Row], stored: Any) -> Row:  # noqa: ANN401  whatever JSON holds
    return kind(**{name: _frozen(value) for name, value in stored.items()})


def _key(index: int, plan: EpisodePlan) -> str:
    return digest({"index": index, "plan": plan})


def _frozen(value: Any) -> Any:  # noqa: ANN401  whatever JSON holds
    """Return JSON with tuples in place of lists, as the frozen rows have them."""
    if isinstance(value, dict):
        return {key: _frozen(item) for key, item in value.items()}
    return tuple(map(_frozen, value)) if isinstance(value, list) else value


class _OwnController(threading.local):
    """The controller that a thread made last: a controller has a state, and a worker may run several threads."""

    factory: object = None
    controller: Controller | None = None


_own = _OwnController()


def controller_of(factory: ControllerFactory) -> Controller:
    """Return the factory's controller, made once in each thread as long as the factory stays the same."""
    if _own.controller is None or not _same(_own.factory, factory):
        _own.factory, _own.controller = factory, factory()
    return _own.controller


def _same(one: object, other: object) -> bool:
    """Return whether two factories are equal.

    Each job brings its own copy of a bound method's object; the methods count as equal if the objects are.
    """
    if inspect.ismethod(one) and inspect.ismethod(other):
        return one.__func__ is other.__func__ and one.__self__ == other.__self__
    return one == other


def run_job(job: Job[Row]) -> tuple[int, Row]:
    """Run the episode of a job, and return its index and row."""
    run = _run(controller_of(job.factory), job, job.index, job.plan)
    return job.index, job.judge(job.index, run)


def _run(controller: Controller, job: Job[Row], index: int, plan: EpisodePlan) -> Run:
    """Run one episode in a simulation of its own."""
    conditions = plan.conditions or job.conditions
    seed = _seed(job, index, plan)
    if plan.stage is not None:
        trace, outcome = plan.stage.play(controller, conditions, seed)
        return Run(plan, trace, math.nan, outcome=outcome)
    arms, estimator = conditions.arms(seed), conditions.estimator()
    watch = EstimateWatch(estimator) if plan.estimated and estimator is not None else None
    trace = rollout(
        controller,
        plan.source,
        conditions.simulation(job.duration, seed),
        arms,
        duration=job.duration,
        estimator=estimator,
        forces=plan.forces,
        on_step=watch,
    )
    return Run(plan, trace, _arm_error(arms, trace, job.settle), None if watch is None else watch.record())


def _seed(job: Job[Row], index: int, plan: EpisodePlan) -> tuple[int, int]:
    """Return the episode's own seed, so that its process does not matter."""
    return job.seed, index if plan.draw is None else plan.draw


def _arm_error(arms: "ArmIntervention | None", trace: Trace, settle: float) -> float:
    return float("nan") if arms is None else arms.error(trace, settle)

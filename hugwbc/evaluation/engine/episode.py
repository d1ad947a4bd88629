"""Episodes by plan, run here: a simulation for each, and what a judge makes of it."""

import dataclasses
import inspect
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Generic, TypeVar

from hugwbc.commands import Command
from hugwbc.controller import Controller, HasBatch
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine.batch_rollout import Episode, fits, rollouts
from hugwbc.evaluation.engine.plans import EpisodePlan
from hugwbc.runtime.rollout import rollout
from hugwbc.runtime.trace import Trace

if TYPE_CHECKING:
    from hugwbc.evaluation.moved_arms import ArmIntervention

ControllerFactory = Callable[[], Controller]
Row = TypeVar("Row")
Judge = Callable[[int, "Run"], Row]  # makes what is kept of an episode from its index and its run


@dataclasses.dataclass(frozen=True, eq=False)
class Run:
    """One episode that has been run.

    Attributes:
        plan: what was to happen.
        trace: the record.
        arm_error: mean distance of the arm joints to their external targets after the settling time [rad]; NaN without
            external control.
    """

    plan: EpisodePlan
    trace: Trace
    arm_error: float

    @property
    def command(self) -> Command:
        """At the start, and without a schedule all the time."""
        return self.plan.command


@dataclasses.dataclass(frozen=True)
class Job(Generic[Row]):
    """Episodes that one process runs.

    Attributes:
        factory: makes the controller.
        judge: of the episodes.
        seed: of ground, sensors' noise and arms, together with an episode's draw.
        duration: of an episode [s].
        settle: start of an episode that is left out of the errors [s].
        conditions: of episodes whose plan has none of its own.
        episodes: index and plan of each.
    """

    factory: ControllerFactory
    judge: Judge[Row]
    seed: int
    duration: float
    settle: float
    conditions: Conditions
    episodes: tuple[tuple[int, EpisodePlan], ...]


class _OwnController(threading.local):
    """The controller that a thread made last: it has a state, and a cluster's worker may have many threads."""

    factory: object = None
    controller: Controller | None = None


_own = _OwnController()


def controller_of(factory: ControllerFactory) -> Controller:
    """The factory's controller, made once in each thread as long as it is the same factory."""
    if _own.controller is None or not _same(_own.factory, factory):
        _own.factory, _own.controller = factory, factory()
    return _own.controller


def _same(one: object, other: object) -> bool:
    """Whether two factories are equal; bound methods are if their objects are, of which each job brings a copy."""
    if inspect.ismethod(one) and inspect.ismethod(other):
        return one.__func__ is other.__func__ and one.__self__ == other.__self__
    return one == other


def run_job(job: Job[Row]) -> list[tuple[int, Row]]:
    """Index and row of each episode; what can share a batch does."""
    controller = controller_of(job.factory)
    batches: dict[float, list[tuple[int, EpisodePlan]]] = {}
    alone = []
    for index, plan in job.episodes:
        conditions = plan.conditions or job.conditions
        shared = batches.setdefault(conditions.timestep, []) if joins_batch(controller, job.conditions, plan) else alone
        shared.append((index, plan))
    runs: list[tuple[int, Run]] = []
    for episodes in batches.values():
        done, broken = _run_batch(controller, job, episodes)
        runs += done
        alone += broken
    runs += [(index, _run(controller, job, index, plan)) for index, plan in alone]
    return [(index, job.judge(index, run)) for index, run in runs]


def joins_batch(controller: Controller, conditions: Conditions, plan: EpisodePlan) -> bool:
    """Whether an episode can run with others in one batch.

    Args:
        controller: of the episode.
        conditions: of plans that have none of their own.
        plan: of the episode.
    """
    return not plan.timed and fits(controller, plan.conditions or conditions)


def _run_batch(
    controller: Controller, job: Job[Row], episodes: list[tuple[int, EpisodePlan]]
) -> tuple[list[tuple[int, Run]], list[tuple[int, EpisodePlan]]]:
    """Episodes in one batch; runs by index, and what has to run alone."""
    assert isinstance(controller, HasBatch)  # `joins_batch` holds for each episode
    members = []
    for index, plan in episodes:
        conditions = plan.conditions or job.conditions
        members.append(Episode(plan.source, conditions, plan.forces, conditions.arms(_seed(job, index, plan))))
    runs, broken = [], []
    traces = rollouts(controller, members, duration=job.duration)
    for (index, plan), member, trace in zip(episodes, members, traces, strict=True):
        if trace is None:
            broken.append((index, plan))
        else:
            runs.append((index, Run(plan, trace, _arm_error(member.arms, trace, job.settle))))
    return runs, broken


def _seed(job: Job[Row], index: int, plan: EpisodePlan) -> tuple[int, int]:
    """Of its own for every episode, so that it does not matter which process runs it, and with which others."""
    return job.seed, index if plan.draw is None else plan.draw


def _arm_error(arms: "ArmIntervention | None", trace: Trace, settle: float) -> float:
    return float("nan") if arms is None else arms.error(trace, settle)


def _run(controller: Controller, job: Job[Row], index: int, plan: EpisodePlan) -> Run:
    conditions = plan.conditions or job.conditions
    seed = _seed(job, index, plan)
    arms = conditions.arms(seed)
    trace = rollout(
        controller,
        plan.source,
        conditions.simulation(job.duration, seed),
        arms,
        duration=job.duration,
        estimator=conditions.estimator(),
        forces=plan.forces,
    )
    return Run(plan, trace, _arm_error(arms, trace, job.settle))

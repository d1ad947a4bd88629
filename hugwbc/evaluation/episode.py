"""Episodes by plan, run here: a simulation for each, and what a judge makes of it."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Generic, TypeVar

from hugwbc.commands import Command
from hugwbc.controller import Controller
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.plans import EpisodePlan
from hugwbc.evaluation.rollout import Trace, rollout

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


_controller = functools.lru_cache(maxsize=1)(lambda factory: factory())


def run_job(job: Job[Row]) -> list[tuple[int, Row]]:
    """Index and row of each episode."""
    controller = _controller(job.factory)
    return [(index, job.judge(index, _run(controller, job, index, plan))) for index, plan in job.episodes]


def _run(controller: Controller, job: Job[Row], index: int, plan: EpisodePlan) -> Run:
    conditions = plan.conditions or job.conditions
    # Of its own for every episode, so that it does not matter which process runs it, and after which others.
    seed = (job.seed, index if plan.draw is None else plan.draw)
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
    return Run(plan, trace, float("nan") if arms is None else arms.error(trace, job.settle))

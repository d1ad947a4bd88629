"""What the protocols share: episodes by plan, run by one process or several."""

import concurrent.futures
import dataclasses
import functools
import math
import multiprocessing
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeVar

import numpy as np

from hugwbc.commands import Command
from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.evaluation import metrics
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.plans import EpisodePlan
from hugwbc.evaluation.rollout import Trace, rollout
from hugwbc.gait import Gait

ControllerFactory = Callable[[], Controller]
Row = TypeVar("Row")
Judge = Callable[[int, "Run"], Row]  # makes what is kept of an episode from its index and its run


@dataclasses.dataclass(frozen=True, kw_only=True)
class EpisodeSettings:
    """Settings of any protocol.

    Attributes:
        seed: of the sampled commands, the ground, the sensors' noise and the arms.
        duration: of an episode [s].
        settle: start of an episode that is left out of the errors [s].
        workers: processes that share the episodes.
        conditions: physics, ground, robot, sensors and arms.
    """

    seed: int = 0
    duration: float = 10.0
    settle: float = metrics.SETTLE_S
    workers: int = 1
    conditions: Conditions = dataclasses.field(default_factory=Conditions)

    def __post_init__(self) -> None:
        if not 0.0 <= self.settle < self.duration < math.inf:
            raise ConfigError(
                f"duration is {self.duration} s and settle {self.settle} s; give 0 <= settle < duration, finite"
            )
        if self.workers < 1:
            raise ConfigError(f"workers is {self.workers}; give 1 or more")
        if self.seed < 0:
            raise ConfigError(f"seed is {self.seed}; give 0 or more")


@dataclasses.dataclass(frozen=True)
class GaitSettings(EpisodeSettings):
    """Settings of a protocol of one gait, beside those of any.

    Attributes:
        gait: of all episodes.
        both_legs: alternate with the mirrored gait: hopping on the left and on the right leg.
    """

    gait: Gait
    both_legs: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.both_legs and not self.gait.hops:
            raise ConfigError(f"both_legs is for hopping; the gait is {self.gait.label}")

    @property
    def gait_label(self) -> str:
        """Label of the gait; "hopping" for both legs."""
        return "hopping" if self.both_legs else self.gait.label

    @property
    def alternating(self) -> tuple[Gait, Gait]:
        """The gaits that take turns: twice the same one without `both_legs`."""
        return self.gait, self.gait.mirrored() if self.both_legs else self.gait


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


def run_episodes(
    factory: ControllerFactory,
    plans: Sequence[EpisodePlan],
    judge: Judge[Row],
    settings: EpisodeSettings,
    on_episode: Callable[[Row], None] | None = None,
) -> list[Row]:
    """Run every episode and keep what `judge` makes of it.

    Args:
        factory: makes the controller; with more than one worker it must be picklable.
        plans: one per episode.
        judge: called with the index and the run of every episode; with more than one worker it must be picklable.
        settings: of the episodes.
        on_episode: called with every result, in order.
    """
    rows: list[Row] = []
    for row in _results(factory, plans, judge, settings):
        rows.append(row)
        if on_episode is not None:
            on_episode(row)
    return rows


def _results(
    factory: ControllerFactory,
    plans: Sequence[EpisodePlan],
    judge: Judge[Row],
    settings: EpisodeSettings,
) -> Iterator[Row]:
    if settings.workers == 1:
        controller = factory()
        yield from (_run(controller, judge, settings, task) for task in enumerate(plans))
        return
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(settings.workers, mp_context=context) as pool:
        yield from pool.map(functools.partial(_run_in_worker, factory, judge, settings), enumerate(plans))


_worker_controller = functools.lru_cache(maxsize=1)(lambda factory: factory())


def _run_in_worker(
    factory: ControllerFactory,
    judge: Judge[Row],
    settings: EpisodeSettings,
    task: tuple[int, EpisodePlan],
) -> Row:
    return _run(_worker_controller(factory), judge, settings, task)


def _run(controller: Controller, judge: Judge[Row], settings: EpisodeSettings, task: tuple[int, EpisodePlan]) -> Row:
    index, plan = task
    conditions = plan.conditions or settings.conditions
    # Of its own for every episode, so that the number of workers does not matter.
    seed = (settings.seed, index if plan.draw is None else plan.draw)
    arms = conditions.arms(seed)
    trace = rollout(
        controller,
        plan.source,
        conditions.simulation(settings.duration, seed),
        arms,
        duration=settings.duration,
        estimator=conditions.estimator(),
        forces=plan.forces,
    )
    error = float("nan") if arms is None else arms.error(trace, settings.settle)
    return judge(index, Run(plan, trace, error))


def known(value: float) -> float | None:
    """The value, None if it is not finite."""
    return value if math.isfinite(value) else None


def mean(values: Iterable[float | None]) -> float | None:
    """Mean of the values that are known, None if there is none."""
    found = [value for value in values if value is not None]
    return float(np.mean(found)) if found else None

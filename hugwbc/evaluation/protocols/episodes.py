"""What the protocols share: settings, results, and planned episodes that are stored as they finish."""

import dataclasses
import functools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Generic, Protocol, Self, TypeVar

import numpy as np

from hugwbc.errors import ConfigError
from hugwbc.evaluation import metrics
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine.batch_rollout import most_robots
from hugwbc.evaluation.engine.episode import (
    ControllerFactory,
    Job,
    Judge,
    Row,
    Run,
    controller_of,
    joins_batch,
    run_job,
)
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
from hugwbc.gait import Gait

_WORTHWHILE = 64  # robots in a batch; with more of them, the cost of each hardly falls

__all__ = [
    "ControllerFactory",
    "CountedResult",
    "CountedSettings",
    "EpisodeSettings",
    "GaitSettings",
    "Judge",
    "ProtocolResult",
    "Row",
    "Run",
    "known",
    "mean",
    "run_episodes",
]


@dataclasses.dataclass(frozen=True, kw_only=True)
class EpisodeSettings:
    """Settings of every protocol.

    Attributes:
        seed: seed of the sampled commands, the ground, the sensors' noise and the arms.
        duration: length of an episode [s].
        settle: start of an episode that is left out of the errors [s].
        conditions: physics, ground, robot, sensors and arms.
        execution: where the episodes run and where their results are stored; it does not affect any result.
    """

    seed: int = 0
    duration: float = 10.0
    settle: float = metrics.SETTLE_S
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


@dataclasses.dataclass(frozen=True)
class GaitSettings(EpisodeSettings):
    """Settings of a protocol that runs one gait, in addition to `EpisodeSettings`.

    Attributes:
        gait: gait of all episodes.
        both_legs: whether to alternate with the mirrored gait, hopping on the left and on the right leg in turn.
    """

    gait: Gait = Gait.WALKING
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
        """The two gaits that take turns; the same one twice without `both_legs`."""
        return self.gait, self.gait.mirrored() if self.both_legs else self.gait


@dataclasses.dataclass(frozen=True)
class CountedSettings(GaitSettings):
    """Settings of a protocol with a given number of episodes, in addition to `GaitSettings`.

    Attributes:
        episodes: number of episodes.
    """

    episodes: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        least, reason = self.least
        if self.episodes < least:
            raise ConfigError(f"episodes is {self.episodes}; give {least} or more{reason and f': {reason}'}")

    @property
    def least(self) -> tuple[int, str]:
        """The fewest episodes that give every figure at least one, and the reason in words."""
        return 1, ""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ProtocolResult(Generic[Row]):
    """Result of a protocol: settings and episodes, to which each protocol adds its summary.

    Attributes:
        controller: name of the controller.
        gait: label of the gait; "hopping" for both legs.
        seed, duration, settle, conditions: as in the settings.
        rows: one row for each episode.
    """

    controller: str
    gait: str
    seed: int
    duration: float
    settle: float
    conditions: Conditions
    rows: tuple[Row, ...]

    @classmethod
    def of(cls, factory: ControllerFactory, config: GaitSettings, rows: Sequence[Row], **own: Any) -> Self:  # noqa: ANN401
        """Build the result of some episodes.

        Args:
            factory: makes the controller that ran them.
            config: settings of the episodes.
            rows: one row for each episode.
            own: fields that the protocol adds.
        """
        return cls(
            controller=factory().name,
            gait=config.gait_label,
            seed=config.seed,
            duration=config.duration,
            settle=config.settle,
            conditions=config.conditions,
            rows=tuple(rows),
            **own,
        )


class _Falling(Protocol):
    @property
    def fell(self) -> bool: ...


FallingRow = TypeVar("FallingRow", bound=_Falling)


@dataclasses.dataclass(frozen=True, kw_only=True)
class CountedResult(ProtocolResult[FallingRow]):
    """Result of a protocol that counts the falls of all episodes together, in addition to `ProtocolResult`.

    Attributes:
        episodes: number of episodes.
        falls: number of episodes in which the robot fell.
    """

    episodes: int
    falls: int

    @classmethod
    def of(cls, factory: ControllerFactory, config: GaitSettings, rows: Sequence[FallingRow], **own: Any) -> Self:  # noqa: ANN401
        """Build the result of some episodes; arguments as in `ProtocolResult.of`."""
        return super().of(factory, config, rows, episodes=len(rows), falls=sum(row.fell for row in rows), **own)


def run_episodes(
    factory: ControllerFactory,
    plans: Sequence[EpisodePlan],
    judge: Judge[Row],
    settings: EpisodeSettings,
    on_episode: Callable[[Row], None] | None = None,
) -> list[Row]:
    """Run every episode that is not stored yet, and return the rows that `judge` makes of all of them.

    Args:
        factory: makes the controller; it must be picklable if there is more than one worker.
        plans: one plan for each episode.
        judge: called with the index and the run of every episode; it must be picklable if there is more than one
            worker.
        settings: settings of the episodes.
        on_episode: called with every row, in order.
    """
    cell = None if settings.execution.store is None else _Cell(settings.execution.store, factory, judge, settings)
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
    for finished in settings.execution.run(run_job, _jobs(factory, judge, settings, missing)):
        for index, row in finished:
            if cell is not None:
                cell.keep(index, plans[index], row)
            rows[index] = row
        report()
    return [rows[index] for index in range(len(plans))]


def _jobs(
    factory: ControllerFactory, judge: Judge[Row], settings: EpisodeSettings, episodes: list[tuple[int, EpisodePlan]]
) -> list[Job[Row]]:
    """Group the episodes that can share a batch into batches, and leave the others single."""
    if not episodes:
        return []
    make = functools.partial(
        Job, factory, judge, settings.seed, settings.duration, settings.settle, settings.conditions
    )
    controller = controller_of(factory)
    together = [joins_batch(controller, settings.conditions, plan) for _, plan in episodes]
    shared, alone = (
        [e for e, joins in zip(episodes, together, strict=True) if joins is kind] for kind in (True, False)
    )
    size = _batch_size(len(shared), settings)
    batches = [tuple(shared[start : start + size]) for start in range(0, len(shared), size)]
    return [make(batch) for batch in batches] + [make((episode,)) for episode in alone]


def _batch_size(count: int, settings: EpisodeSettings) -> int:
    """Return the number of robots in a batch.

    Batches are small enough for all workers to have one and for some to finish early, and no smaller.
    """
    parallel = settings.execution.parallel
    worthwhile = max(_WORTHWHILE, math.ceil(count / (4 * parallel)))
    return max(1, min(most_robots(settings.duration), math.ceil(count / parallel), worthwhile))


class _Cell(Generic[Row]):
    """The stored episodes of one call of `run_episodes`."""

    def __init__(
        self, store: ResultStore, factory: ControllerFactory, judge: Judge[Row], settings: EpisodeSettings
    ) -> None:
        controller = controller_identity(factory)
        module = judge_module(judge)
        self._store = store
        self._row_type = row_type(judge)
        self._file = store.cell(
            f"{module.rpartition('.')[2]}-{controller['name']}",
            {
                "judge": to_json(judge),
                "seed": settings.seed,
                "duration": settings.duration,
                "settle": settings.settle,
                "conditions": to_json(settings.conditions),
                "controller": controller,
                **code_identity([module, *controller.get("modules", ())]),
            },
        )

    def stored(self, plans: Sequence[EpisodePlan]) -> dict[int, Row]:
        """Return the stored rows by index."""
        keys = {index: _key(index, plan) for index, plan in enumerate(plans)}
        rows = {index: self._restore(self._file[key]) for index, key in keys.items() if key in self._file}
        self._store.restored += len(rows)
        return rows

    def keep(self, index: int, plan: EpisodePlan, row: Row) -> None:
        """Store a row."""
        self._file.add(_key(index, plan), plain(row))

    def _restore(self, stored: Any) -> Row:  # noqa: ANN401  whatever JSON holds
        return self._row_type(**{name: _frozen(value) for name, value in stored.items()})


def _key(index: int, plan: EpisodePlan) -> str:
    return digest({"index": index, "plan": plan})


def _frozen(value: Any) -> Any:  # noqa: ANN401  whatever JSON holds
    """Replace lists by tuples: rows are frozen dataclasses, which hold tuples."""
    if isinstance(value, dict):
        return {key: _frozen(item) for key, item in value.items()}
    return tuple(map(_frozen, value)) if isinstance(value, list) else value


def known(value: float) -> float | None:
    """Return the value, or None if it is not finite."""
    return value if math.isfinite(value) else None


def mean(values: Iterable[float | None]) -> float | None:
    """Return the mean of the known values, or None if there are none."""
    found = [value for value in values if value is not None]
    return float(np.mean(found)) if found else None

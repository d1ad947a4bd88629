"""Settings and results that the protocols share."""

import dataclasses
import math
from collections.abc import Iterable, Sequence
from typing import Any, Generic, Protocol, Self, TypeVar

import numpy as np

from hugwbc.errors import ConfigError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine import ControllerFactory, EpisodeSettings, Judge, Row, Run, run_episodes, stored_rows
from hugwbc.evaluation.intervals import Estimate, wilson_of
from hugwbc.gait import Gait
from hugwbc.seeds import seed_class

__all__ = [
    "ControllerFactory",
    "CountedResult",
    "CountedSettings",
    "EpisodeSettings",
    "GaitSettings",
    "GroupedResult",
    "Judge",
    "ProtocolResult",
    "Row",
    "Run",
    "SettledJudge",
    "known",
    "mean",
    "run_episodes",
    "stored_rows",
]


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


@dataclasses.dataclass(frozen=True)
class SettledJudge:
    """A judge that leaves out the start of every episode.

    Attributes:
        settle: how much of it [s].
    """

    settle: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class ProtocolResult(Generic[Row]):
    """Result of a protocol: settings and episodes, to which each protocol adds its summary.

    Attributes:
        controller: name of the controller.
        gait: label of the gait; "hopping" for both legs.
        seed, duration, settle, conditions: as in the settings.
        seed_class: class of the seed, see `hugwbc.seeds`.
        rows: one row for each episode.
    """

    controller: str
    gait: str
    seed: int
    seed_class: str = dataclasses.field(init=False)
    duration: float
    settle: float
    conditions: Conditions
    rows: tuple[Row, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "seed_class", seed_class(self.seed))  # the dataclass is frozen

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
        falls_interval: the same as a percentage, with its score interval.
    """

    episodes: int
    falls: int
    falls_interval: Estimate = dataclasses.field(init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "falls_interval", wilson_of(self.falls, self.episodes))

    @classmethod
    def of(cls, factory: ControllerFactory, config: GaitSettings, rows: Sequence[FallingRow], **own: Any) -> Self:  # noqa: ANN401
        """Build the result of some episodes; arguments as in `ProtocolResult.of`."""
        return super().of(factory, config, rows, episodes=len(rows), falls=sum(row.fell for row in rows), **own)


@dataclasses.dataclass(frozen=True, kw_only=True)
class GroupedResult(ProtocolResult[Row]):
    """Result of a protocol that runs several groups of equally many episodes, in addition to `ProtocolResult`.

    Attributes:
        episodes: number of episodes of each group.
        falls: number of these in which the robot fell, by group.
        falls_intervals: the same as percentages, with their score intervals.
    """

    episodes: int
    falls: dict[str, int]
    falls_intervals: dict[str, Estimate] = dataclasses.field(init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        intervals = {group: wilson_of(falls, self.episodes) for group, falls in self.falls.items()}
        object.__setattr__(self, "falls_intervals", intervals)


def known(value: float) -> float | None:
    """Return the value, or None if it is not finite."""
    return value if math.isfinite(value) else None


def mean(values: Iterable[float | None]) -> float | None:
    """Return the mean of the known values, or None if there are none."""
    found = [value for value in values if value is not None]
    return float(np.mean(found)) if found else None

"""What the protocols share: settings, and episodes by plan whose results are stored as they are done."""

import dataclasses
import math
from collections.abc import Iterable, Sequence
from typing import Any, Generic, Protocol, Self, TypeVar

import numpy as np

from hugwbc.errors import ConfigError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine import ControllerFactory, EpisodeSettings, Judge, Row, Run, run_episodes
from hugwbc.gait import Gait

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


@dataclasses.dataclass(frozen=True)
class CountedSettings(GaitSettings):
    """Settings of a protocol of a chosen number of episodes, beside those of any of one gait.

    Attributes:
        episodes: how many.
    """

    episodes: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        least, reason = self.least
        if self.episodes < least:
            raise ConfigError(f"episodes is {self.episodes}; give {least} or more{reason and f': {reason}'}")

    @property
    def least(self) -> tuple[int, str]:
        """The fewest episodes with which every figure has one, and why so many."""
        return 1, ""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ProtocolResult(Generic[Row]):
    """Outcome of a protocol: who did what, and the episodes; a protocol adds what follows from them.

    Attributes:
        controller: name.
        gait: label; "hopping" for both legs.
        seed, duration, settle, conditions: as configured.
        rows: the episodes.
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
        """The result of some episodes.

        Args:
            factory: of the controller that ran them.
            config: their settings.
            rows: the episodes.
            own: the fields that the protocol adds.
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
    """Outcome of a protocol whose episodes are counted together, beside that of any.

    Attributes:
        episodes: how many.
        falls: in how many the robot fell.
    """

    episodes: int
    falls: int

    @classmethod
    def of(cls, factory: ControllerFactory, config: GaitSettings, rows: Sequence[FallingRow], **own: Any) -> Self:  # noqa: ANN401
        """The result of some episodes; arguments as of `ProtocolResult.of`."""
        return super().of(factory, config, rows, episodes=len(rows), falls=sum(row.fell for row in rows), **own)


def known(value: float) -> float | None:
    """The value, None if it is not finite."""
    return value if math.isfinite(value) else None


def mean(values: Iterable[float | None]) -> float | None:
    """Mean of the values that are known, None if there is none."""
    found = [value for value in values if value is not None]
    return float(np.mean(found)) if found else None

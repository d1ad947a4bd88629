"""Schedules: the value of a setting as a pure function of a stage's progress, or of the gates that it has passed."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, Literal

from hugwbc.errors import ConfigError
from hugwbc.learned.recipe.conditions_on_figures import Condition, Figures, all_hold

SHAPES = ("linear", "cosine", "geometric", "steps", "gated")
Value = Any  # a number, a tuple of numbers, or, in steps and gated schedules, whatever the setting takes


@dataclasses.dataclass(frozen=True)
class StageSchedule:
    """The value of a setting over a stage.

    Attributes:
        shape: linear, cosine and geometric go from the first value to the second; steps changes at given places;
            gated moves to its next value when conditions on measured figures hold.
        values: two values; with steps and gated one or more.
        places: progress at which a ramp begins and ends, or at which each step begins.
        when: gated only: conditions under which the level rises by one.
        back_when: gated only: conditions under which it falls by one.
    """

    shape: Literal["linear", "cosine", "geometric", "steps", "gated"]
    values: tuple[Value, ...]
    places: tuple[float, ...] = (0.0, 1.0)
    when: tuple[Condition, ...] = ()
    back_when: tuple[Condition, ...] = ()

    def __post_init__(self) -> None:
        """Check places and values.

        Raises:
            ConfigError: if they do not fit the shape.
        """
        ramp = self.shape in ("linear", "cosine", "geometric")
        if ramp and len(self.values) != 2:
            raise ConfigError(f"{self.shape} has {len(self.values)} values; give two, at its begin and at its end")
        if not self.values:
            raise ConfigError(f"{self.shape} has no values; give one or more")
        if self.shape == "gated":
            if not self.when:
                raise ConfigError("gated lacks 'when'; give the conditions under which the value moves on")
            return
        if len(self.places) != len(self.values):
            raise ConfigError(f"{self.shape} has {len(self.values)} values at {len(self.places)} places")
        if not all(0.0 <= place <= 1.0 for place in self.places) or list(self.places) != sorted(set(self.places)):
            raise ConfigError(f"the places {list(self.places)} are not a rising sequence of progress from 0 to 1")
        if self.shape == "steps" and self.places[0] != 0.0:
            raise ConfigError(f"the first step is at {self.places[0]:g}; the first one must be at 0")
        if ramp and not all(_numeric(value) for value in self.values):
            raise ConfigError(f"{self.shape} needs numbers; use steps for other values")
        if self.shape == "geometric" and not all(number > 0.0 for value in self.values for number in _numbers(value)):
            raise ConfigError("geometric needs numbers above 0; use linear")

    def value(self, progress: float, level: int = 0) -> Value:
        """Return the value of the setting.

        Args:
            progress: fraction of the stage that is done, from 0 to 1.
            level: gated only: how often the schedule has moved on.
        """
        if self.shape == "gated":
            return self.values[min(max(level, 0), len(self.values) - 1)]
        if self.shape == "steps":
            return [value for place, value in zip(self.places, self.values, strict=True) if place <= progress][-1]
        begin, end = self.places
        share = min(max((progress - begin) / (end - begin), 0.0), 1.0)
        if self.shape == "cosine":
            share = 0.5 - 0.5 * math.cos(math.pi * share)
        first, last = self.values
        if isinstance(first, tuple):
            return tuple(self._between(a, b, share) for a, b in zip(first, last, strict=True))
        return self._between(first, last, share)

    def _between(self, first: float, last: float, share: float) -> float:
        if share in (0.0, 1.0):  # the ends are exact
            return first if share == 0.0 else last
        if self.shape == "geometric":
            return first * (last / first) ** share
        return first + (last - first) * share

    def next_level(self, level: int, figures: Figures, earlier: Sequence[Figures]) -> int:
        """Return the level after a measurement: one up, one down, or the same.

        Args:
            level: level before it.
            figures: the measurement.
            earlier: measurements before it.
        """
        if self.shape != "gated":
            return level
        if all_hold(self.when, figures, earlier):
            return min(level + 1, len(self.values) - 1)
        if self.back_when and all_hold(self.back_when, figures, earlier):
            return max(level - 1, 0)
        return level


def _numbers(value: Value) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else (value,)


def _numeric(value: Value) -> bool:
    return all(type(number) in (int, float) for number in _numbers(value))

"""Settings that change during a training, as functions of its steps."""

import dataclasses
from collections.abc import Mapping
from typing import Any, Literal, TypeVar

from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.settings import settings

Settings = TypeVar("Settings")


@settings
class Schedule:
    """A setting as a function of the environment steps of a training."""

    points: dict[float, Any]
    """Value by number of steps, ascending; before the first point and after the last the value stays."""
    shape: Literal["linear", "geometric", "steps"] = "linear"
    """Between two points: the value is linear, its logarithm is, or it stays until the next point."""

    def __post_init__(self) -> None:
        """Check the points."""
        places = list(self.points)
        if not places or places != sorted(places):
            raise ConfigError(f"the points of a schedule are at {places}; give one or more, ascending", at=("points",))
        numbers = all(type(value) in (int, float) for value in self.points.values())
        if self.shape != "steps" and not numbers:
            raise ConfigError(f"a {self.shape} schedule needs numbers; use the shape steps", at=("points",))
        if self.shape == "geometric" and not all(value > 0.0 for value in self.points.values()):
            raise ConfigError("a geometric schedule needs numbers above 0; use the shape linear", at=("points",))

    def at(self, steps: float) -> Any:  # noqa: ANN401  whatever the setting is
        """Return the value after a number of environment steps."""
        places = list(self.points)
        after = next((k for k, place in enumerate(places) if place > steps), len(places))
        if after == 0 or after == len(places) or self.shape == "steps":
            return self.points[places[max(after - 1, 0)]]
        begin, end = places[after - 1], places[after]
        low, high = self.points[begin], self.points[end]
        share = (steps - begin) / (end - begin)
        return low * (high / low) ** share if self.shape == "geometric" else low + share * (high - low)

    def stretched(self, factor: float) -> "Schedule":
        """Return the same schedule over `factor` times as many steps."""
        return Schedule({place * factor: value for place, value in self.points.items()}, self.shape)


def scheduled(settings: Settings, schedules: Mapping[str, Schedule], steps: float) -> Settings:
    """Return settings with the scheduled ones at their values after a number of environment steps.

    Args:
        settings: a dataclass of settings, which may hold others.
        schedules: by dotted name of the setting, such as ppo.horizon. Values of whole-number settings are rounded.
        steps: environment steps.
    """
    values: dict[str, Any] = {}
    for name, schedule in schedules.items():
        value = schedule.at(steps)
        values[name] = round(value) if type(value_of(settings, name)) is int else value
    return replaced(settings, values)


def value_of(settings: object, name: str) -> Any:  # noqa: ANN401  whatever the setting is
    """Return the value of a setting by dotted name, such as ppo.horizon; raise UnknownNameError if there is none."""
    value: Any = settings
    for part in name.split("."):
        names = [field.name for field in dataclasses.fields(value)] if dataclasses.is_dataclass(value) else []
        if part not in names:
            raise UnknownNameError("setting", name, names, at=(name,))
        value = getattr(value, part)
    return value


def replaced(settings: Settings, values: Mapping[str, Any]) -> Settings:
    """Return settings with other values, by dotted name such as ppo.horizon.

    All values of a group are replaced at once: the shares of the gaits are only valid together.
    """
    flat: dict[str, Any] = {}
    groups: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        head, _, rest = name.partition(".")
        if rest:
            groups.setdefault(head, {})[rest] = value
        else:
            flat[head] = value
    flat |= {head: replaced(getattr(settings, head), inner) for head, inner in groups.items()}
    return dataclasses.replace(settings, **flat)  # type: ignore[type-var]

"""Settings that change during a training, as functions of its steps, instead of by hand between two trainings."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypeVar

from hugwbc.errors import ConfigError
from hugwbc.learned.config.checks import require

# Groups of settings that the learner and the environment read anew in every iteration.
SCHEDULED = ("ppo", "env.command", "env.rewards", "env.extra", "env.loads", "env.curriculum", "env.squat_gain")

Settings = TypeVar("Settings")


@dataclasses.dataclass(frozen=True)
class Schedule:
    """A number of the settings as a function of the environment steps, linear between points.

    Raises:
        ConfigError: if the setting is not one that may change, or the points are not in order.
    """

    setting: str
    """Name of the setting from the training's configuration on, such as ppo.entropy_weight or env.rewards.feet_slip."""
    steps: tuple[float, ...]
    """Environment steps of the points, ascending; before the first and after the last the value stays."""
    values: tuple[float, ...]
    """Value at each point; a whole number, such as the horizon, is rounded."""
    scale: Literal["linear", "log"] = "linear"
    """Whether the value or its logarithm is linear between the points."""

    def __post_init__(self) -> None:
        """Check the name and the points."""
        group = self.setting.rpartition(".")[0]
        require(
            group in SCHEDULED or self.setting in SCHEDULED,
            "schedule of",
            self.setting,
            f"a number of {', '.join(SCHEDULED)}",
        )
        ordered = all(a < b for a, b in zip(self.steps, self.steps[1:], strict=False))
        name = f"schedule of {self.setting}: steps"
        require(ordered and 0 < len(self.steps) == len(self.values), name, self.steps, "ascending, one for each value")
        positive = self.scale == "linear" or all(value > 0.0 for value in self.values)
        finite = all(map(math.isfinite, self.values))
        require(
            positive and finite, f"schedule of {self.setting}: values", self.values, "finite; above 0 if scale is log"
        )

    def at(self, steps: float) -> float:
        """Return the value after a number of environment steps."""
        if steps <= self.steps[0]:
            return self.values[0]
        for k in range(1, len(self.steps)):
            if steps <= self.steps[k]:
                share = (steps - self.steps[k - 1]) / (self.steps[k] - self.steps[k - 1])
                low, high = self.values[k - 1], self.values[k]
                return low * (high / low) ** share if self.scale == "log" else low + share * (high - low)
        return self.values[-1]


def scheduled(settings: Settings, schedules: Sequence[Schedule], steps: float) -> Settings:
    """Return settings with the scheduled ones at their values after a number of environment steps.

    Raises:
        ConfigError: if a schedule names no number of the settings.
    """
    values: dict[str, float] = {}
    for schedule in schedules:
        old: Any = settings
        for name in schedule.setting.split("."):
            old = getattr(old, name, None)
        if isinstance(old, bool) or not isinstance(old, int | float):
            valid = ", ".join(SCHEDULED)
            raise ConfigError(f"schedule of {schedule.setting}: there is no such number; valid: a number of {valid}")
        value = schedule.at(steps)
        values[schedule.setting] = round(value) if isinstance(old, int) else value
    return replaced(settings, values)


def replaced(settings: Settings, values: Mapping[str, Any]) -> Settings:
    """Return settings with other values.

    All values of a group are replaced at once, so that a group is checked with all of them.

    Args:
        settings: a frozen dataclass, which may hold others.
        values: new values by dotted name, such as ppo.horizon.

    Raises:
        ConfigError: if a value is out of its range.
    """
    own: dict[str, Any] = {}
    groups: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        head, _, rest = name.partition(".")
        if rest:
            groups.setdefault(head, {})[rest] = value
        else:
            own[head] = value
    for head, inner in groups.items():
        own[head] = replaced(getattr(settings, head), inner)
    try:
        return dataclasses.replace(settings, **own)  # type: ignore[type-var]
    except TypeError as error:
        raise ConfigError(f"the values of {', '.join(own)} do not fit together: {error}") from error

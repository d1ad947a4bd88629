"""Settings that change during a training, as functions of its steps, instead of by hand between two trainings."""

import dataclasses
import math
from collections.abc import Sequence
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
    for schedule in schedules:
        settings = _replaced(settings, schedule.setting.split("."), schedule.at(steps), schedule.setting)
    return settings


def _replaced(settings: Any, path: list[str], value: float, name: str) -> Any:  # noqa: ANN401  any dataclass
    old = getattr(settings, path[0], None)
    if len(path) > 1:
        return dataclasses.replace(settings, **{path[0]: _replaced(old, path[1:], value, name)})
    if isinstance(old, int) and not isinstance(old, bool):
        return dataclasses.replace(settings, **{path[0]: round(value)})
    if not isinstance(old, float):
        raise ConfigError(f"schedule of {name}: there is no such number; valid: a number of {', '.join(SCHEDULED)}")
    return dataclasses.replace(settings, **{path[0]: value})

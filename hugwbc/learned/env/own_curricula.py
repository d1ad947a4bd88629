"""Curricula of other packages: numbers of the environment that follow a level, and the rules that move the levels.

A package registers an `OwnCurriculum` as an entry point in the group `hugwbc.curricula`. Its name becomes a setting of
`CurriculumConfig`: how high its level may rise, 0 (off) to 1. After each move of our own curricula, the rule says the
new level from what the training measured, and each number takes its place between the two ends of its range.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from hugwbc.errors import ConfigError
from hugwbc.extensions import described, load_entry
from hugwbc.learned.config.own_settings import registered_curricula
from hugwbc.learned.config.schedules import SCHEDULED, replaced

if TYPE_CHECKING:
    from hugwbc.learned.config import CurriculumConfig, EnvConfig

_ENV = "env."
_GROUPS = tuple(name.removeprefix(_ENV) for name in SCHEDULED if name.startswith(_ENV))


@dataclasses.dataclass(frozen=True)
class Measured:
    """What a rule may judge by; tracking rewards are running means relative to their maxima, 0 to 1.

    Attributes:
        iteration: moves of the curricula so far, this one included.
        agile: linear and angular tracking reward of the walking robots of the agile group; None if it is empty.
        intervened: the same of the walking robots whose arms are taken over; None without intervention.
        penalty_scale: factor on the regularisation rewards.
        alpha: noise level of the intervention.
        max_speed: largest v_x of the agile group [m/s].
    """

    iteration: int
    agile: tuple[float, float] | None
    intervened: tuple[float, float] | None
    penalty_scale: float
    alpha: float
    max_speed: float


@dataclasses.dataclass(frozen=True)
class OwnCurriculum:
    """A level from 0 to 1, the rule that moves it, and the numbers that follow it.

    Attributes:
        rule: returns the new level, of the present one and what was measured. A new level outside of 0 to 1 is clamped.
        settings: values at level 0 and at level 1 by name from `EnvConfig` on, such as {"loads.payload": (0.0, 3.0)}:
            any number that a schedule of a recipe may change.
    """

    rule: Callable[[float, Measured], float]
    settings: Mapping[str, tuple[float, float]]


class OwnLevels:
    """The levels of the curricula of other packages that are switched on.

    Attributes:
        values: the level of each, by name, 0 to how high it may rise.
    """

    def __init__(self, config: "CurriculumConfig") -> None:
        """Start at level 0."""
        self._reach = {name: getattr(config, name) for name in registered_curricula() if getattr(config, name) > 0.0}
        self._found = {name: _load(name) for name in self._reach}
        self.values = dict.fromkeys(self._reach, 0.0)
        nothing = Measured(0, (0.0, 0.0), (0.0, 0.0), config.penalty_start, 0.0, 0.0)
        for name in self._found:
            moved = self._moved(name, nothing)
            if isinstance(moved, str):
                raise ConfigError(f"{_origin(name)} {moved}; return a number from 0 to 1")

    def check(self, config: "EnvConfig") -> None:
        """Refuse numbers that do not exist, or cannot have the values of their ranges."""
        taken: dict[str, str] = {}
        for name, own in self._found.items():
            for setting in own.settings:
                if setting in taken:
                    raise ConfigError(f"{_origin(name)} and '{taken[setting]}' both move {setting}; switch one off")
                taken[setting] = name
                _require_number(name, setting, config)
            for level in (0.0, self._reach[name]):
                try:
                    replaced(config, _values(own, level))
                except ConfigError as error:
                    raise ConfigError(f"{_origin(name)} at level {level:g}: {error}") from error

    def move(self, measured: Measured) -> dict[str, str]:
        """Move the levels; return what happened to each, in words, by name.

        A rule that fails leaves its level where it is: a training of days does not end for it.
        """
        words = {}
        for name in self._found:
            moved = self._moved(name, measured)
            if not isinstance(moved, str):
                self.values[name] = moved
            words[name] = f"stays: the rule {moved}" if isinstance(moved, str) else f"{moved:.3f}"
        return words

    def restore(self, values: Mapping[str, float]) -> None:
        """Set the levels, by name, up to how high each may rise."""
        self.values = {name: min(values[name], self._reach[name]) for name in self._reach}

    def _moved(self, name: str, measured: Measured) -> float | str:
        """Return the new level, or why there is none."""
        try:
            level = float(self._found[name].rule(self.values[name], measured))
        except Exception as error:  # the code of another package may raise anything
            return f"fails: {described(error)}"
        return min(max(level, 0.0), self._reach[name]) if math.isfinite(level) else f"gives {level}"

    def applied(self, config: "EnvConfig") -> "EnvConfig":
        """Return the settings with the numbers of all levels."""
        values: dict[str, Any] = {}
        for name, own in self._found.items():
            values |= _values(own, self.values[name])
        return replaced(config, values) if values else config


def _origin(name: str) -> str:
    return f"curriculum '{name}' ({registered_curricula()[name].value})"


def _load(name: str) -> OwnCurriculum:
    found = load_entry(registered_curricula()[name], "curriculum")
    if not isinstance(found, OwnCurriculum):
        raise ConfigError(f"{_origin(name)} is a {type(found).__name__}; register an OwnCurriculum")
    for setting, ends in found.settings.items():
        numbers = isinstance(ends, tuple) and len(ends) == 2 and all(isinstance(end, int | float) for end in ends)
        if not numbers or not all(map(math.isfinite, ends)):
            raise ConfigError(f"{_origin(name)} has {setting}: {ends}; give two finite numbers, at level 0 and at 1")
    return found


def _require_number(name: str, setting: str, config: "EnvConfig") -> None:
    old: Any = config
    for part in setting.split("."):
        old = getattr(old, part, None)
    known = setting in _GROUPS or setting.rpartition(".")[0] in _GROUPS
    if not known or isinstance(old, bool) or not isinstance(old, int | float):
        raise ConfigError(f"{_origin(name)} moves {setting}, which is no number of {', '.join(_GROUPS)}")


def _values(own: OwnCurriculum, level: float) -> dict[str, float]:
    return {setting: low + level * (high - low) for setting, (low, high) in own.settings.items()}

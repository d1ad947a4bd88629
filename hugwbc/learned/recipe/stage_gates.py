"""Gates of a training stage: when it goes on to the next stage, back to its best checkpoint, or is given up."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from hugwbc.errors import ConfigError
from hugwbc.learned.recipe.conditions_on_figures import Condition, Figures, all_hold

ACTIONS = ("next", "back", "stop")
PROGRESS = "progress"  # figure of every measurement: fraction of the stage that is done


@dataclasses.dataclass(frozen=True)
class Times:
    """A factor on a setting, in the changes that a return to the best checkpoint makes."""

    factor: float


@dataclasses.dataclass(frozen=True)
class Gate:
    """What to do when conditions hold.

    Attributes:
        do: next ends the stage, back returns to its best checkpoint, stop gives the stage up.
        when: conditions that must all hold.
        after: progress of the stage from which the gate counts.
        times: number of measurements in a row in which the conditions must hold.
        change: back only: settings to change from then on, to a value or by a factor.
        at_most: back only: how often; the next time, the stage is given up.
    """

    do: Literal["next", "back", "stop"]
    when: tuple[Condition, ...]
    after: float = 0.0
    times: int = 1
    change: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    at_most: int = 1

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ConfigError: if one is out of range.
        """
        if not 0.0 <= self.after <= 1.0:
            raise ConfigError(f"after is {self.after:g}; give a progress of the stage from 0 to 1")
        if self.times < 1 or self.at_most < 1:
            raise ConfigError(f"times and at_most are {self.times} and {self.at_most}; give 1 or more")
        if self.change and self.do != "back":
            raise ConfigError(f"'change' means nothing to a gate that does '{self.do}'; it belongs to 'back'")

    def open(self, measurements: Sequence[Figures]) -> bool:
        """Return whether the gate acts after the last of some measurements."""
        if len(measurements) < self.times:
            return False
        newest = range(len(measurements) - self.times, len(measurements))
        return all(
            measurements[i].get(PROGRESS, 1.0) >= self.after and all_hold(self.when, measurements[i], measurements[:i])
            for i in newest
        )

    def reason(self) -> str:
        """Say in words why the gate acted."""
        often = f" in {self.times} measurements" if self.times > 1 else ""
        return " and ".join(map(str, self.when)) + often


def open_gate(gates: Sequence[Gate], measurements: Sequence[Figures]) -> Gate | None:
    """Return the first gate that acts after the last of some measurements; None if none does."""
    return next((gate for gate in gates if gate.open(measurements)), None)

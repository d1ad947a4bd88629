"""Conditions on measured figures, such as "evaluation/falls < 0.02": the words of gates and of gated schedules."""

import dataclasses
import math
import re
from collections.abc import Mapping, Sequence

from hugwbc.errors import ConfigError

Figures = Mapping[str, float]
_FORM = re.compile(r"(below|above|<=|>=|<|>)\s*([-+0-9.eE]+)(?:\s+(best))?")
_WORDS = {"below": "<", "above": ">"}  # YAML wants quotes around a text that begins with >
FORM_HINT = "write below 0.02, or above 0.5, or relative to the best value so far: above 1.3 best"


@dataclasses.dataclass(frozen=True)
class Condition:
    """A comparison of one figure with a number.

    Attributes:
        figure: name of the figure, as in the log of a training or in its evaluations.
        relation: one of <, <=, >, >=.
        number: what the figure is compared with, or the factor on its best value so far.
        of_best: whether `number` is a factor on the best value: the smallest one for > and >=, else the largest.
    """

    figure: str
    relation: str
    number: float
    of_best: bool = False

    @classmethod
    def parse(cls, figure: str, text: str) -> "Condition":
        """Read a condition from its form in a recipe, such as "below 0.02" or "above 1.3 best".

        Raises:
            ConfigError: if the text has another form.
        """
        match = _FORM.fullmatch(text.strip())
        try:
            number = float(match[2]) if match else math.nan
        except ValueError:
            number = math.nan
        if match is None or not math.isfinite(number):
            raise ConfigError(f"'{text}' is not a condition on {figure}; {FORM_HINT}")
        return cls(figure, _WORDS.get(match[1], match[1]), number, match[3] is not None)

    def __str__(self) -> str:
        return f"{self.figure} {self.relation} {self.number:g}{' best' if self.of_best else ''}"

    def holds(self, figures: Figures, earlier: Sequence[Figures] = ()) -> bool:
        """Return whether the condition holds; it does not where its figure is missing or NaN.

        Args:
            figures: the newest measurement.
            earlier: measurements before it, among which the best value is looked for.
        """
        value, limit = figures.get(self.figure, math.nan), self.number
        if self.of_best:
            known = [one[self.figure] for one in earlier if math.isfinite(one.get(self.figure, math.nan))]
            if not known:
                return False
            limit *= min(known) if self.relation.startswith(">") else max(known)
        if self.relation.startswith("<"):
            return value < limit or (self.relation == "<=" and value == limit)
        return value > limit or (self.relation == ">=" and value == limit)


def all_hold(conditions: Sequence[Condition], figures: Figures, earlier: Sequence[Figures] = ()) -> bool:
    """Return whether every condition holds; arguments as for `Condition.holds`."""
    return all(condition.holds(figures, earlier) for condition in conditions)

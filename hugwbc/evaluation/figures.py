"""One measured or published number, and how it compares with the paper's and with another controller's."""

import dataclasses
import enum
from collections.abc import Iterable

from hugwbc.evaluation.intervals import CONFIDENCE, FEW, Estimate, wilson_percentage
from hugwbc.evaluation.paper import ROBOT
from hugwbc.robot import load_robot

FALLS = "falls"
MOST_FALLS = 5.0  # [% of episodes]; above it, means lack too much of what fell early to be judged


class Comparison(enum.Enum):
    """How a figure compares with another one."""

    BETTER = "better"
    UNCLEAR_BETTER = "better, within the interval"
    UNCLEAR_WORSE = "worse, within the interval"
    WORSE = "worse"
    NONE = ""


@dataclasses.dataclass(frozen=True)
class Difference:
    """By how much a figure exceeds that of another controller, over the episodes in which both have a value."""

    against: str  # label of the other controller
    estimate: Estimate  # of the difference; its interval is a paired bootstrap
    p: float | None = None  # that of the exact test, of a percentage, whose difference has no interval
    judged: bool = True  # whether both figures are judged

    @property
    def is_clear(self) -> bool:
        """Whether it is unlikely to be chance: p is below 0.05, or the interval of enough episodes leaves out 0.

        Intervals of figures that are not judged are never clear: means lack what fell early.
        """
        low, high, pairs = self.estimate.low, self.estimate.high, self.estimate.samples
        if low is None or high is None:
            return self.p is not None and self.p < 1.0 - CONFIDENCE
        return self.judged and pairs >= FEW and not low <= 0.0 <= high


@dataclasses.dataclass(frozen=True)
class Figure:
    """One number of a table.

    Attributes:
        table: title of the table.
        quantity: row of the table.
        unit: unit of the measured and the paper's value.
        estimate: measured value with its interval; None for a published figure that was not measured.
        paper: the paper's value for HugWBC; None if the paper prints none.
        controller: column of the table; empty for a figure that only the paper has, and until it is filled in.
        published: value that others published for this controller, which was not run here.
        higher_is_better: whether higher values are better, or lower ones; None where neither is the case.
        reference: which of the paper's policies `paper` belongs to, where the paper prints several.
        difference: from another controller's figure; None where there is none to compare with.
        judged: whether the figure is judged against the paper's, and its mean against another controller's.
    """

    table: str
    quantity: str
    unit: str
    estimate: Estimate | None
    paper: float | None = None
    _: dataclasses.KW_ONLY
    controller: str = ""
    published: float | None = None
    higher_is_better: bool | None = False
    reference: str = ""
    difference: Difference | None = None
    judged: bool = True

    @property
    def label(self) -> str:
        """The quantity with its unit."""
        return f"{self.quantity} [{self.unit}]" if self.unit else self.quantity

    @property
    def value(self) -> float | None:
        """The number, measured or published."""
        return self.published if self.estimate is None else self.estimate.value

    @property
    def ratio(self) -> tuple[float, float | None, float | None] | None:
        """Ratio to the paper's value, with the bounds of its interval; None if one of the two is missing."""
        if self.estimate is None or self.estimate.value is None or not self.paper:
            return None
        paper, low, high = self.paper, self.estimate.low, self.estimate.high
        return self.estimate.value / paper, None if low is None else low / paper, None if high is None else high / paper

    @property
    def against_paper(self) -> Comparison:
        """The comparison with the paper, whose own uncertainty is not known; unclear for fewer than `FEW` samples."""
        if self.estimate is None or self.ratio is None or not self.judged:
            return Comparison.NONE
        sign = -1.0 if self.higher_is_better else 1.0
        excess, *bounds = (sign * (part - 1.0) for part in self.ratio if part is not None)
        bounds = bounds if self.estimate.samples >= FEW else []
        if excess <= 0.0:
            return Comparison.BETTER if bounds and max(bounds) < 0.0 else Comparison.UNCLEAR_BETTER
        return Comparison.WORSE if bounds and min(bounds) > 0.0 else Comparison.UNCLEAR_WORSE


def falls_figure(table: str, fell: Iterable[bool], reference: str = "", quantity: str = FALLS) -> Figure:
    """Return the percentage of episodes in which the robot fell."""
    return Figure(table, quantity, "% of episodes", wilson_percentage(fell), reference=reference)


def judged_fairly(figures: Iterable[Figure], robot: str) -> list[Figure]:
    """Return figures without unfair verdicts: in tables with more falls than `MOST_FALLS` no figure is judged.

    Robots with other joints than the paper's are not compared with it: their figures lose the paper's, and published
    ones are left out.
    """
    figures, comparable = list(figures), load_robot(robot).joint_names == load_robot(ROBOT).joint_names
    # A table may have several parts, as of a command or an engine: "falls, p".
    falls = [figure for figure in figures if figure.quantity.partition(", ")[0] == FALLS]
    fallen = {figure.table for figure in falls if (figure.value or 0.0) > MOST_FALLS}
    return [
        dataclasses.replace(figure, paper=figure.paper if comparable else None, judged=figure.table not in fallen)
        for figure in figures
        if comparable or figure.estimate is not None
    ]

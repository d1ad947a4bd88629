"""One measured or published number of a report, and how it compares with the paper's and with another controller's."""

import dataclasses
import enum
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from hugwbc.evaluation.intervals import Estimate, wilson_percentage
from hugwbc.evaluation.tables import Cell, Marked, Table

FALLS = "falls"


class Verdict(enum.Enum):
    """How a figure compares with another one."""

    BETTER = "better"
    UNCLEAR_BETTER = "better, within the interval"
    UNCLEAR_WORSE = "worse, within the interval"
    WORSE = "worse"
    NONE = ""


@dataclasses.dataclass(frozen=True)
class Figure:
    """A number of a table.

    Attributes:
        table: title of its table.
        quantity: its row.
        unit: of value and paper.
        controller: its column; empty for what the paper prints and nothing was measured for.
        estimate: the number and its interval; None where it is published and not measured.
        paper: what the paper prints for HugWBC; None where it prints nothing.
        published: what somebody prints for this controller, which was not run here.
        higher_is_better: otherwise lower is.
        reference: of which of the paper's policies `paper` is, where it prints several.
    """

    table: str
    quantity: str
    unit: str
    controller: str
    estimate: Estimate | None
    paper: float | None = None
    published: float | None = None
    higher_is_better: bool = False
    reference: str = ""

    @property
    def value(self) -> float | None:
        """The number, measured or published."""
        return self.published if self.estimate is None else self.estimate.value

    @property
    def ratio(self) -> tuple[float, float | None, float | None] | None:
        """To the paper's figure, with the bounds of its interval; None where one of the two is missing."""
        if self.estimate is None or self.estimate.value is None or not self.paper:
            return None
        paper, low, high = self.paper, self.estimate.low, self.estimate.high
        return self.estimate.value / paper, None if low is None else low / paper, None if high is None else high / paper

    @property
    def verdict(self) -> Verdict:
        """Against the paper; its own uncertainty is not known."""
        if self.ratio is None:
            return Verdict.NONE
        value, low, high = self.ratio
        return _verdict(value - 1.0, None if low is None else low - 1.0, None if high is None else high - 1.0, self)


def falls_figure(table: str, controller: str, rows: Iterable[Mapping[str, Any]], reference: str = "") -> Figure:
    """In what part of some episodes the robot fell.

    Args:
        table: title of its table.
        controller: its column.
        rows: the episodes.
        reference: as of the table's other figures.
    """
    estimate = wilson_percentage([row["fell"] for row in rows])
    return Figure(table, FALLS, "% of episodes", controller, estimate, reference=reference)


def against(figure: Figure, other: Figure) -> Verdict:
    """How a measured figure compares with another controller's: told apart where their intervals do not overlap."""
    mine, theirs = figure.estimate, other.estimate
    if mine is None or theirs is None or mine.value is None or theirs.value is None:
        return Verdict.NONE
    low = None if mine.low is None or theirs.high is None else mine.low - theirs.high
    high = None if mine.high is None or theirs.low is None else mine.high - theirs.low
    return _verdict(mine.value - theirs.value, low, high, figure)


def _verdict(excess: float, low: float | None, high: float | None, figure: Figure) -> Verdict:
    """From by how much a figure is above another one, and the bounds of that."""
    if figure.higher_is_better:
        excess, low, high = -excess, None if high is None else -high, None if low is None else -low
    if excess <= 0.0:
        return Verdict.BETTER if high is not None and high < 0.0 else Verdict.UNCLEAR_BETTER
    return Verdict.WORSE if low is not None and low > 0.0 else Verdict.UNCLEAR_WORSE


def comparison_table(figures: Sequence[Figure], note: str = "") -> Table:
    """The figures of one table: quantities in rows, controllers in columns, the paper's figures before them.

    A measured cell has the value, its interval, and the ratio to the paper's; one that is worse than the paper's is
    marked so, and one that is worse by less than its uncertainty as that. Where the paper prints several policies, each
    stands before the controllers that are held against it.
    """
    units = {figure.quantity: figure.unit for figure in figures}
    columns: dict[str, list[Cell]] = {"": [f"{name} [{unit}]" if unit else name for name, unit in units.items()]}
    for reference in dict.fromkeys(figure.reference for figure in figures):
        columns |= _columns([figure for figure in figures if figure.reference == reference], list(units))
    return Table(figures[0].table, list(columns), list(map(list, zip(*columns.values(), strict=True))), note)


def _columns(figures: Sequence[Figure], quantities: Sequence[str]) -> dict[str, list[Cell]]:
    """The columns of one of the paper's policies, by heading: its own, if it has figures, and the controllers'."""
    columns: dict[str, list[Cell]] = {}
    papers = {figure.quantity: figure.paper for figure in figures if figure.paper is not None}
    if papers:
        heading = ", ".join(filter(None, ("HugWBC, paper", figures[0].reference)))
        columns[heading] = [papers.get(quantity) for quantity in quantities]
    for controller in filter(None, dict.fromkeys(figure.controller for figure in figures)):
        mine = {figure.quantity: figure for figure in figures if figure.controller == controller}
        published = any(figure.estimate is None for figure in mine.values())
        columns[f"{controller} (published)" if published else controller] = [_cell(mine.get(q)) for q in quantities]
    return columns


def _cell(figure: Figure | None) -> Cell:
    if figure is None or figure.value is None:
        return None
    if figure.estimate is None:
        return Marked(_number(figure.value), "published")
    parts = [_number(figure.value)]
    if figure.estimate.low is not None and figure.estimate.high is not None:
        parts.append(f"[{_number(figure.estimate.low, 2)}, {_number(figure.estimate.high, 2)}]")
    if figure.ratio is not None:
        parts.append(times(figure.ratio[0]))
    marks = {Verdict.WORSE: ("worse", "worse"), Verdict.UNCLEAR_WORSE: ("unclear", "worse?")}
    mark, word = marks.get(figure.verdict, ("", ""))
    return Marked(" ".join([*parts, word]).strip(), mark)


def times(ratio: float) -> str:
    """A ratio in words of a table, two digits without an exponent."""
    return "× < 0.01" if 0.0 <= ratio < 0.01 else f"× {_number(ratio, 2)}"


def _number(value: float, digits: int = 3) -> str:
    """Some significant digits, without an exponent where that is readable."""
    return f"{value:.0f}" if abs(value) >= 10 ** (digits - 1) else f"{value:.{digits}g}"

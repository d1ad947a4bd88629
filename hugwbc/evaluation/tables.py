"""Tables: cells with marks, their form for the terminal, and figures as tables beside the paper and as CSV."""

import csv
import dataclasses
import io
import math
from collections.abc import Iterable, Sequence
from typing import Literal

from hugwbc.evaluation.figures import Comparison, Figure
from hugwbc.evaluation.intervals import Estimate

INTERVAL_NOTE = (
    "95 % intervals: of means by bootstrap over episodes; of percentages of episodes Wilson's score interval"
)
_DIGITS = 3  # significant ones, of the largest number of a cell
Mark = Literal["", "worse", "unclear", "published"]


@dataclasses.dataclass(frozen=True)
class Marked:
    """A cell that a page marks by a word and by its style."""

    text: str  # text of the cell, without the word
    # worse: than the paper's; unclear: worse, but within the interval; published: not measured here
    mark: Mark = ""


Cell = str | float | int | bool | None | Marked


@dataclasses.dataclass(frozen=True)
class Table:
    """A table of a report."""

    title: str  # heading above it
    columns: Sequence[str]  # heading of each column; the first column holds the row's name
    # the cells: text, numbers (shown to three significant digits), or None and NaN (shown as a dash)
    rows: Sequence[Sequence[Cell]]
    note: str = ""  # a sentence below the table


def cell_text(value: Cell) -> str:
    """Return a cell as text: numbers to three significant digits, None and NaN as a dash."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if isinstance(value, Marked):
        return value.text
    if isinstance(value, bool):
        return "yes" if value else "no"
    return number(value) if isinstance(value, float) else str(value)


def number(value: float) -> str:
    """Round to `_DIGITS` significant digits, without an exponent where that is readable."""
    return f"{value:.0f}" if abs(value) >= 10 ** (_DIGITS - 1) else f"{value:.{_DIGITS}g}"


def format_table(header: Sequence[str], rows: Iterable[Sequence[Cell]]) -> str:
    """Align a table for the terminal: the first column to the left, the others to the right."""
    cells = [list(header), *(list(map(cell_text, row)) for row in rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(header))]
    lines = [
        "  ".join(
            cell.ljust(width) if i == 0 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in cells
    ]
    return "\n".join(line.rstrip() for line in [lines[0], "-" * len(lines[0]), *lines[1:]])


CSV_COLUMNS = (
    *("table", "quantity", "unit", "controller", "source", "value", "low", "high", "samples"),
    *("paper", "reference", "ratio", "ratio_low", "ratio_high", "against_paper"),
    *("against", "difference", "difference_low", "difference_high", "pairs", "p"),
)


def figure_tables(figures: Iterable[Figure]) -> list[Table]:
    """Return a table for each title: a row for each quantity, a column for the paper and each controller.

    A measured cell shows the value and its interval, and is marked if it is worse than the paper's. Where the paper
    prints several policies, each of them stands before the controllers that are compared with it. Below a quantity
    stands its difference from that of another controller.
    """
    titles: dict[str, list[Figure]] = {}
    for figure in figures:
        if figure.value is not None or figure.paper is not None:
            titles.setdefault(figure.table, []).append(figure)
    return [_figure_table(title, found) for title, found in titles.items()]


def _figure_table(title: str, figures: Sequence[Figure]) -> Table:
    columns: dict[str, dict[str, Cell]] = {}
    differences: dict[str, dict[str, str]] = {}
    for reference in dict.fromkeys(figure.reference for figure in figures):
        mine = (figure for figure in figures if figure.reference == reference)
        part = sorted(mine, key=lambda figure: figure.estimate is None)  # the measured ones first
        papers: dict[str, Cell] = {figure.quantity: figure.paper for figure in part if figure.paper is not None}
        if papers:
            columns[", ".join(filter(None, ("HugWBC, paper", reference)))] = papers
        for controller in filter(None, dict.fromkeys(figure.controller for figure in part)):
            of_it = [figure for figure in part if figure.controller == controller]
            heading = f"{controller} (published)" if of_it[0].estimate is None else controller
            columns[heading] = {figure.quantity: _value(figure) for figure in of_it}
            differences[heading] = {figure.quantity: _difference(figure) for figure in of_it}
    against = next((figure.difference.against for figure in figures if figure.difference), "")
    rows: list[list[Cell]] = []
    for quantity, label in {figure.quantity: figure.label for figure in figures}.items():
        rows.append([label, *(column.get(quantity) for column in columns.values())])
        gaps = [differences.get(heading, {}).get(quantity, "") for heading in columns]
        if any(gaps):
            rows.append([f"  minus {against}", *map(Marked, gaps)])
    return Table(title, ["", *columns], rows)


_MARKS: dict[Comparison, Mark] = {Comparison.WORSE: "worse", Comparison.UNCLEAR_WORSE: "unclear"}


def _value(figure: Figure) -> Marked | None:
    if figure.value is None:
        return None
    if figure.estimate is None:
        return Marked(number(figure.value), "published")
    return Marked(_with_bounds(figure.estimate, ""), _MARKS.get(figure.against_paper, ""))


def _difference(figure: Figure) -> str:
    found = figure.difference
    if found is None:
        return ""
    p = "" if found.p is None else f" (p = {found.p:.2g})"
    return f"{_with_bounds(found.estimate, '+')}{p}{' *' * found.is_clear}"


def _with_bounds(estimate: Estimate, sign: str) -> str:
    """Return a number and its interval, all with the decimals that give the largest of them `_DIGITS` digits."""
    numbers = [v for v in (estimate.value, estimate.low, estimate.high) if v is not None]
    largest = max((abs(number) for number in numbers if math.isfinite(number)), default=0.0)
    decimals = 0 if largest == 0.0 else max(0, _DIGITS - 1 - math.floor(math.log10(largest)))
    value, low, high = (
        "–" if v is None else f"{v:{sign}.{decimals}f}" for v in (estimate.value, estimate.low, estimate.high)
    )
    return value if estimate.low is None and estimate.high is None else f"{value} [{low}, {high}]"


def comparison_sentence(figures: Sequence[Figure], first: str, second: str) -> str:
    """Return how many figures are as good as the paper's, and how many of each controller are clearly the better ones.

    The two controllers, given by their labels, may be the same.
    """
    parts = []
    for name in dict.fromkeys((first, second)):
        verdicts = [f.against_paper for f in figures if f.controller == name and f.against_paper is not Comparison.NONE]
        good = sum(verdict in (Comparison.BETTER, Comparison.UNCLEAR_BETTER) for verdict in verdicts)
        if verdicts:
            parts.append(f"{name} is as good as the paper or better in {good} of {len(verdicts)} figures")
    theirs = [
        (found, figure.higher_is_better)
        for figure in figures
        if figure.controller == second and (found := figure.difference) and found.against == first
        if figure.higher_is_better is not None
    ]
    if theirs:
        clear = [(found.estimate.value or 0.0) * (-1 if higher else 1) for found, higher in theirs if found.is_clear]
        better, worse = (sum(sign * excess > 0.0 for excess in clear) for sign in (1, -1))
        parts.append(
            f"{first} is clearly better than {second} in {better} of {len(theirs)} figures of the same episodes, and "
            f"worse in {worse}"
        )
    return "; ".join(parts) + "." if parts else "There is nothing to compare with."


def figures_csv(figures: Sequence[Figure]) -> str:
    """Write the figures as CSV, one line for each, with the columns `CSV_COLUMNS`; missing numbers are left empty."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    for figure in figures:
        estimate = figure.estimate
        measured = (None, None, None) if estimate is None else (estimate.low, estimate.high, estimate.samples)
        source = "measured" if estimate else "published" if figure.controller else "paper alone"
        head = (figure.table, figure.quantity, figure.unit, figure.controller, source, figure.value, *measured)
        paper = figure.paper, figure.reference, *(figure.ratio or (None, None, None)), figure.against_paper.value
        found, paired = figure.difference, (None,) * 6
        if found is not None:
            gap = found.estimate
            paired = found.against, gap.value, gap.low, gap.high, gap.samples, found.p
        row = (*head, *paper, *paired)
        writer.writerow(["" if cell is None else f"{cell:.6g}" if isinstance(cell, float) else cell for cell in row])
    return file.getvalue()

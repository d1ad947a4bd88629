"""Figures as tables that compare controllers with the paper, and as CSV."""

import csv
import io
from collections.abc import Sequence

from hugwbc.evaluation.figures import Comparison, Figure
from hugwbc.evaluation.tables import Cell, Marked, Table

CSV_COLUMNS = (
    *("table", "quantity", "unit", "controller", "source", "value", "low", "high", "samples"),
    *("paper", "reference", "ratio", "ratio_low", "ratio_high", "against_paper"),
    *("against", "difference", "difference_low", "difference_high", "pairs", "p"),
)


def comparison_table(figures: Sequence[Figure]) -> Table:
    """Lay out the figures of one table: a row for each quantity, a column for the paper and each controller.

    A measured cell shows the value, its interval and the ratio to the paper's value. It is marked "worse" if it is
    worse than the paper's, and "worse?" if it is worse by less than its uncertainty. Where the paper prints several
    policies, each of them stands before the controllers that are compared with it.
    """
    units = {figure.quantity: figure.unit for figure in figures}
    columns: dict[str, list[Cell]] = {"": [f"{name} [{unit}]" if unit else name for name, unit in units.items()]}
    for reference in dict.fromkeys(figure.reference for figure in figures):
        columns |= _columns([figure for figure in figures if figure.reference == reference], list(units))
    return Table(figures[0].table, list(columns), list(map(list, zip(*columns.values(), strict=True))))


def _columns(figures: Sequence[Figure], quantities: Sequence[str]) -> dict[str, list[Cell]]:
    """Return the columns of one of the paper's policies by heading: its own, if any, and the controllers'."""
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
    if figure.against_paper is Comparison.WORSE:
        return Marked(" ".join([*parts, "worse"]), "worse")
    if figure.against_paper is Comparison.UNCLEAR_WORSE:
        return Marked(" ".join([*parts, "worse?"]), "unclear")
    return Marked(" ".join(parts))


def times(ratio: float) -> str:
    """Write a ratio for a table: two digits, no exponent."""
    return "× < 0.01" if 0.0 <= ratio < 0.01 else f"× {_number(ratio, 2)}"


def _number(value: float, digits: int = 3) -> str:
    """Round to significant digits, without an exponent where that is readable."""
    return f"{value:.0f}" if abs(value) >= 10 ** (digits - 1) else f"{value:.{digits}g}"


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

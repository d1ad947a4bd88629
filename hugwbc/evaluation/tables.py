"""Tables of figures with marks, and their forms for Markdown and the terminal."""

import dataclasses
import math
from collections.abc import Iterable, Sequence
from typing import Literal

from hugwbc.evaluation.figures import Figure


@dataclasses.dataclass(frozen=True)
class Marked:
    """A cell that is marked by a word and by its style."""

    text: str  # text of the cell, including the word
    # worse than the reference; worse, but within the uncertainty; published and not measured here
    mark: Literal["", "worse", "unclear", "published"] = ""


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
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def markdown_table(table: Table) -> str:
    """Return the table with its title and note as Markdown; cells marked as worse are bold."""

    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"

    def text(value: Cell) -> str:
        bold = isinstance(value, Marked) and value.mark == "worse"
        return f"**{cell_text(value)}**" if bold else cell_text(value)

    lines = [line(table.columns), line(["---", *["---:"] * (len(table.columns) - 1)])]
    lines += [line([text(value) for value in row]) for row in table.rows]
    return "\n".join([f"### {table.title}", "", *lines, *(["", table.note] if table.note else [])])


def format_table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Align a table for the terminal: the first column to the left, the others to the right."""
    cells = [list(header), *([_terminal_cell(value) for value in row] for row in rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(header))]
    lines = [
        "  ".join(
            cell.ljust(width) if i == 0 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in cells
    ]
    return "\n".join(line.rstrip() for line in [lines[0], "-" * len(lines[0]), *lines[1:]])


INTERVAL = "95 % interval"
INTERVAL_NOTE = (
    "95 % intervals: of means by bootstrap over episodes; of percentages of episodes Wilson's score interval"
)


def figures_text(figures: Sequence[Figure], controller: str) -> str:
    """Return the measured figures of a controller as tables for the terminal, with the paper's where it has any."""
    measured = [figure for figure in figures if figure.estimate is not None]
    texts = []
    for title in dict.fromkeys(figure.table for figure in measured):
        part = [figure for figure in measured if figure.table == title]
        paper = any(figure.paper is not None for figure in part)
        header = (title, controller, INTERVAL, *(("paper", "ratio") if paper else ()))
        rows = []
        for figure in part:
            estimate, ratio = figure.estimate, figure.ratio
            assert estimate is not None
            bounds = None if estimate.low is None or estimate.high is None else (estimate.low, estimate.high)
            interval = None if bounds is None else f"{_figure_text(bounds[0])} to {_figure_text(bounds[1])}"
            beside = (_figure_text(figure.paper), None if ratio is None else ratio[0]) if paper else ()
            rows.append((figure.label, _figure_text(estimate.value), interval, *beside))
        texts.append(format_table(header, rows))
    return "\n\n".join([*texts, INTERVAL_NOTE])


def _figure_text(value: float | None) -> str | None:
    """Format a number with three or four significant digits, without an exponent where that is readable."""
    if value is None:
        return None
    return f"{value:.1f}" if 100.0 <= abs(value) < 1e6 else f"{value:.4g}"


def _terminal_cell(value: object) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.3f}" if isinstance(value, float) else str(value)

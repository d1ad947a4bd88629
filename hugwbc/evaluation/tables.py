"""Tables of figures with marks, as pages, Markdown and terminals show them."""

import dataclasses
import math
from collections.abc import Sequence

from hugwbc.errors import ConfigError

MARKS = ("", "worse", "unclear", "published")


@dataclasses.dataclass(frozen=True)
class Marked:
    """A cell that is marked, in words and by its style.

    Attributes:
        text: of the cell, the mark's word included.
        mark: one of `MARKS`: worse than what it is held against; worse, but within the uncertainty; printed elsewhere
            and not measured here.
    """

    text: str
    mark: str = ""

    def __post_init__(self) -> None:
        if self.mark not in MARKS:
            raise ConfigError(f"a cell is marked '{self.mark}'; valid: {', '.join(MARKS[1:])} or nothing")


Cell = str | float | int | bool | None | Marked


@dataclasses.dataclass(frozen=True)
class Table:
    """A table of a report.

    Attributes:
        title: heading above it.
        columns: heading of each column; the first column holds the row's name.
        rows: the cells; text as it is, numbers to three significant digits, None and NaN as a dash.
        note: a sentence below it.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    note: str = ""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ConfigError(
                    f"table '{self.title}' has {len(self.columns)} columns, a row of it {len(row)} cells: {list(row)}; "
                    "give as many"
                )


def cell_text(value: Cell) -> str:
    """A cell as text: numbers to three significant digits, None and NaN as a dash."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if isinstance(value, Marked):
        return value.text
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def markdown_table(table: Table) -> str:
    """The table with its title and note as Markdown; cells that are worse are bold."""

    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"

    def text(value: Cell) -> str:
        bold = isinstance(value, Marked) and value.mark == "worse"
        return f"**{cell_text(value)}**" if bold else cell_text(value)

    lines = [line(table.columns), line(["---", *["---:"] * (len(table.columns) - 1)])]
    lines += [line([text(value) for value in row]) for row in table.rows]
    return "\n".join([f"### {table.title}", "", *lines, *(["", table.note] if table.note else [])])

"""One table of several controllers for a paper: intervals, paired differences, as LaTeX, CSV and a picture."""

import dataclasses
import itertools
import math
import pathlib
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from hugwbc.evaluation.experiment import Result
from hugwbc.evaluation.figures import MOST_FALLS, Figure
from hugwbc.evaluation.intervals import FEW, Estimate
from hugwbc.evaluation.tables import INTERVAL_NOTE, Cell, Table, cell_text, figures_csv
from hugwbc.files import write_whole
from hugwbc.viz.framing import LABEL_COLOURS
from hugwbc.viz.plots import INK, drawing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

PAIRED_NOTE = (
    f"{INTERVAL_NOTE}. Differences from {{}} are over the episodes that both have: of means with a paired bootstrap "
    "interval, of percentages with the p of McNemar's exact test. * marks p < 0.05, and intervals that leave out "
    f"0, of at least {FEW} episodes and where at most {MOST_FALLS:g} % fell. Figures that are no means over episodes "
    "have none."
)
PAPER_FILES = "table.tex", "figures.csv", "figure.svg"
# Lines of a page, and of a table's heading with its rules; letters of a line of labels, and of one of the caption.
_PAGE, _HEADING, _LABEL, _CAPTION = 45, 2, 22, 90
# Of the picture: lane of a name, room for headings and between quantities, lengths of axes, a letter [in].
_LANE, _HEAD, _BETWEEN, _VALUES, _GAPS, _GAP, _LETTER = 0.2, 0.45, 0.62, 3.4, 2.2, 0.3, 0.075
Bars = Sequence[Estimate | None]
"""A number of each controller, with its interval if it has one."""
_TEX = {
    **{"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "[": "{[}"},
    **{character: f"\\{character}" for character in "&%$#_{}"},
    **{"−": "$-$", "–": "--", "×": r"$\times$", "·": r"$\cdot$", "°": r"$^\circ$", "²": "$^2$", "³": "$^3$"},
    **{"⁶": "$^6$", "ω": r"$\omega$", "±": r"$\pm$", "<": "$<$", ">": "$>$", "|": "$|$"},
}


def tex_table(tables: Sequence[Table], notes: Sequence[str]) -> str:
    """Return the tables as LaTeX to be included in a document that uses array, booktabs and graphicx.

    A column belongs to one controller in all tables. What is wider than a line is made smaller, and what is longer than
    a page goes on in another table.
    """
    columns = list(dict.fromkeys(column for table in tables for column in table.columns[1:]))
    caption = " ".join(notes).rstrip(".")
    pages = _pages(tables, _PAGE - math.ceil(len(caption) / _CAPTION))
    captions = [caption, *["Continued"] * len(pages)]
    parts = [_tex_page(page, columns, each) for page, each in zip(pages, captions, strict=False)]
    return "\n".join([r"% \usepackage{array,booktabs,graphicx} in the preamble", *parts]) + "\n"


def _pages(tables: Sequence[Table], left: int) -> list[list[Table]]:
    """Return the tables of each page, the first of which has `left` lines; tables that are longer are cut.

    Indented rows stay with the row above them.
    """
    pages: list[list[Table]] = [[]]
    for table in tables:
        if pages[-1] and _HEADING + _lines(table.rows) > left:
            pages.append([])
            left = _PAGE
        rows: list[Sequence[Cell]] = []
        for number, row in enumerate(table.rows):
            below = itertools.takewhile(lambda one: str(one[0]).startswith(" "), table.rows[number + 1 :])
            if rows and not str(row[0]).startswith(" ") and _HEADING + _lines([*rows, row, *below]) > left:
                pages[-1].append(dataclasses.replace(table, rows=rows))
                pages.append([])
                left, rows = _PAGE, []
            rows.append(row)
        pages[-1].append(dataclasses.replace(table, rows=rows))
        left -= _HEADING + _lines(rows)
    return pages


def _lines(rows: Sequence[Sequence[Cell]]) -> int:
    return sum(max(math.ceil(len(str(row[0])) / _LABEL), 1) for row in rows)


def _tex_page(tables: Sequence[Table], columns: Sequence[str], caption: str) -> str:
    layout = rf"@{{}}>{{\raggedright\arraybackslash}}p{{12em}}{'r' * len(columns)}@{{}}"
    fitted = r"\resizebox{\ifdim\width>\linewidth\linewidth\else\width\fi}{!}"
    lines = [r"\begin{table}", r"  \centering", r"  \footnotesize", r"  \setlength{\tabcolsep}{3pt}"]
    lines += [f"  {fitted}{{\\begin{{tabular}}{{{layout}}}", r"    \toprule"]
    for number, table in enumerate(tables):
        heading = [table.title, *(column if column in table.columns else "" for column in columns)]
        lines += [r"    \midrule"] * (number > 0)
        lines += [f"    {_tex_row(heading)}", r"    \midrule"]
        for name, *cells in table.rows:
            mine = dict(zip(table.columns[1:], cells, strict=True))
            lines += [f"    {_tex_row([name, *(mine.get(column, '') for column in columns)])}"]
    lines += [r"    \bottomrule", r"  \end{tabular}}", f"  \\caption{{{tex_text(caption)}.}}", r"\end{table}"]
    return "\n".join(lines)


def _tex_row(cells: Sequence[Cell]) -> str:
    return " & ".join(re.sub("^ +", r"\\quad ", tex_text(cell_text(cell))) for cell in cells) + r" \\"


def tex_text(text: str) -> str:
    """Return plain text for LaTeX; a minus sign before a number becomes a real one."""
    return "".join(_TEX.get(character, character) for character in re.sub(r"(?<![\w.])-(?=[\d.])", "−", text))


def write_paper(
    folder: pathlib.Path, results: Sequence[Result], tables: Sequence[Table], notes: Sequence[str]
) -> list[pathlib.Path]:
    """Write the `PAPER_FILES` of results of one experiment, and return their paths.

    The tables are those of the results, and the notes sentences for the caption.
    """
    figures = [figure for result in results for figure in result.figures if figure.estimate is not None]
    paths = [folder / name for name in PAPER_FILES]
    for path, content in zip(paths, (tex_table(tables, notes), figures_csv(figures), _picture(results)), strict=True):
        write_whole(path, content)
    return paths


def _picture(results: Sequence[Result]) -> str:
    """Return a picture of the figures with intervals, and of their differences."""
    found: dict[tuple[str, str], dict[str, Figure]] = {}
    for result in results:
        for figure in result.figures:
            found.setdefault((figure.table, figure.label), {})[result.controller] = figure
    several = len({title for title, _ in found}) > 1
    names = [result.controller for result in results]
    rows: list[tuple[str, Bars, Bars]] = []
    for (title, label), mine in found.items():
        figures = [mine.get(name) for name in names]
        values = [figure and figure.estimate for figure in figures]
        if any(bar and bar.low is not None for bar in values):
            gaps = [figure.difference.estimate if figure and figure.difference else None for figure in figures]
            rows.append((f"{title}: {label}" if several else label, values, gaps))
    return _interval_bars(rows, names, f"paired difference from {names[0]}")


def _interval_bars(rows: Sequence[tuple[str, Bars, Bars]], names: Sequence[str], differences: str) -> str:
    """Return an SVG file of quantities with their intervals, one below the other, and differences beside them.

    Each quantity has axes of its own, in its own unit.

    Args:
        rows: for each quantity its title, the numbers of all names, and their differences from the first one's.
        names: names of what is compared.
        differences: heading of the differences.
    """
    band, margin = _LANE * len(names), 0.3 + _LETTER * max(map(len, names))  # [in]
    height = _HEAD + len(rows) * (band + _BETWEEN)
    width = margin + _VALUES + _GAP + _GAPS + 0.3

    def draw(figure: "Drawing") -> None:
        inches = figure.dpi_scale_trans
        figure.text(margin + _VALUES + _GAP, height - 0.2, differences, fontsize=9, transform=inches)
        for number, (title, values, gaps) in enumerate(rows):
            top = height - _HEAD - number * (band + _BETWEEN)
            figure.text(0.1, top - 0.02, title, fontsize=9, weight="bold", transform=inches)
            bottom = top - 0.1 - band
            for left, length, bars in ((margin, _VALUES, values), (margin + _VALUES + _GAP, _GAPS, gaps)):
                if all(bar is None or bar.value is None for bar in bars):
                    continue
                axes = figure.add_axes((left / width, bottom / height, length / width, band / height))
                _draw_bars(axes, bars)
                axes.set_yticks(range(len(names)), names if bars is values else [""] * len(names), fontsize=9)
                if bars is gaps:
                    axes.axvline(0.0, color="black", linewidth=0.8)

    return drawing("intervals", draw, (width, height)).replace(INK, "#000000")


def _draw_bars(axes: "Axes", bars: Bars) -> None:
    for lane, (bar, colour) in enumerate(zip(bars, LABEL_COLOURS, strict=False)):
        if bar is not None and bar.value is not None:
            axes.plot(bar.value, lane, "o", color=colour, markersize=5)
            if bar.low is not None and bar.high is not None:
                axes.plot([bar.low, bar.high], [lane, lane], color=colour, linewidth=2.0)
    axes.set_ylim(len(bars) - 0.5, -0.5)
    axes.margins(x=0.08)
    axes.locator_params(axis="x", nbins=4)
    axes.tick_params(axis="x", labelsize=8)

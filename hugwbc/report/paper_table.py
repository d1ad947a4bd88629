"""One table of several controllers for a paper: intervals, paired differences, as LaTeX, CSV and a picture."""

import math
import pathlib
import re
from collections.abc import Sequence

from hugwbc.evaluation.experiment import Result
from hugwbc.evaluation.figures import Figure
from hugwbc.evaluation.intervals import Estimate
from hugwbc.evaluation.tables import INTERVAL_NOTE, Cell, Table, cell_text, figures_csv
from hugwbc.files import write_whole
from hugwbc.viz.evaluation_plots import Bar, interval_bars

PAIRED_NOTE = (
    f"{INTERVAL_NOTE}. Differences from {{}} are over the episodes that both have: of means with a paired bootstrap "
    "interval, of percentages with the p of McNemar's exact test. * marks those that leave out 0, or p < 0.05. Figures "
    "that are no means over episodes have none."
)
_DIGITS = 3  # of the largest number of a cell
_TEX = {
    **{"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "[": "{[}"},
    **{character: f"\\{character}" for character in "&%$#_{}"},
    **{"−": "$-$", "–": "--", "×": r"$\times$", "·": r"$\cdot$", "°": r"$^\circ$", "²": "$^2$", "³": "$^3$"},
    **{"⁶": "$^6$", "ω": r"$\omega$", "±": r"$\pm$", "<": "$<$", ">": "$>$", "|": "$|$"},
}


def paired_tables(results: Sequence[Result]) -> list[Table]:
    """Return the figures of results of one experiment, a table for each of its titles, a column for each controller.

    Below a quantity stands its difference from that of the first controller.
    """
    controllers = [result.controller for result in results]
    tables = []
    for title, quantities in _by_title(results).items():
        papers = any(figure.paper is not None for found in quantities.values() for figure in found.values())
        rows: list[list[str]] = []
        for found in quantities.values():
            first = next(iter(found.values()))
            paper = next((f"{figure.paper:g}" for figure in found.values() if figure.paper is not None), "")
            beside = [paper] if papers else []
            rows.append([first.label, *(_value(found.get(name)) for name in controllers), *beside])
            differences = [_difference(found.get(name)) for name in controllers]
            if any(differences):
                rows.append([f"  minus {controllers[0]}", *differences, *[""] * papers])
        tables.append(Table(title, [title, *controllers, *["paper"] * papers], rows))
    return tables


def _by_title(results: Sequence[Result]) -> dict[str, dict[str, dict[str, Figure]]]:
    """Return the measured figures by title, quantity and controller, without quantities of which there is no number."""
    found: dict[str, dict[str, dict[str, Figure]]] = {}
    for result in results:
        for figure in result.figures:
            if figure.estimate is not None:
                found.setdefault(figure.table, {}).setdefault(figure.quantity, {})[result.controller] = figure
    return {
        title: {name: mine for name, mine in quantities.items() if any(f.value is not None for f in mine.values())}
        for title, quantities in found.items()
    }


def _value(figure: Figure | None) -> str:
    if figure is None or figure.estimate is None or figure.value is None:
        return "–"
    return _with_bounds(figure.estimate, "")


def _difference(figure: Figure | None) -> str:
    found = None if figure is None else figure.difference
    if found is None:
        return ""
    p = "" if found.p is None else f" (p = {found.p:.2g})"
    return f"{_with_bounds(found.estimate, '+')}{p}{' *' * found.is_clear}"


def _with_bounds(estimate: Estimate, sign: str) -> str:
    """Return a number and its interval, all with the decimals that give the largest of them `_DIGITS` digits."""
    numbers = [v for v in (estimate.value, estimate.low, estimate.high) if v is not None]
    largest = max(abs(number) for number in numbers)
    decimals = 0 if largest == 0.0 else max(0, _DIGITS - 1 - math.floor(math.log10(largest)))
    value, *bounds = (f"{number:{sign}.{decimals}f}" for number in numbers)
    return f"{value} [{bounds[0]}, {bounds[1]}]" if bounds else value


def tex_table(tables: Sequence[Table], notes: Sequence[str]) -> str:
    """Return the tables as one LaTeX table to be included in a document that uses booktabs."""
    width = max(len(table.columns) for table in tables)
    lines = [r"% \usepackage{booktabs} in the preamble", r"\begin{table}", r"  \centering", r"  \footnotesize"]
    lines += [f"  \\begin{{tabular}}{{@{{}}l{'r' * (width - 1)}@{{}}}}", r"    \toprule"]
    for number, table in enumerate(tables):
        lines += [r"    \midrule"] * (number > 0)
        lines += [f"    {_tex_row(table.columns, width)}", r"    \midrule"]
        lines += [f"    {_tex_row(row, width)}" for row in table.rows]
    lines += [
        r"    \bottomrule",
        r"  \end{tabular}",
        f"  \\caption{{{' '.join(map(tex_text, notes))}}}",
        r"\end{table}",
    ]
    return "\n".join(lines) + "\n"


def _tex_row(cells: Sequence[Cell], width: int) -> str:
    words = [re.sub("^ +", r"\\quad ", tex_text(cell_text(cell))) for cell in cells]
    return " & ".join([*words, *[""] * (width - len(cells))]) + r" \\"


def tex_text(text: str) -> str:
    """Return plain text for LaTeX; a minus sign before a number becomes a real one."""
    return "".join(_TEX.get(character, character) for character in re.sub(r"(?<![\w.])-(?=[\d.])", "−", text))


def write_paper(
    folder: pathlib.Path, results: Sequence[Result], tables: Sequence[Table], notes: Sequence[str]
) -> list[pathlib.Path]:
    """Write table.tex, figures.csv and figure.svg of results of one experiment, and return their paths.

    Args:
        folder: where to.
        results: the results.
        tables: those of `paired_tables`.
        notes: sentences for the caption.
    """
    figures = [figure for result in results for figure in result.figures if figure.estimate is not None]
    contents = {
        "table.tex": tex_table(tables, notes),
        "figures.csv": figures_csv(figures),
        "figure.svg": _picture(results),
    }
    for name, content in contents.items():
        write_whole(folder / name, content)
    return [folder / name for name in contents]


def _picture(results: Sequence[Result]) -> str:
    """Return a picture of the figures with intervals, and of their differences."""
    rows: list[tuple[str, list[Bar | None], list[Bar | None]]] = []
    titles = _by_title(results)
    for title, quantities in titles.items():
        for found in quantities.values():
            figures = [found.get(result.controller) for result in results]
            values = [_bar(figure and figure.estimate) for figure in figures]
            if all(bar is None or bar.low is None for bar in values):
                continue
            gaps = [_bar(f.difference.estimate) if f and f.difference else None for f in figures]
            label = next(iter(found.values())).label
            rows.append((f"{title}: {label}" if len(titles) > 1 else label, values, gaps))
    names = [result.controller for result in results]
    return interval_bars(rows, names, f"paired difference from {names[0]}")


def _bar(estimate: Estimate | None) -> Bar | None:
    if estimate is None or estimate.value is None:
        return None
    return Bar(estimate.value, estimate.low, estimate.high)

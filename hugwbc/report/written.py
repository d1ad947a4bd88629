"""Figures of a report as CSV, in long format: one line a number."""

import csv
import io
from collections.abc import Sequence

from hugwbc.report.figures import Figure

COLUMNS = (
    *("table", "quantity", "unit", "controller", "source", "value", "low", "high", "samples"),
    *("paper", "reference", "ratio", "ratio_low", "ratio_high", "against_paper"),
)


def figures_csv(figures: Sequence[Figure]) -> str:
    """The figures as CSV text with the columns `COLUMNS`; empty where there is no number."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(COLUMNS)
    for figure in figures:
        estimate = figure.estimate
        measured = (None, None, None) if estimate is None else (estimate.low, estimate.high, estimate.samples)
        source = "measured" if estimate else "published" if figure.controller else "paper alone"
        head = (figure.table, figure.quantity, figure.unit, figure.controller, source, figure.value, *measured)
        row = (*head, figure.paper, figure.reference, *(figure.ratio or (None, None, None)), figure.verdict.value)
        writer.writerow(["" if cell is None else f"{cell:.6g}" if isinstance(cell, float) else cell for cell in row])
    return file.getvalue()

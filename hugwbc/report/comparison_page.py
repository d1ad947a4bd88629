"""The report of a comparison: a self-contained page with tables and plots of one or more runs."""

import json
import pathlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from hugwbc.evaluation.tables import Cell, Table
from hugwbc.files import finite_json, write_whole
from hugwbc.report import page
from hugwbc.runtime.trace import Trace
from hugwbc.seeds import seed_class
from hugwbc.viz.framing import LABEL_COLOURS
from hugwbc.viz.plots import Panel, hand_panels, torque_panels, tracking_panels
from hugwbc.viz.replay import write_replay


def summary_table(title: str, summaries: Mapping[str, Mapping]) -> Table:
    """Return a table with a column for each run and a row for each number of its summary, named by its path.

    Args:
        title: title of the table.
        summaries: the summary of each run: numbers, or mappings of numbers to any depth.
    """
    flat = {name: dict(_flatten(summary)) for name, summary in summaries.items()}
    paths = list(dict.fromkeys(path for values in flat.values() for path in values))
    rows = [(path, *(flat[name].get(path) for name in flat)) for path in paths]
    return Table(title, ("", *flat), rows)


def _flatten(summary: Mapping, prefix: str = "") -> Iterator[tuple[str, Cell]]:
    for key, value in summary.items():
        if isinstance(value, Mapping):
            yield from _flatten(value, f"{prefix}{key} ")
        else:
            yield f"{prefix}{key}", value


def report_html(
    title: str,
    traces: Sequence[Trace],
    tables: Sequence[Table] = (),
    *,
    subtitle: str = "",
    links: Mapping[str, str] | None = None,
) -> str:
    """Return the page, which loads nothing.

    Args:
        title: title of the page.
        traces: one to four runs, plotted in the colours of `LABEL_COLOURS`.
        tables: tables above the plots.
        subtitle: a sentence below the title.
        links: texts and addresses of other pages, such as the replay of the same runs.

    Raises:
        ConfigError: if there is nothing to draw, or too much.
    """
    sections = [
        ("Commanded and measured", tracking_panels(traces)),
        ("Hands", hand_panels(traces)),
        ("Torques", torque_panels(traces)),
    ]
    body = [
        page.heading(title, 1),
        page.paragraph(subtitle) if subtitle else "",
        f"<p>{page.links(links)}</p>" if links else "",
        *(page.table_html(table) for table in tables),
        *(_section(name, panels, traces) for name, panels in sections if panels),
    ]
    return page.page_html(title, body)


def write_report(
    path: pathlib.Path,
    title: str,
    traces: Sequence[Trace],
    tables: Sequence[Table] = (),
    *,
    subtitle: str = "",
    links: Mapping[str, str] | None = None,
) -> None:
    """Write the page of `report_html` to a file."""
    write_whole(path, report_html(title, traces, tables, subtitle=subtitle, links=links))


def write_comparison(
    folder: pathlib.Path, summary: Mapping[str, Any], figures: Table, traces: Sequence[Trace]
) -> list[pathlib.Path]:
    """Write summary.json, report.html and replay.html of a comparison and return their paths.

    Args:
        folder: folder of the files.
        summary: `evaluation.comparison.comparison_summary` or `task_summary`.
        figures: `evaluation.comparison.figure_table` or `task_table`.
        traces: 1 to 4 runs.

    Raises:
        ConfigError: if there is nothing to draw, or too much.
    """
    title = f"hugwbc compare: {summary.get('task') or summary['script']}"
    write_whole(folder / "summary.json", json.dumps(finite_json(dict(summary)), indent=2) + "\n")
    safety = {name: outcome["safety"] for name, outcome in summary["controllers"].items()}
    counters = {name: {k: v for k, v in report.items() if k != "messages"} for name, report in safety.items()}
    write_replay(folder / "replay.html", traces, title=title)
    write_report(
        folder / "report.html",
        title,
        traces,
        [figures, summary_table("Safety filter", counters)],
        subtitle=f"Sensors with noise, seed {summary['seed']} ({seed_class(summary['seed'])})."
        if summary["arena"]["sensing"] != "exact"
        else "Exact sensors, nothing random.",
        links={"Replay in three dimensions": "replay.html", "Figures as JSON": "summary.json"},
    )
    return [folder / "summary.json", folder / "report.html", folder / "replay.html"]


def _section(title: str, panels: Sequence[Panel], traces: Sequence[Trace]) -> str:
    names = [f"{trace.name} (fell)" if trace.fell else trace.name for trace in traces]
    dashed = "commanded" if title.startswith("Commanded") else ""
    key = page.legend(names, LABEL_COLOURS, dashed)
    return f"{page.heading(title)}\n{key}\n{page.pictures(panels)}"

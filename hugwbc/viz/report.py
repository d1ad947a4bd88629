"""A self-contained page with tables and plots of one or more runs."""

import dataclasses
import html
import math
import pathlib
from collections.abc import Iterator, Mapping, Sequence

from hugwbc.errors import ConfigError
from hugwbc.viz.plots import Panel, hand_panels, torque_panels, tracking_panels
from hugwbc.viz.trace import LABEL_COLOURS, Trace

Cell = str | float | int | bool | None


@dataclasses.dataclass(frozen=True)
class Table:
    """A table of the report.

    Attributes:
        title: heading above it.
        columns: heading of each column; the first column holds the row's name.
        rows: the cells; text as it is, numbers to three significant digits, None and NaN as a dash.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ConfigError(
                    f"table '{self.title}' has {len(self.columns)} columns, a row of it {len(row)} cells: {list(row)}; "
                    "give as many"
                )


def summary_table(title: str, summaries: Mapping[str, Mapping]) -> Table:
    """One column for each run, one row for each number of its nested summary, named by its path.

    Args:
        title: of the table.
        summaries: for each run its summary: numbers, or mappings of them to any depth.
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
    """The page; needs no network.

    Args:
        title: of the page.
        traces: 1 to 4 runs, plotted in the colours of `LABEL_COLOURS`.
        tables: above the plots.
        subtitle: a sentence below the title.
        links: text and address of other pages, such as the replay beside this one.

    Raises:
        ConfigError: if there is nothing to draw, or too much.
    """
    sections = [
        ("Commanded and measured", tracking_panels(traces)),
        ("Hands", hand_panels(traces)),
        ("Torques", torque_panels(traces)),
    ]
    anchors = " · ".join(
        f'<a href="{html.escape(address)}">{html.escape(text)}</a>' for text, address in (links or {}).items()
    )
    body = [
        f"<h1>{html.escape(title)}</h1>",
        f"<p>{html.escape(subtitle)}</p>" if subtitle else "",
        f"<p>{anchors}</p>" if anchors else "",
        *(_table_html(table) for table in tables),
        *(_section_html(heading, panels, traces) for heading, panels in sections if panels),
    ]
    return _TEMPLATE.replace("@TITLE@", html.escape(title)).replace("@BODY@", "\n".join(body))


def write_report(
    path: pathlib.Path,
    title: str,
    traces: Sequence[Trace],
    tables: Sequence[Table] = (),
    *,
    subtitle: str = "",
    links: Mapping[str, str] | None = None,
) -> None:
    """Write `report_html` to a file."""
    path.write_text(report_html(title, traces, tables, subtitle=subtitle, links=links), encoding="utf-8")


def _cell(value: Cell) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.3g}"
    return html.escape(str(value))


def _table_html(table: Table) -> str:
    head = "".join(f'<th scope="col">{html.escape(column)}</th>' for column in table.columns)
    rows = "\n".join(
        f'<tr><th scope="row">{_cell(row[0])}</th>{"".join(f"<td>{_cell(value)}</td>" for value in row[1:])}</tr>'
        for row in table.rows
    )
    return (
        f'<h2>{html.escape(table.title)}</h2>\n<div class="wide"><table>\n<thead><tr>{head}</tr></thead>\n'
        f"<tbody>\n{rows}\n</tbody>\n</table></div>"
    )


def _section_html(heading: str, panels: Sequence[Panel], traces: Sequence[Trace]) -> str:
    legend = "".join(
        f'<span><i style="background:{colour}"></i>{html.escape(trace.name)}{" (fell)" if trace.fell else ""}</span>'
        for trace, colour in zip(traces, LABEL_COLOURS, strict=False)
    )
    figures = "\n".join(
        f"<figure><figcaption>{html.escape(panel.title)}</figcaption>{panel.svg}</figure>" for panel in panels
    )
    dashed = "<span><i class='dashed'></i>commanded</span>" if heading.startswith("Commanded") else ""
    key = f'<p class="legend">{legend}{dashed}</p>'
    return f'<h2>{html.escape(heading)}</h2>\n{key}\n<div class="grid">\n{figures}\n</div>'


_TEMPLATE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>@TITLE@</title>
<style>
  :root { color-scheme: light dark;
    --ground: #ffffff; --ink: #1c2430; --line: #d5dae2; --card: #f6f8fa; --link: #1a5fb4; }
  @media (prefers-color-scheme: dark) {
    :root { --ground: #14181f; --ink: #dfe5ee; --line: #343c49; --card: #1b212b; --link: #7db3f5; }
  }
  body { margin: 0 auto; padding: 16px; max-width: 1200px; background: var(--ground); color: var(--ink);
    font: 15px/1.5 system-ui, sans-serif; }
  h1 { font-size: 1.6em; margin: 0.4em 0; }
  h2 { font-size: 1.2em; margin: 1.6em 0 0.5em; }
  a { color: var(--link); }
  .wide { overflow-x: auto; }
  table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
  th, td { padding: 4px 14px; border-bottom: 1px solid var(--line); text-align: right; white-space: nowrap; }
  th[scope="row"], th:first-child { text-align: left; font-weight: normal; }
  thead th { font-weight: 600; }
  .legend { display: flex; flex-wrap: wrap; gap: 4px 20px; margin: 0 0 8px; }
  .legend i { display: inline-block; width: 22px; height: 0; border-top: 3px solid transparent; margin-right: 8px;
    vertical-align: middle; }
  .legend i:not(.dashed) { height: 3px; border: 0; }
  .legend i.dashed { border-top: 2px dashed currentColor; }
  .grid { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 420px), 1fr)); gap: 12px; }
  figure { margin: 0; padding: 10px; border: 1px solid var(--line); border-radius: 8px; background: var(--card); }
  figcaption { font-size: 0.92em; margin-bottom: 4px; }
  svg { display: block; width: 100%; height: auto; }
</style>
</head>
<body>
@BODY@
</body>
</html>
"""

"""Self-contained pages of text, tables and pictures, which load nothing and follow the reader's light or dark theme."""

import html
import re
from collections.abc import Mapping, Sequence

from hugwbc.evaluation.tables import Cell, Marked, Table, cell_text
from hugwbc.viz.plots import Panel

WORDS = {"worse": " worse", "unclear": " worse?"}  # behind a cell of this mark
_LONG_TEXT = 24  # characters; a column with a longer text wraps its lines


def page_html(title: str, body: Sequence[str]) -> str:
    """Return a page, given its title as plain text and its parts as HTML."""
    return _TEMPLATE.replace("@TITLE@", html.escape(title)).replace("@BODY@", "\n".join(part for part in body if part))


def heading(text: str, level: int = 2) -> str:
    """Return a heading with an anchor to link to."""
    return f'<h{level} id="{anchor(text)}">{html.escape(text)}</h{level}>'


def folded(title: str, content: str) -> str:
    """Return a section that opens at a click, or by a link to its anchor (`anchor(title)`).

    The anchor is inside, because browsers open what hides the target of a link.
    """
    return (
        f"<details><summary><h2>{html.escape(title)}</h2></summary>\n"
        f'<span id="{anchor(title)}"></span>\n{content}\n</details>'
    )


def anchor(text: str) -> str:
    """Return the name of a heading's anchor."""
    return html.escape("-".join("".join(c if c.isalnum() else " " for c in text.lower()).split()))


def paragraph(text: str) -> str:
    """Return a paragraph of plain text, with `code` between backticks."""
    return f"<p>{_inline(text)}</p>"


def bullets(lines: Sequence[str]) -> str:
    """Return a list of sentences, with `code` between backticks."""
    return "<ul>\n" + "\n".join(f"<li>{_inline(line)}</li>" for line in lines) + "\n</ul>"


def _inline(text: str) -> str:
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", html.escape(text))


def links(addresses: Mapping[str, str]) -> str:
    """Return links in one line, from their texts and addresses."""
    return " · ".join(f'<a href="{html.escape(to)}">{html.escape(text)}</a>' for text, to in addresses.items())


def legend(names: Sequence[str], colours: Sequence[str], dashed: str = "") -> str:
    """Return a legend: the name of each colour, and of the dashed line if it has one."""
    pairs = zip(names, colours, strict=False)
    parts = [f'<span><i style="background:{colour}"></i>{html.escape(name)}</span>' for name, colour in pairs]
    if dashed:
        parts.append(f"<span><i class='dashed'></i>{html.escape(dashed)}</span>")
    return f'<p class="legend">{"".join(parts)}</p>'


def pictures(panels: Sequence[Panel]) -> str:
    """Return pictures side by side, as many as the width allows."""
    figures = "\n".join(
        f"<figure><figcaption>{html.escape(panel.title)}</figcaption>{panel.svg}</figure>" for panel in panels
    )
    return f'<div class="grid">\n{figures}\n</div>'


def table_html(table: Table, level: int = 2) -> str:
    """Return a table with its title and note; a table wider than the page scrolls on its own."""
    columns = [[row[index] for row in table.rows] for index in range(len(table.columns))]
    wordy = [any(isinstance(cell, str) and len(cell) > _LONG_TEXT for cell in column) for column in columns]
    head = "".join(map(_column_head, table.columns, wordy))
    rows = "\n".join(
        f'<tr><th scope="row">{html.escape(cell_text(row[0]))}</th>{"".join(map(_cell, row[1:], wordy[1:]))}</tr>'
        for row in table.rows
    )
    note = f'\n<p class="note">{html.escape(table.note)}</p>' if table.note else ""
    return (
        f'{heading(table.title, level)}\n<div class="wide"><table>\n<thead><tr>{head}</tr></thead>\n'
        f"<tbody>\n{rows}\n</tbody>\n</table></div>{note}"
    )


def _column_head(title: str, wordy: bool) -> str:
    name = ' class="text"' if wordy else ""
    return f'<th scope="col"{name}>{html.escape(title)}</th>'


def _cell(value: Cell, wordy: bool) -> str:
    name = value.mark if isinstance(value, Marked) else "text" if wordy else ""
    mark = f' class="{name}"' if name else ""
    return f"<td{mark}>{html.escape(cell_text(value))}{WORDS.get(name, '')}</td>"


_TEMPLATE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>@TITLE@</title>
<style>
  :root { color-scheme: light dark;
    --ground: #ffffff; --ink: #1c2430; --line: #d5dae2; --card: #f6f8fa; --link: #1a5fb4;
    --worse: #fbdcd6; --unclear: #fdf3d8; }
  @media (prefers-color-scheme: dark) {
    :root { --ground: #14181f; --ink: #dfe5ee; --line: #343c49; --card: #1b212b; --link: #7db3f5;
    --worse: #5c2a24; --unclear: #463a18; }
  }
  body { margin: 0 auto; padding: 16px; max-width: 1200px; background: var(--ground); color: var(--ink);
    font: 15px/1.5 system-ui, sans-serif; }
  h1 { font-size: 1.6em; margin: 0.4em 0; }
  h2 { font-size: 1.3em; margin: 1.8em 0 0.5em; }
  h3 { font-size: 1.05em; margin: 1.4em 0 0.4em; }
  a { color: var(--link); }
  .wide { overflow-x: auto; }
  table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 0.95em; }
  th, td { padding: 4px 10px; border-bottom: 1px solid var(--line); text-align: right; white-space: nowrap; }
  td.text { white-space: normal; min-width: 14em; }
  td.text, th.text { text-align: left; }
  th[scope="row"], th:first-child { text-align: left; font-weight: normal; background: var(--ground);
    position: sticky; left: 0; }
  th[scope="row"] { white-space: pre; }
  thead th { font-weight: 600; white-space: normal; vertical-align: bottom; }
  thead th:not(.text) { max-width: 9em; }
  td.worse { background: var(--worse); font-weight: 600; }
  td.unclear { background: var(--unclear); }
  td.published { font-style: italic; opacity: 0.85; }
  details { border-top: 1px solid var(--line); }
  summary { cursor: pointer; }
  summary h2 { display: inline-block; margin: 0.6em 0; }
  .lead { font-size: 1.15em; max-width: 80ch; }
  .note { font-size: 0.9em; opacity: 0.85; max-width: 80ch; }
  .legend { display: flex; flex-wrap: wrap; gap: 4px 20px; margin: 12px 0 8px; }
  .legend i { display: inline-block; width: 22px; height: 0; border-top: 3px solid transparent; margin-right: 8px;
    vertical-align: middle; }
  .legend i:not(.dashed) { height: 3px; border: 0; }
  .legend i.dashed { border-top: 2px dashed currentColor; }
  .grid { display: grid; margin-top: 12px;
    grid-template-columns: repeat(auto-fill, minmax(min(100%, 420px), 1fr)); gap: 12px; }
  figure { margin: 0; padding: 10px; border: 1px solid var(--line); border-radius: 8px; background: var(--card); }
  figcaption { font-size: 0.92em; margin-bottom: 4px; }
  @media (max-width: 640px) {
    th, td { padding: 3px 6px; }
    th { white-space: normal; }
    td.text { min-width: 0; }
    th[scope="row"] { min-width: 7em; white-space: pre-wrap; }
  }
  svg { display: block; width: 100%; height: auto; }
</style>
</head>
<body>
@BODY@
</body>
</html>
"""

"""Replays inside a notebook, or in a browser."""

import html
import pathlib
import sys
import tempfile
import webbrowser
from typing import Any

from hugwbc.runtime.trace import Trace
from hugwbc.viz.replay import replay_html, write_replay

NOTEBOOK_HEIGHT = 520  # [pixel]


class InlineReplay:
    """A replay page that a notebook displays inside its own page."""

    def __init__(self, page: str) -> None:
        """Keep the page, as HTML."""
        self.page = page

    def _repr_html_(self) -> str:
        style = f"width:100%;height:{NOTEBOOK_HEIGHT}px;border:0"
        return f'<iframe srcdoc="{html.escape(self.page)}" style="{style}" allowfullscreen></iframe>'


def in_notebook() -> bool:
    """Return whether this is a notebook's kernel."""
    shell = sys.modules.get("IPython")
    running = None if shell is None else shell.get_ipython()
    return hasattr(running, "kernel")


def show(*traces: Trace) -> Any:  # noqa: ANN401  what a notebook displays
    """Replay one to four runs side by side, inline in a notebook, elsewhere in the browser.

    Return what a notebook displays, or the path of the page.
    """
    title = f"hugwbc replay: {', '.join(trace.name for trace in traces)}"
    if in_notebook():
        return InlineReplay(replay_html(traces, title=title))
    path = pathlib.Path(tempfile.mkdtemp(prefix="hugwbc-")) / "replay.html"
    write_replay(path, traces, title=title)
    webbrowser.open(path.as_uri())
    return path

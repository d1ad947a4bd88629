"""Where a run is shown: inside a notebook or in the browser."""

import sys
import types

from hugwbc.viz import inline
from hugwbc.viz.inline import show


def test_a_run_is_shown_in_the_browser(make_run, monkeypatch):
    opened = []
    monkeypatch.setattr(inline.webbrowser, "open", opened.append)
    path = show(make_run(name="qp"), make_run(name="learned"))
    assert opened == [path.as_uri()]
    page = path.read_text(encoding="utf-8")
    assert "<title>hugwbc replay: qp, learned</title>" in page and "set_animation" in page


def test_a_notebook_shows_it_inline(make_run, monkeypatch):
    shell = types.SimpleNamespace(get_ipython=lambda: types.SimpleNamespace(kernel=object()))
    monkeypatch.setitem(sys.modules, "IPython", shell)
    shown = show(make_run())._repr_html_()
    assert shown.startswith('<iframe srcdoc="&lt;!DOCTYPE html&gt;')
    shell.get_ipython = lambda: None
    assert not inline.in_notebook(), "an interactive shell is no notebook"

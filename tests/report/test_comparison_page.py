"""The report page and its plots; what both pages load, and how they escape."""

import dataclasses
import html.parser
import pathlib
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable

import numpy as np
import pytest

from hugwbc.errors import ConfigError
from hugwbc.evaluation.comparison import comparison_summary, figure_table, summarise
from hugwbc.report import comparison_page
from hugwbc.runtime.safety_report import SafetyReport
from hugwbc.scripts.script import Script, Segment
from hugwbc.viz import plots
from hugwbc.viz.framing import LABEL_COLOURS, Chapter
from hugwbc.viz.plots import hand_panels, path_panel, torque_panels, tracking_panels
from hugwbc.viz.replay import replay_html

NASTY = 'a<b>&"$x_1'


class _References(html.parser.HTMLParser):
    """Addresses that a page loads, and its tags."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.tags: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.loaded += [v or "" for k, v in attrs if k == "src" or (k == "href" and tag == "link")]


def test_every_counter_of_the_safety_report_is_named_for_people() -> None:
    counters = {field.name for field in dataclasses.fields(SafetyReport)} - {"ticks", "messages"}
    assert set(comparison_page.EVENTS) == counters


def test_pages_load_nothing_and_escape_names(make_run: Callable, tmp_path: pathlib.Path) -> None:
    runs = [make_run(name=NASTY, fell=True), make_run(name="learned", seed=2)]
    (tmp_path / "replay.html").write_text(replay_html(runs, title="<script>alert(1)</script>"))
    text = comparison_page.report_html("<script>alert(1)</script>", runs, subtitle="<img src=x>")
    (tmp_path / "report.html").write_text(text, encoding="utf-8")
    for name, scripts in (("replay.html", 2), ("report.html", 0)):
        text = (tmp_path / name).read_text(encoding="utf-8")
        references = _References(text)
        assert references.loaded == []
        assert references.tags.count("script") == scripts
        assert "img" not in references.tags
        assert "a&lt;b&gt;&amp;&quot;$x_1 (fell)" in text
        assert "learned" in text
    assert (tmp_path / "replay.html").stat().st_size < 3e6
    assert (tmp_path / "report.html").stat().st_size < 1e6


@pytest.mark.parametrize("count", [0, 5])
def test_too_few_or_too_many_runs_are_refused(make_run: Callable, count: int) -> None:
    runs = [make_run()] * count
    for draw in (replay_html, lambda r: comparison_page.report_html("t", r)):
        with pytest.raises(ConfigError, match="runs to draw; give 1 to 4"):
            draw(runs)


def test_runs_of_several_robots_are_refused(make_run: Callable) -> None:
    runs = [make_run(), dataclasses.replace(make_run(), robot="g1")]
    for draw in (replay_html, lambda r: comparison_page.report_html("t", r)):
        with pytest.raises(ConfigError, match="the runs are of h1 and g1; give runs of one robot"):
            draw(runs)


def test_one_sample_is_enough(make_run: Callable) -> None:
    run = make_run(seconds=0.02)
    assert len(run.time) == 1
    assert "<svg" in comparison_page.report_html("short", [run])
    assert "Play" in replay_html([run])


def test_panels_are_pictures_in_the_pages_colour(make_run: Callable) -> None:
    runs = [make_run(), make_run(name="learned", seed=2)]
    panels = [*tracking_panels(runs), *hand_panels(runs), *torque_panels(runs)]
    assert len(panels) == 7 + 2 + 2
    for panel in panels:
        root = ET.fromstring(panel.svg)
        assert root.get("viewBox") and root.get("width") is None
        assert "currentColor" in panel.svg and "#010203" not in panel.svg
        assert all(colour in panel.svg for colour in LABEL_COLOURS[:2])
    assert hand_panels([make_run(hands=False)]) == []
    right = dataclasses.replace(runs[0], hand_error=np.where([True, False], np.nan, runs[0].hand_error))
    assert [panel.title.split()[0] for panel in hand_panels([right])] == ["Right"], "no empty picture"


def _curves(svg: str, colour: str) -> list[np.ndarray]:
    """Points of the curves of a colour, in the picture's units."""
    paths = [p.get("d") or "" for p in ET.fromstring(svg).iter("{http://www.w3.org/2000/svg}path")
             if colour in (p.get("style") or "")]  # fmt: skip
    return [np.array(re.findall(r"[ML] ([-\d.]+) ([-\d.]+)", d), dtype=float) for d in paths]


def test_measured_curve_is_higher_where_the_quantity_is(make_run: Callable) -> None:
    """A waist that steps up in mid-run steps up in its panel (the picture's y points down) and stays in the others."""
    run = make_run()
    run.measured[:, 5] = np.where(run.time < 0.5, 0.0, 0.5)
    panels = {panel.title: panel.svg for panel in tracking_panels([run])}
    (curve,) = _curves(panels["Waist yaw w"], LABEL_COLOURS[0])
    middle = curve[:, 0].mean()
    assert curve[curve[:, 0] < middle - 20, 1].min() > curve[curve[:, 0] > middle + 20, 1].max() + 50
    (other,) = _curves(panels["Body pitch p"], LABEL_COLOURS[0])
    assert np.ptp(other[:, 1]) < 50


def test_names_beside_the_ends_of_ways_are_in_the_order_of_the_robots(make_run: Callable) -> None:
    runs = [make_run(), make_run(name="learned", seed=2)]
    heights = []
    for left in (0.1, 0.0, -0.1):
        runs[0].qpos[:, 1] = left
        found = re.findall(r' y="([\d.]+)"[^>]*>(qp|learned)<', path_panel(runs).svg)
        heights.append({name: float(height) for height, name in found})
    assert heights[0]["qp"] < heights[0]["learned"] - 10, "the picture's y points down"
    assert abs(heights[1]["qp"] - heights[1]["learned"]) > 10, "and names stand apart where robots do not"
    assert heights[2]["qp"] > heights[2]["learned"] + 10


def test_a_command_is_one_line_for_all_runs_or_one_in_the_colour_of_each(make_run: Callable) -> None:
    runs = [make_run(), make_run(name="learned", seed=2, seconds=0.5)]
    runs[1].command[10:, 6] = 0.3  # pitch
    panels = {panel.title: panel.svg for panel in tracking_panels(runs)}
    dashed = {title: re.findall(r"stroke-dasharray[^\"]*stroke: ([#\w]+)", svg) for title, svg in panels.items()}
    assert dashed["Forward velocity v_x"] == ["currentColor"]
    assert dashed["Body pitch p"] == list(LABEL_COLOURS[:2])


def test_a_comparison_begins_with_a_sentence_and_a_picture_and_links_its_video(make_run, tmp_path, monkeypatch):
    monkeypatch.setattr(plots, "picture", lambda *words, **options: "<svg></svg>")
    runs = [make_run(seconds=2.0), make_run(name="learned", seed=2, seconds=2.0)]
    script = Script("two", (Segment("stand", 1.0), Segment("walk <fast>", 1.0)))
    outcomes = {run.name: summarise(run) for run in runs}
    summary = comparison_summary(script, outcomes)
    comparison_page.write_comparison(tmp_path, summary, figure_table(outcomes), runs, script=script)
    comparison_page.link_video(tmp_path / "report.html", tmp_path / "compare.mp4")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    order = ["class=\"lead\">qp and learned stayed up for 2.0 s", "The ways from above", "href=\"compare.mp4\"",
             "Segment by segment", "<h2 id=\"figures\">"]  # fmt: skip
    assert sorted(order, key=text.index) == order
    assert "walk &lt;fast&gt; (1 to 2 s)" in text and "safety" not in text.lower(), "nothing to say of the filter"
    assert 'data-time="1.000" title="walk &lt;fast&gt;"' in (tmp_path / "replay.html").read_text(encoding="utf-8")


def test_what_the_filter_changed_is_named_and_zeros_are_left_out():
    reports = {"qp": SafetyReport(ticks=500, overruns=43), "learned": SafetyReport(ticks=50, commands_guarded={"l": 2})}
    (table,) = comparison_page.safety_tables({name: vars(report) for name, report in reports.items()})
    rows = {str(row[0]): row[1:] for row in table.rows}
    assert rows["command that the legs do not allow together with the others: l"] == (0, 2)
    (overruns,) = [name for name in rows if name.startswith("overruns: the controller took longer than its period")]
    assert rows[overruns] == (43, 0) and len(rows) == 2
    assert "qp 500, learned 50" in table.note
    assert comparison_page.safety_tables({"qp": vars(SafetyReport(ticks=500))}) == []


def test_plots_are_shaded_by_segment(make_run):
    chapters = [Chapter(0.0, "stand"), Chapter(0.5, "go on"), Chapter(5.0, "never")]
    panel = tracking_panels([make_run()], chapters)[0].svg
    assert ">stand</text>" in panel and ">go on</text>" in panel and "never" not in panel
    assert panel.count("opacity: 0.07") == 1

"""The report of a comparison: a self-contained page with tables and plots of one or more runs."""

import dataclasses
import html
import json
import pathlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from hugwbc.evaluation.comparison import headline, segment_spans, segment_table
from hugwbc.evaluation.tables import Table
from hugwbc.files import finite_json, write_whole
from hugwbc.report import page
from hugwbc.runtime.trace import Trace
from hugwbc.scripts.script import Script
from hugwbc.settings import seed_class
from hugwbc.viz.framing import LABEL_COLOURS, Chapter, check_traces, title_of
from hugwbc.viz.plots import Panel, hand_panels, path_panel, torque_panels, tracking_panels
from hugwbc.viz.replay import replay_html

COMPARISON_FILES = SUMMARY, REPORT, REPLAY = "summary.json", "report.html", "replay.html"
COMMANDED = "Commanded and measured"
BESIDE = {"Replay in three dimensions": REPLAY, "Figures as JSON": SUMMARY}


def report_html(
    title: str,
    traces: Sequence[Trace],
    tables: Sequence[Table] = (),
    *,
    lead: str = "",
    subtitle: str = "",
    chapters: Sequence[Chapter] = (),
) -> str:
    """Return the page, which loads nothing: a lead, the paths, a subtitle, links to the files beside it, tables, plots.

    It shows 1 to 4 runs. The chapters are shaded in the plots.
    """
    check_traces(traces)
    sections = [
        (COMMANDED, tracking_panels(traces, chapters)),
        ("Hands", hand_panels(traces, chapters)),
        ("Torques", torque_panels(traces, chapters)),
    ]
    body = [
        page.heading(title, 1),
        f'<p class="lead">{html.escape(lead)}</p>' if lead else "",
        page.legend(list(map(title_of, traces)), LABEL_COLOURS),
        page.pictures([path_panel(traces)]),
        page.paragraph(subtitle) if subtitle else "",
        f"<p>{page.links(BESIDE)}</p>",
        *(page.table_html(table) for table in tables),
        *(_section(name, panels, traces) for name, panels in sections if panels),
    ]
    return page.page_html(title, body)


def write_comparison(
    folder: pathlib.Path,
    summary: Mapping[str, Any],
    figures: Table,
    traces: Sequence[Trace],
    *,
    script: Script | None = None,
) -> list[pathlib.Path]:
    """Write the `COMPARISON_FILES` and return their paths.

    Summary and figures are those of `evaluation.comparison`, for a script or a task. With a script, the report has
    figures of its segments.
    """
    title = f"hugwbc compare: {summary.get('task') or summary['script']}"
    write_whole(folder / SUMMARY, json.dumps(finite_json(dict(summary)), indent=2) + "\n")
    spans = [] if script is None else segment_spans(script)
    chapters = [Chapter(begin, label) for label, begin, _ in spans]
    write_whole(folder / REPLAY, replay_html(traces, title=title, chapters=chapters))
    tables = [*([] if script is None else [segment_table(script, traces)]), figures]
    problems = [f"Scene of {trace.name}: {problem}." for trace in traces for problem in trace.problems]
    counters = {trace.name: dataclasses.asdict(trace.safety) for trace in traces}
    text = report_html(
        title,
        traces,
        [*tables, *safety_tables(counters)],
        lead=headline(summary["controllers"]),
        subtitle=" ".join([_conditions(summary, traces[0].scene is not None), *problems]),
        chapters=chapters,
    )
    write_whole(folder / REPORT, text)
    return [folder / name for name in COMPARISON_FILES]


def _conditions(summary: Mapping[str, Any], among_objects: bool) -> str:
    """Say with which robot and in which scene the runs were, and what was random; objects may vary with the seed."""
    arena, scene = summary["arena"], summary.get("scene")
    exact, where = arena["sensing"] == "exact", "" if scene is None else f" in the scene {scene}"
    seed = f"seed {summary['seed']} ({seed_class(summary['seed'])})"
    found = [f"Robot {pathlib.Path(arena['robot']).stem}", "exact sensors" if exact else "sensors with noise"]
    found += [f"drives {arena['drives']}", f"ground {arena['ground']}"]
    found += ["nothing random" if exact and not among_objects else seed]
    return f"One run of each{where}. {', '.join(found)}."


def link_video(report: pathlib.Path, video: pathlib.Path) -> None:
    """Add a link to a video to the page of a comparison, before the link to the replay."""
    text = report.read_text(encoding="utf-8")
    write_whole(report, text.replace("<p><a ", f"<p>{page.links({'Video': video.name})} · <a ", 1))


def safety_tables(counters: Mapping[str, Mapping[str, Any]]) -> list[Table]:
    """Return the table of what the safety filters changed, without rows of zeros; empty if they changed nothing."""
    counts = {name: dict(_counts(one)) for name, one in counters.items()}
    events = dict.fromkeys(event for found in counts.values() for event in found)
    rows = [(event, *(found.get(event, 0) for found in counts.values())) for event in events]
    ticks = ", ".join(f"{name} {one['ticks']}" for name, one in counters.items())
    note = f"In control steps; there were {ticks}."
    return [Table("What the safety filter changed", ("", *counts), rows, note)] if rows else []


def _counts(report: Mapping[str, Any]) -> Iterator[tuple[str, int]]:
    """Yield what was counted, for people, and how often, without what never was."""
    for event in report:
        if event in ("messages", "ticks"):
            continue
        named = report[event] if isinstance(report[event], Mapping) else {"": report[event]}
        for name, count in named.items():
            if count:
                yield ": ".join(filter(None, (EVENTS.get(event, event.replace("_", " ")), name))), count


# What the counters of `SafetyReport` count, for people.
EVENTS = {
    "commands_clamped": "command outside its range",
    "commands_guarded": "command that the legs do not allow together with the others",
    "hands_refused": "hand targets that are no numbers, or that the arms cannot follow",
    "hands_held": "no arm posture for the hand targets: the arms held",
    "upper_body_rejected": "arm targets that are no numbers",
    "upper_body_limited": "arm targets outside the joint limits",
    "wrench_limited": "force, payload or stiffness of the hands beyond its range",
    "bad_states": "unusable state",
    "bad_outputs": "unusable joint command",
    "failures": "exception in the controller",
    "source_failures": "exception in the source of commands or arm targets",
    "held": "last good joint command repeated",
    "damped": "joints damped",
    "positions_limited": "position target beyond its limit",
    "torques_limited": "feed-forward torque beyond its limit",
    "speeds_limited": "velocity target beyond its limit",
    "gains_limited": "stiffness or damping below 0 or beyond its limit",
    "readings_refused": "reading of a sensor refused and replaced",
    "braked": "braking first: told to change the gait while moving",
    "lowered": "kneeling down, or damped afterwards, since the state or a motor was lost",
    "overruns": "overruns: the controller took longer than its period (a simulation waits, a real robot does not; "
    "a busy computer causes them too)",
}


def _section(title: str, panels: Sequence[Panel], traces: Sequence[Trace]) -> str:
    dashed = "commanded (in the run's colour where runs were told different things)" if title == COMMANDED else ""
    key = page.legend(list(map(title_of, traces)), LABEL_COLOURS, dashed)
    return f"{page.heading(title)}\n{key}\n{page.pictures(panels)}"

"""The report: figures, conclusions and pictures of all results, as a page, Markdown and CSV."""

import dataclasses
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

from hugwbc.evaluation.engine import CellResult
from hugwbc.evaluation.figures import Figure
from hugwbc.evaluation.protocols import Protocol, all_protocols
from hugwbc.evaluation.protocols.protocol import Measured
from hugwbc.evaluation.tables import Table, markdown_table
from hugwbc.files import write_whole
from hugwbc.report import page
from hugwbc.report.clouds import LEVELS, hand_clouds
from hugwbc.report.conclusions import conclusions, duel_table, provenance
from hugwbc.report.figure_tables import comparison_table, figures_csv
from hugwbc.report.pictures import colours_controllers, draw
from hugwbc.report.training_curve import read_training, smoothed
from hugwbc.viz import charts
from hugwbc.viz.framing import LABEL_COLOURS

TITLE = "Whole-body control of the Unitree H1: the learned policy and qp"
LEGEND = (
    "A cell has the mean over episodes, its 95 % bootstrap interval, and the ratio to the paper's figure. 'worse' "
    "marks what is worse than the paper's figure by more than that interval, 'worse?' by less. Falls have a score "
    "interval."
)
_TRAINING_PANELS: Mapping[str, tuple[tuple[str, ...], str]] = {
    "Reward": (("reward",), "a step"),
    "Episode length": (("episode_length",), "steps"),
    "Tracking error while walking": (tuple(f"walking_error/{n}" for n in ("v_x", "v_y", "omega")), "m/s, rad/s"),
    "Curricula": (("alpha", "penalty_scale", "max_speed"), ""),
}


def sections() -> tuple[Protocol[Any, Any, Any], ...]:
    """Return the protocols that the report has sections of, in its order; those of other packages come last."""
    return tuple(protocol for protocol in all_protocols().values() if protocol.report_title)


def measured_by(protocol: Protocol[Any, Any, Any], results: Sequence[CellResult]) -> list[Measured]:
    """Return the results of one protocol, with the controllers' labels."""
    return [(entry.controller, entry.result) for entry in results if entry.protocol == protocol.name]


def all_figures(results: Sequence[CellResult]) -> list[Figure]:
    """Return the figures of all results, in the order of the sections.

    The figures that only the paper has come last, after all that belong to a controller.
    """
    figures = []
    measured_of = {protocol.name: measured_by(protocol, results) for protocol in sections()}
    for protocol in sections():
        measured = measured_of[protocol.name]
        for controller, result in measured:
            figures += protocol.figures(controller, result)
        figures += protocol.across(measured_of)
        figures += protocol.published(measured)
    return sorted(figures, key=lambda figure: not figure.controller)


@dataclasses.dataclass(frozen=True)
class Report:
    """The content of a report.

    Attributes:
        figures: figures of all tables.
        results: results of the protocols.
        controllers: labels, at least one; the conclusions compare the first two.
        notes: sentences on how the report was made and what it lacks.
        training: record of the learned policy's training; None if there is none.
    """

    figures: Sequence[Figure]
    results: Sequence[CellResult]
    controllers: Sequence[str]
    notes: Sequence[str]
    training: pathlib.Path | None = None

    def conclusions(self) -> list[str]:
        """Return sentences computed from the figures, and what the compared figures are."""
        found = conclusions(self.figures, *self._pair) or ["There is nothing to compare with."]
        return [*found, *provenance(self.figures, self.controllers)]

    def duel(self) -> Table:
        """Return the table of the first controller against the second one."""
        return duel_table(self.figures, *self._pair)

    @property
    def _pair(self) -> tuple[str, str]:
        first, second = (*self.controllers, *self.controllers)[:2]
        return first, second

    def tables(self, protocol: Protocol[Any, Any, Any]) -> list[Table]:
        """Return the tables of a protocol's section."""
        measured = measured_by(protocol, self.results)
        titles = dict.fromkeys(figure.table for entry in measured for figure in protocol.figures(*entry))
        return [comparison_table([f for f in self.figures if f.table == title]) for title in titles]

    def write(self, folder: pathlib.Path) -> list[pathlib.Path]:
        """Write the page, the Markdown and the CSV to a folder, and return their paths."""
        contents = {
            "report.html": report_page(self),
            "report.md": report_markdown(self),
            "figures.csv": figures_csv(self.figures),
        }
        for name, content in contents.items():
            write_whole(folder / name, content)
        return [folder / name for name in contents]


def report_markdown(report: Report) -> str:
    """Return the report as Markdown, without pictures."""
    lines = [f"# {TITLE}", "", *(f"- {note}" for note in report.notes), "", "## Conclusions", ""]
    lines += [*(f"- {line}" for line in report.conclusions()), ""]
    lines += [markdown_table(report.duel())] if len(report.controllers) > 1 else []
    for protocol in sections():
        tables = report.tables(protocol)
        if tables:
            lines += ["", f"## {protocol.report_title}", "", protocol.report_text]
            lines += [f"\n{markdown_table(table)}" for table in tables]
    return "\n".join([*lines, "", LEGEND, ""])


def report_page(report: Report) -> str:
    """Return the report as a page that loads nothing else."""
    parts = [(protocol.report_title, _section(report, protocol)) for protocol in sections()]
    parts += [("Noise of the intervention", _clouds()), ("Training", _training(report.training))]
    parts = [(title, html) for title, html in parts if html]
    titles = ["Conclusions", *(title for title, _ in parts)]
    body = [
        page.heading(TITLE, 1),
        page.bullets(report.notes),
        f"<p>{page.links({title: '#' + page.anchor(title) for title in titles})}</p>",
        page.heading("Conclusions"),
        page.bullets(report.conclusions()),
        page.table_html(report.duel(), 3) if len(report.controllers) > 1 else "",
        page.paragraph(LEGEND),
        *(page.folded(title, html) for title, html in parts),
    ]
    return page.page_html(TITLE, body)


def _section(report: Report, protocol: Protocol[Any, Any, Any]) -> str:
    tables = report.tables(protocol)
    if not tables:
        return ""
    pictures = protocol.pictures(measured_by(protocol, report.results), report.controllers)
    drawn = [draw(picture, report.controllers) for picture in pictures]
    key = page.legend(report.controllers, LABEL_COLOURS) if any(map(colours_controllers, pictures)) else ""
    html = [page.paragraph(protocol.report_text), *(page.table_html(table, 3) for table in tables), key]
    return "\n".join([*html, page.pictures(drawn) if drawn else ""])


def _clouds() -> str:
    text = page.paragraph(
        "Positions of the hands under the noise of the training's intervention, seen from behind, by the level of its "
        "curriculum: the arms follow level × noise + (1 - level) × policy; the nominal posture stands for the policy."
    )
    drawn = [charts.hand_cloud(f"level {level:g}", *hand_clouds(level)) for level in LEVELS]
    return f"{text}\n{page.legend(charts.FEET, LABEL_COLOURS)}\n{page.pictures(drawn)}"


def _training(path: pathlib.Path | None) -> str:
    if path is None:
        return ""
    record = read_training(path)
    steps, parts = record["steps"] / 1e6, []
    for title, (names, unit) in _TRAINING_PANELS.items():
        series = {name.split("/")[-1]: (steps, smoothed(record[name])) for name in names if name in record}
        if series:
            labels = ("million steps of the environment", unit)
            parts.append(charts.curves(title, series, labels, named=len(series) > 1))
    text = page.paragraph("Running means over nine records of the policy's training, as it wrote them.")
    return f"{text}\n{page.pictures(parts)}"

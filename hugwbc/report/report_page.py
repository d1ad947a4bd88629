"""The report's page: figures, conclusions and pictures of results, put together."""

import dataclasses
import pathlib
from collections.abc import Mapping, Sequence

from hugwbc.evaluation.engine import CellResult
from hugwbc.evaluation.tables import Table, markdown_table
from hugwbc.report import page
from hugwbc.report.clouds import LEVELS, hand_clouds
from hugwbc.report.conclusions import conclusions, duel_table
from hugwbc.report.figures import Figure, comparison_table
from hugwbc.report.pictures import PICTURES
from hugwbc.report.sections import FIGURES, SECTIONS, Section
from hugwbc.report.training_curve import read_training, smoothed
from hugwbc.viz import charts as pictures
from hugwbc.viz.framing import LABEL_COLOURS

TITLE = "Whole-body control of the Unitree H1: learned and model-based controllers"
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


@dataclasses.dataclass(frozen=True)
class Report:
    """What the page is made of.

    Attributes:
        figures: of all tables.
        results: the protocols' results.
        controllers: labels, at least one; conclusions compare the first two.
        notes: how it was made, and what to be careful about.
        training: record of the learned policy's training; None without one.
    """

    figures: Sequence[Figure]
    results: Sequence[CellResult]
    controllers: Sequence[str]
    notes: Sequence[str]
    training: pathlib.Path | None = None

    def conclusions(self) -> list[str]:
        """Sentences computed from the figures."""
        return conclusions(self.figures, *self._pair) or ["There is nothing to compare with."]

    def duel(self) -> Table:
        """The first two controllers against each other."""
        return duel_table(self.figures, *self._pair)

    @property
    def _pair(self) -> tuple[str, str]:
        first, second = (*self.controllers, *self.controllers)[:2]
        return first, second

    def tables(self, section: Section) -> list[Table]:
        """The tables of a section."""
        mine = [m for m in self.results if m.protocol in section.protocols]
        titles = dict.fromkeys(figure.table for result in mine for figure in FIGURES[result.protocol](result))
        return [comparison_table([f for f in self.figures if f.table == title]) for title in titles]


def report_markdown(report: Report) -> str:
    """The report without its pictures."""
    lines = [f"# {TITLE}", "", *(f"- {note}" for note in report.notes), "", "## Conclusions", ""]
    lines += [*(f"- {line}" for line in report.conclusions()), ""]
    lines += [markdown_table(report.duel())] if len(report.controllers) > 1 else []
    for section in SECTIONS:
        tables = report.tables(section)
        if tables:
            lines += ["", f"## {section.title}", "", section.text]
            lines += [f"\n{markdown_table(table)}" for table in tables]
    return "\n".join([*lines, "", LEGEND, ""])


def report_page(report: Report) -> str:
    """The page, with everything that it needs in it."""
    parts = [(section.title, _section(report, section)) for section in SECTIONS]
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
        *(f"{page.heading(title)}\n{html}" for title, html in parts),
    ]
    return page.page_html(TITLE, body)


def _section(report: Report, section: Section) -> str:
    tables = report.tables(section)
    if not tables:
        return ""
    drawn = [panel for name in section.protocols if name in PICTURES for panel in PICTURES[name](report)]
    key = page.legend(report.controllers, LABEL_COLOURS) if drawn and "heatmap" not in section.protocols else ""
    html = [page.paragraph(section.text), *(page.table_html(table, 3) for table in tables), key]
    return "\n".join([*html, page.pictures(drawn) if drawn else ""])


def _clouds() -> str:
    text = page.paragraph(
        "Positions of the hands under the noise of the training's intervention, seen from behind, by the level of its "
        "curriculum: the arms follow level × noise + (1 - level) × policy; the nominal posture stands for the policy."
    )
    drawn = [pictures.hand_cloud(f"level {level:g}", *hand_clouds(level)) for level in LEVELS]
    return f"{text}\n{page.legend(pictures.FEET, LABEL_COLOURS)}\n{page.pictures(drawn)}"


def _training(path: pathlib.Path | None) -> str:
    if path is None:
        return ""
    record = read_training(path)
    steps, parts = record["steps"] / 1e6, []
    for title, (names, unit) in _TRAINING_PANELS.items():
        series = {name.split("/")[-1]: (steps, smoothed(record[name])) for name in names if name in record}
        if series:
            labels = ("million steps of the environment", unit)
            parts.append(pictures.curves(title, series, labels, named=len(series) > 1))
    text = page.paragraph("Running means over nine records of the policy's training, as it wrote them.")
    return f"{text}\n{page.pictures(parts)}"

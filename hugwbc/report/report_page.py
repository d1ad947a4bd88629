"""The report: figures and pictures of all results, as a page and CSV."""

import dataclasses
import functools
import pathlib
from collections.abc import Sequence
from typing import Any

from hugwbc.evaluation.experiment import Experiment, Result, Section, frame_of
from hugwbc.evaluation.experiments import EXPERIMENTS
from hugwbc.evaluation.figures import Figure
from hugwbc.evaluation.intervals import FEW
from hugwbc.evaluation.tables import Table, comparison_sentence, figure_tables, figures_csv
from hugwbc.files import write_whole
from hugwbc.report import page
from hugwbc.viz.framing import LABEL_COLOURS

TITLE = "Whole-body control of humanoid robots"
LEGEND = (
    "A cell has the mean over episodes and its 95 % bootstrap interval; falls have a score interval. 'worse' marks "
    "what is worse than the paper's figure by more than that interval, 'worse?' by less or with fewer than "
    f"{FEW} episodes. Below a quantity stands its difference from the first controller over the same episodes; * marks "
    "one that is hardly chance, of means only where few episodes fell. The paper's column was not measured under our "
    "conditions: its policies were trained and tested in another simulator (Isaac Gym), with wider randomisation and "
    "another description of the robot (51.65 kg)."
)


@dataclasses.dataclass(frozen=True)
class Report:
    """The content of a report."""

    results: Sequence[Result]  # results of the experiments
    controllers: Sequence[str]  # labels, at least one; the first two are compared
    notes: Sequence[str]  # sentences on how the report was made and what it lacks

    @functools.cached_property
    def figures(self) -> list[Figure]:
        """The figures of all results, those that only the paper has last."""
        return merged([figure for result in self.results for figure in result.figures])

    @property
    def summary(self) -> str:
        """Sentences that compare the controllers with the paper, and the first two with each other."""
        first, second = (*self.controllers, *self.controllers)[:2]
        return comparison_sentence(self.figures, first, second)

    def of(self, experiment: Experiment[Any]) -> list[Result]:
        """Return the results of one experiment."""
        return [result for result in self.results if result.experiment == experiment.name]

    def tables(self, experiment: Experiment[Any]) -> list[Table]:
        """Return the tables of an experiment's section."""
        titles = {figure.table for result in self.of(experiment) for figure in result.figures}
        return figure_tables(figure for figure in self.figures if figure.table in titles)

    def write(self, folder: pathlib.Path) -> list[pathlib.Path]:
        """Write the page and the CSV to a folder, and return their paths."""
        contents = {"report.html": report_page(self), "figures.csv": figures_csv(self.figures)}
        for name, content in contents.items():
            write_whole(folder / name, content)
        return [folder / name for name in contents]


def merged(figures: Sequence[Figure]) -> list[Figure]:
    """Return figures once each, the paper's alone last, and only where no measured one stands beside it."""
    measured = {(f.table, f.quantity, f.reference) for f in figures if f.estimate is not None}
    kept = [f for f in dict.fromkeys(figures) if f.controller or (f.table, f.quantity, f.reference) not in measured]
    return sorted(kept, key=lambda figure: not figure.controller)


def sections() -> list[tuple[Experiment[Any], Section[Any]]]:
    """Return the experiments that the report has sections of, in its order."""
    return [(experiment, experiment.section) for experiment in EXPERIMENTS.values() if experiment.section]


def report_page(report: Report) -> str:
    """Return the report as a page that loads nothing else."""
    parts = [(section.title, _section(report, experiment, section)) for experiment, section in sections()]
    parts = [(title, html) for title, html in parts if html]
    body = [
        page.heading(TITLE, 1),
        page.bullets(report.notes),
        f"<p>{page.links({title: '#' + page.anchor(title) for title, _ in parts})}</p>",
        page.paragraph(report.summary),
        page.paragraph(LEGEND),
        *(page.folded(title, html) for title, html in parts),
    ]
    return page.page_html(TITLE, body)


def _section(report: Report, experiment: Experiment[Any], section: Section[Any]) -> str:
    tables = report.tables(experiment)
    if not tables:
        return ""
    measured = [(result.controller, result.settings, frame_of(result.rows)) for result in report.of(experiment)]
    drawn = section.pictures(measured, report.controllers)
    html = [page.paragraph(section.text), *(page.table_html(table, 3) for table in tables)]
    html += [page.legend(report.controllers, LABEL_COLOURS), page.pictures(drawn)] if drawn else []
    return "\n".join(html)

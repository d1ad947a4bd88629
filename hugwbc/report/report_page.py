"""The report: figures and pictures of all results, as a page, Markdown and CSV."""

import dataclasses
import functools
import pathlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from hugwbc.evaluation.conditions import NOISE_INTERVAL
from hugwbc.evaluation.experiment import Experiment, Result, Section, frame_of
from hugwbc.evaluation.experiments import EXPERIMENTS
from hugwbc.evaluation.figures import Figure
from hugwbc.evaluation.tables import Table, markdown_table
from hugwbc.files import write_whole
from hugwbc.kinematics import Kinematics
from hugwbc.learned.env.arm_intervention import NoiseTargets
from hugwbc.report import page
from hugwbc.report.figure_tables import comparison_sentence, comparison_table, figures_csv
from hugwbc.robot import SIDES, Robot, load_robot
from hugwbc.state import RobotState
from hugwbc.viz import evaluation_plots
from hugwbc.viz.framing import LABEL_COLOURS

LEVELS = (0.25, 0.5, 0.75, 1.0)  # of the curriculum's alpha
SAMPLES = 400
TITLE = "Whole-body control of the Unitree H1"
LEGEND = (
    "A cell has the mean over episodes, its 95 % bootstrap interval, and the ratio to the paper's figure. 'worse' "
    "marks what is worse than the paper's figure by more than that interval, 'worse?' by less. Falls have a score "
    "interval. The paper's column was not measured under our conditions: its policies were trained and tested in "
    "another simulator (Isaac Gym), with wider randomisation and another description of the robot (51.65 kg)."
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
        titles = dict.fromkeys(figure.table for result in self.of(experiment) for figure in result.figures)
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


def merged(figures: Sequence[Figure]) -> list[Figure]:
    """Return figures once each, the paper's alone last, and only where no measured one stands beside it."""
    measured = {(f.table, f.quantity, f.reference) for f in figures if f.estimate is not None}
    kept = [f for f in dict.fromkeys(figures) if f.controller or (f.table, f.quantity, f.reference) not in measured]
    return sorted(kept, key=lambda figure: not figure.controller)


def sections() -> list[tuple[Experiment[Any], Section[Any]]]:
    """Return the experiments that the report has sections of, in its order."""
    return [(experiment, experiment.section) for experiment in EXPERIMENTS.values() if experiment.section]


def report_markdown(report: Report) -> str:
    """Return the report as Markdown, without pictures."""
    lines = [f"# {TITLE}", "", *(f"- {note}" for note in report.notes), "", report.summary]
    for experiment, section in sections():
        tables = report.tables(experiment)
        if tables:
            lines += ["", f"## {section.title}", "", section.text]
            lines += [f"\n{markdown_table(table)}" for table in tables]
    return "\n".join([*lines, "", LEGEND, ""])


def report_page(report: Report) -> str:
    """Return the report as a page that loads nothing else."""
    parts = [(section.title, _section(report, experiment, section)) for experiment, section in sections()]
    if report.results:
        robot = load_robot(report.results[0].settings.conditions.chosen.robot)
        parts.append(("Noise of the intervention", _clouds(robot)))
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
    key = page.legend(report.controllers, LABEL_COLOURS) if any(panel.coloured for panel in drawn) else ""
    html = [page.paragraph(section.text), *(page.table_html(table, 3) for table in tables), key]
    return "\n".join([*html, page.pictures(drawn) if drawn else ""])


def _clouds(robot: Robot) -> str:
    text = page.paragraph(
        "Positions of the hands under the noise of the training's intervention, seen from behind, by the level of its "
        "curriculum: the arms follow level × noise + (1 - level) × policy; the nominal posture stands for the policy."
    )
    drawn = [evaluation_plots.hand_cloud(f"level {level:g}", *hand_clouds(robot, level)) for level in LEVELS]
    return f"{text}\n{page.legend(evaluation_plots.FEET, LABEL_COLOURS)}\n{page.pictures(drawn)}"


def hand_clouds(robot: Robot, level: float, samples: int = SAMPLES) -> tuple[np.ndarray, np.ndarray]:
    """Return positions of both hands in the pelvis frame under the noise of a curriculum level [m], (samples, 3).

    The arms follow alpha * noise + (1 - alpha) * policy, the paper's blend; the nominal posture stands for the policy.
    """
    source = NoiseTargets(robot, samples, NOISE_INTERVAL, torch.Generator().manual_seed(0))
    # The robots change targets at different times. After two intervals, none of them is at its nominal start any more.
    for _ in range(2 * NOISE_INTERVAL):
        source.step()
    kinematics = Kinematics(robot)
    nominal = robot.nominal[robot.arms]
    postures = level * source.targets().double().numpy() + (1.0 - level) * nominal
    hands = np.empty((len(SIDES), samples, 3))
    for index, posture in enumerate(postures):
        q = robot.nominal.copy()
        q[robot.arms] = posture
        kinematics.update(RobotState(q, np.zeros_like(q), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)))
        hands[:, index] = [kinematics.position(f"{side}_hand") for side in SIDES]
    return hands[0], hands[1]

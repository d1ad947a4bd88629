"""Which figures a report shows, in which order."""

import dataclasses

import pytest

from hugwbc.evaluation.experiment import Result, frame_of
from hugwbc.evaluation.experiments import EXPERIMENTS
from hugwbc.evaluation.experiments.intervention import InterventionSettings, figures
from hugwbc.evaluation.paper import TRAININGS
from hugwbc.evaluation.plans import Plan
from hugwbc.report.report_page import Report, sections
from hugwbc.report.report_plan import ReportPlan

ROW = {"command": "v_x", "error_name": "E_vx_low", "arm_error": None, "fell": False}


def result(controller: str, training: str) -> Result:
    """A result with an error under noise, and one with free arms."""
    settings = InterventionSettings(training=training)
    rows = [ROW | {"intervention": arms, "error": error} for arms, error in (("noise", 0.4), ("none", 0.1))]
    found = [
        dataclasses.replace(figure, controller=controller) if figure.estimate is not None else figure
        for figure in figures(settings, frame_of(rows))
    ]
    return Result("intervention", controller, settings, [Plan(0), Plan(1)], rows, found)


def test_every_training_has_its_paper_column_before_its_policies():
    report = Report([result("a", "noise"), result("b", "motion")], ["a", "b"], [])
    tables = {table.title: table for table in report.tables(EXPERIMENTS["intervention"])}
    table = tables["Intervention, walking, arms moved by noise"]
    papers = {key: f"HugWBC, paper, {words}" for key, words in TRAININGS.items()}
    assert list(table.columns) == ["", papers["noise"], "a", papers["motion"], "b", papers["none"]]
    row = dict(zip(table.columns, next(row for row in table.rows if row[0] == "E_vx [m/s]"), strict=True))
    assert row[papers["none"]] == 0.8658, "the paper's, for which there is no policy"
    alone = [not figure.controller for figure in report.figures]
    assert any(alone) and alone == sorted(alone), "the paper alone comes last"


@pytest.mark.parametrize("profile", ["quick", "full"])
def test_a_profile_has_every_section_for_every_controller(profile):
    plan = ReportPlan(profile, ("learned", "qp"), seed=3)
    available = {experiment.name for experiment, section in sections() if not section.unavailable()}
    assert {entry.experiment.name for entry in plan.entries} == available
    assert [entry.spec for entry in plan.entries][:2] == plan.specs
    assert {entry.settings.seed for entry in plan.entries} == {3}

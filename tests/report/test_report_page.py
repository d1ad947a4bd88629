from hugwbc.evaluation.engine import CellResult
from hugwbc.evaluation.protocols import PROTOCOLS, Protocol
from hugwbc.evaluation.protocols.intervention import TRAINED
from hugwbc.report.figure_tables import comparison_table
from hugwbc.report.report_page import all_figures, sections

PAPER = {"noise": {"E_vx": 0.2}, "none": {}}
SINGLE = {"gait": "walking", "paper": {"E_h": 0.064}, "rows": [{"error_name": "E_h", "error": 0.1, "fell": False}]}


def results(controller: str, training: str) -> CellResult:
    """A result with an error under noise, and one with free arms."""
    rows = [
        {"intervention": arms, "command": "v_x", "error": error, "fell": False}
        for arms, error in (("noise", 0.4), ("none", 0.1))
    ]
    errors = {arms: {"E_vx": 0.0} for arms in PAPER}
    content = {"gait": "walking", "training": training, "paper": PAPER, "rows": rows, "errors": errors}
    return CellResult("intervention", controller, content)


def test_every_training_has_its_paper_column_before_its_policies():
    measured = [results(name, training) for name, training in (("a", "noise"), ("b", "motion"))]
    figures = [f for f in all_figures(measured) if f.table == "Intervention, walking, arms moved by noise"]
    table = comparison_table(figures)
    papers = {key: f"HugWBC, paper, {words}" for key, words in TRAINED.items()}
    assert list(table.columns) == ["", papers["noise"], "a", papers["motion"], "b", papers["none"]]
    row = dict(zip(table.columns, next(row for row in table.rows if row[0] == "E_vx [m/s]"), strict=True))
    assert row[papers["none"]] == 0.8658, "the paper's, for which there is no policy"


def test_what_others_published_follows_what_was_measured_and_the_paper_alone_comes_last():
    figures = all_figures([results("a", "noise"), CellResult("single-command", "a", SINGLE)])
    assert [f.controller for f in figures[:3]] == ["a", "a", "HOVER"]
    alone = [not f.controller for f in figures]
    assert any(alone) and alone == sorted(alone)
    assert {f.controller for f in all_figures([results("a", "noise")])} == {"a", ""}, "nothing of other protocols"


def test_every_section_has_figures_and_runs_in_both_profiles():
    assert sections()
    for protocol in PROTOCOLS.values():
        there = protocol in sections()
        assert bool(protocol.report_text) == bool(protocol.quick()) == bool(protocol.full()) == there
        assert (type(protocol).figures is not Protocol.figures) == there

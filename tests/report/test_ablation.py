import pytest

from hugwbc.evaluation.engine import CellResult
from hugwbc.report.ablation import TRAINED, unmeasured_figures
from hugwbc.report.figures import comparison_table
from hugwbc.report.sections import FIGURES, all_figures

PAPER = {"noise": {"E_vx": 0.2, "v_x": 0.5}, "none": {}}


def results(protocol: str, controller: str, training: str, gait: str = "walking") -> CellResult:
    """A result with one error under noise in an upright episode, ten in a fall, and one with free arms."""
    rows = [
        {"intervention": arms, "command": "v_x", "error": error, "foot_travel": error, "fell": fell}
        for arms, error, fell in (("noise", 0.4, False), ("noise", 9.0, True), ("none", 0.1, False))
    ]
    tables = {"errors": {arms: {"E_vx": 0.0} for arms in PAPER}, "displacement": {arms: {"v_x": 0.0} for arms in PAPER}}
    return CellResult(
        protocol, controller, {"gait": gait, "training": training, "paper": PAPER, "rows": rows, **tables}
    )


def test_intervention_and_displacement_are_a_table_for_each_kind_of_arms():
    noise, falls, free, _ = FIGURES["intervention"](results("intervention", "qp", "noise"))
    assert noise.table == "Intervention, walking, arms moved by noise" and noise.unit == "m/s"
    assert noise.value == pytest.approx(4.7) and noise.paper == 0.2 and falls.value == 50.0
    assert free.value == 0.1 and free.paper is None
    noise, falls, *_ = FIGURES["foot-displacement"](results("foot-displacement", "qp", "noise"))
    assert noise.value == 0.4 and noise.paper == 0.5, "the path of a robot that fell says nothing"
    assert falls.value == 50.0
    assert {noise.reference, falls.reference} == {"trained with noise"}


def test_every_training_has_its_paper_column_before_its_policies():
    measured = [results("intervention", name, training) for name, training in (("a", "noise"), ("b", "motion"))]
    figures = [f for f in all_figures(measured) if f.table == "Intervention, walking, arms moved by noise"]
    table = comparison_table(figures)
    papers = {key: f"HugWBC, paper, {words}" for key, words in TRAINED.items()}
    assert list(table.columns) == ["", papers["noise"], "a", papers["motion"], "b", papers["none"]]
    row = dict(zip(table.columns, next(row for row in table.rows if row[0] == "E_vx [m/s]"), strict=True))
    assert row[papers["none"]] == 0.8658, "the paper's, for which there is no policy"


@pytest.mark.parametrize("protocol", ["intervention", "foot-displacement"])
def test_the_paper_stands_alone_where_nothing_of_its_training_was_measured(protocol):
    all_of_them = [results(protocol, name, name, "standing") for name in ("noise", "motion", "none")]
    assert unmeasured_figures(all_of_them) == []
    alone = unmeasured_figures(all_of_them[:1])
    assert {f.reference for f in alone} == {"trained with motions", "trained without intervention"}
    assert {f.controller for f in alone} == {""} and all(f.value is None and f.paper for f in alone)
    assert len(alone) == 2 * 3 * 3, "two trainings, three kinds of arms, three commands of standing"
    assert unmeasured_figures([]) == []

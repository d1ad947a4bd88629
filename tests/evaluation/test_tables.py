import csv
import dataclasses
import io

import pytest

from hugwbc.evaluation.figures import Difference, Figure
from hugwbc.evaluation.intervals import Estimate
from hugwbc.evaluation.tables import (
    CSV_COLUMNS,
    Marked,
    cell_text,
    comparison_sentence,
    figure_tables,
    figures_csv,
    format_table,
)
from tests.conftest import figure


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"), (float("nan"), "–"), (True, "yes"), (0.012345, "0.0123"), (1234.5, "1234"), (12, "12"), ("a", "a"),
        (Marked("2", "worse"), "2"),
    ],
)  # fmt: skip
def test_cells(value, text):
    assert cell_text(value) == text


def test_a_table_is_aligned_and_shows_what_is_missing():
    text = format_table(("error", "qp"), [("E_h", 0.0274), ("E_vx_high", None), ("fell", True), ("n", 12)])
    assert text.splitlines() == [
        "error          qp",
        "-----------------",
        "E_h        0.0274",
        "E_vx_high       –",
        "fell          yes",
        "n              12",
    ]


def test_every_figure_is_a_line_with_its_source():
    measured = Figure("Walking, fast", "E_h", "m", Estimate(0.06, 0.05, 0.07, 8), 0.03, controller="qp")
    published = Figure("Walking, fast", "E_h", "m", None, controller="HOVER", published=0.27)
    alone = Figure("Walking, fast", "E_h", "m", None, 0.05, reference="trained with motions")
    rows = list(csv.DictReader(io.StringIO(figures_csv([measured, published, alone]))))
    assert tuple(rows[0]) == CSV_COLUMNS
    assert rows[0]["table"] == "Walking, fast" and rows[0]["source"] == "measured"
    numbers = {name: float(rows[0][name]) for name in ("value", "low", "high", "samples", "paper", "ratio")}
    assert numbers == {"value": 0.06, "low": 0.05, "high": 0.07, "samples": 8, "paper": 0.03, "ratio": 2.0}
    assert rows[0]["against_paper"] == "worse"
    assert rows[1]["source"] == "published" and rows[1]["value"] == "0.27"
    alone = [rows[2][name] for name in ("source", "paper", "reference")]
    assert alone == ["paper alone", "0.05", "trained with motions"]
    assert rows[1]["low"] == rows[1]["ratio"] == rows[1]["against_paper"] == rows[1]["difference"] == ""
    paired = dataclasses.replace(measured, difference=Difference("learned", Estimate(2.0, 1.0, 3.0, 7)))
    (row,) = csv.DictReader(io.StringIO(figures_csv([paired])))
    found = [row[name] for name in ("against", "difference", "difference_low", "difference_high", "pairs", "p")]
    assert found == ["learned", "2", "1", "3", "7", ""]


def test_tables_have_the_papers_the_measured_and_the_published_figures_and_differences():
    pair, share = (
        Difference("a", Estimate(-0.0123, -0.02, -0.004, 8)),
        Difference("a", Estimate(-37.5, None, None, 8), 0.25),
    )
    figures = [
        figure(0.06, 0.05, 0.07, paper=0.03),
        dataclasses.replace(figure(0.0377, 0.0277, 0.0477, paper=0.03, controller="b"), difference=pair),
        figure(None, None, None, controller="HOVER", published=0.27),
        figure(100.0, None, None, quantity="success"),
        dataclasses.replace(figure(62.5, None, None, quantity="success", controller="b"), difference=share),
        figure(800.0, 800.0, None, quantity="force", controller="b"),
        figure(None, None, None, quantity="nobody has it"),
    ]
    (table,) = figure_tables(figures)
    assert (table.title, table.columns) == ("T", ["", "HugWBC, paper", "a", "b", "HOVER (published)"])
    assert table.rows == [
        [
            "E_h [m]",
            0.03,
            Marked("0.0600 [0.0500, 0.0700]", "worse"),
            Marked("0.0377 [0.0277, 0.0477]", "unclear"),
            Marked("0.27", "published"),
        ],
        ["  minus a", *map(Marked, ("", "", "-0.0123 [-0.0200, -0.0040] *", ""))],
        ["success [m]", None, Marked("100"), Marked("62.5"), None],
        ["  minus a", *map(Marked, ("", "", "-37.5 (p = 0.25)", ""))],
        ["force [m]", None, None, Marked("800 [800, –]"), None],
    ]


def test_one_sentence_compares_with_the_paper_and_one_controller_with_the_other():
    less, more = (Difference("a", Estimate(x, x - 0.1, x + 0.1, 8)) for x in (-0.3, 0.05))
    figures = [
        figure(0.5, 0.4, 0.6, paper=1.0),
        dataclasses.replace(figure(0.2, 0.1, 0.3, paper=1.0, controller="b"), difference=less),
        figure(3.0, 2.9, 3.1, paper=1.0, quantity="E_p"),
        dataclasses.replace(figure(3.1, 2.9, 3.2, quantity="E_p", controller="b"), difference=more),
        dataclasses.replace(figure(3.1, 2.9, 3.2, quantity="score", controller="b", higher=True), difference=less),
        dataclasses.replace(figure(3.1, 2.9, 3.2, quantity="NEES", controller="b", higher=None), difference=less),
    ]
    assert comparison_sentence(figures, "a", "b") == (
        "a is as good as the paper or better in 1 of 2 figures; b is as good as the paper or better in 1 of 1 figures; "
        "a is clearly better than b in 1 of 3 figures of the same episodes, and worse in 1."
    )
    assert comparison_sentence([], "a", "a") == "There is nothing to compare with."

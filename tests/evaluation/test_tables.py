import pytest

from hugwbc.evaluation.tables import Marked, Table, cell_text, format_table, markdown_table


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"), (float("nan"), "–"), (True, "yes"), (0.012345, "0.0123"), (12, "12"), ("a", "a"),
        (Marked("2 worse", "worse"), "2 worse"),
    ],
)  # fmt: skip
def test_cells(value, text):
    assert cell_text(value) == text


def test_markdown_marks_what_is_worse():
    table = Table("T", ("", "a|b"), [("E", Marked("2 worse", "worse")), ("F", Marked("3", "published"))], "A note.")
    assert markdown_table(table).split("\n") == [
        "### T", "", r"|  | a\|b |", "| --- | ---: |", "| E | **2 worse** |", "| F | 3 |", "", "A note."
    ]  # fmt: skip


def test_a_table_is_aligned_and_shows_what_is_missing():
    text = format_table(("error", "qp"), [("E_h", 0.0274), ("E_vx_high", None), ("fell", True), ("n", 12)])
    assert text.splitlines() == [
        "error         qp",
        "----------------",
        "E_h        0.027",
        "E_vx_high      -",
        "fell         yes",
        "n             12",
    ]

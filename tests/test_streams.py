"""Counts of a stream's messages, and the bounded reading of JSON."""

import pytest

from hugwbc.streams import Tally, read_object


def test_a_problem_is_told_once_a_second_for_each_kind_and_all_are_counted():
    now, told = 0.0, []
    tally = Tally("a line", told.append, lambda: now)
    for tick in range(101):  # 2.5 s
        now = 0.025 * tick
        tally.arrived()
        tally.note("refused", f"it is bad {tick}")
        tally.note("missing", number=2)
        if tick == 50:
            tally.note("silent", "nobody speaks")
    assert [text.split(":")[1].split()[0] for text in told] == ["refused", "refused", "silent", "refused"]
    assert str(tally) == (
        "a line: 101 messages, 101 refused, 202 missing, 1 silent, longest gap 25 ms; the last problem: it is bad 100"
    )


def test_a_problem_is_told_on_one_line_that_any_terminal_can_show():
    told = []
    tally = Tally("a line", told.append)
    tally.note("refused", "unknown key '\ud800\n\x1b[2J'")
    assert told == [r"a line: refused (1 so far): unknown key '\ud800\n\x1b[2J'"]
    assert str(tally).endswith(r"unknown key '\ud800\n\x1b[2J'")


@pytest.mark.parametrize(
    ("message", "words"),
    [(b"x" * 11, "longer than 10"), (b"\xff", "not JSON"), ("[" * 9, "not JSON"), ("[1]", "not a JSON object")],
)
def test_what_is_no_short_object_is_refused(message, words):
    with pytest.raises(ValueError, match=words):
        read_object(message, 10)

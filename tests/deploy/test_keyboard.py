"""Lines typed by the operator."""

import io
import threading

import pytest

from hugwbc.deploy.keyboard import listen


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_each_line_of_a_terminal_is_passed_on(monkeypatch) -> None:
    monkeypatch.setattr("sys.stdin", Terminal("s\n r \n\nq\n"))
    lines: list[str] = []
    done = threading.Event()

    def act(line: str) -> None:
        lines.append(line)
        if line == "q":
            done.set()

    listen(act)
    assert done.wait(10.0) and lines == ["s", "r", "", "q"]


@pytest.mark.parametrize("stdin", [None, io.StringIO("s\n")])
def test_without_a_terminal_nothing_is_read(monkeypatch, stdin) -> None:
    monkeypatch.setattr("sys.stdin", stdin)
    before = threading.active_count()
    listen(lambda line: pytest.fail("read"))
    assert threading.active_count() == before

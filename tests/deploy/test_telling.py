"""What is told must not hold up a control."""

import threading
import time

from hugwbc.deploy.telling import Aside


def test_a_terminal_that_takes_nothing_holds_up_nobody() -> None:
    ready, told = threading.Event(), []

    def tell(line: str) -> None:
        ready.wait(10.0)
        told.append(line)

    aside, begin = Aside(tell), time.perf_counter()
    for number in range(3000):
        aside(str(number))
    aside.finish(0.1)
    assert time.perf_counter() - begin < 5.0 and not told
    ready.set()
    aside.finish(10.0)
    assert told == [str(number) for number in range(len(told))] and len(told) >= 1000


def test_an_output_that_is_gone_ends_nothing() -> None:
    told = []

    def tell(line: str) -> None:
        if line == "lost":
            raise BrokenPipeError
        told.append(line)

    aside = Aside(tell)
    for line in ("one", "lost", "two"):
        aside(line)
    aside.finish(10.0)
    assert told == ["one", "two"]

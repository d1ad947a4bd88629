import os
import signal
import threading
from collections.abc import Iterator

import pytest

from hugwbc.learned.stopping import Stop, StoppedError, stopped_by_signals

NUMBERS = (signal.SIGINT, signal.SIGTERM)


@pytest.fixture(autouse=True)
def ctrl_c_interrupts() -> Iterator[None]:
    """Let SIGINT raise: a shell without job control makes its background processes ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_each_signal_asks_once_and_then_does_what_it_did() -> None:
    before = [signal.getsignal(number) for number in NUMBERS]
    with stopped_by_signals() as stop:
        stop.check()
        os.kill(os.getpid(), signal.SIGINT)
        assert stop.requested
        with pytest.raises(StoppedError):
            stop.check()
        os.kill(os.getpid(), signal.SIGTERM)  # the other signal of one Ctrl-C under torchrun
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
        assert [signal.getsignal(number) for number in NUMBERS] == before
    assert [signal.getsignal(number) for number in NUMBERS] == before


def test_handlers_are_restored_where_work_fails() -> None:
    before = [signal.getsignal(number) for number in NUMBERS]
    with pytest.raises(ZeroDivisionError), stopped_by_signals():
        assert [signal.getsignal(number) for number in NUMBERS] != before
        raise ZeroDivisionError
    assert [signal.getsignal(number) for number in NUMBERS] == before


def test_work_in_a_thread_is_not_asked() -> None:
    before = [signal.getsignal(number) for number in NUMBERS]
    seen: list[Stop] = []

    def work() -> None:
        with stopped_by_signals() as stop:
            assert [signal.getsignal(number) for number in NUMBERS] == before
            seen.append(stop)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert [stop.requested for stop in seen] == [False]

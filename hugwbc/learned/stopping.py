"""The request to stop long work: Ctrl-C and SIGTERM set it, and the work ends where it can save."""

import contextlib
import signal
import threading
from collections.abc import Iterator
from typing import Any


class StoppedError(Exception):
    """The work was asked to stop."""


class Stop:
    """The request to stop; the work checks it between its steps.

    Attributes:
        requested: whether the work was asked to stop.
    """

    def __init__(self) -> None:
        self.requested = False

    def check(self) -> None:
        """End the work with a `StoppedError` on request."""
        if self.requested:
            raise StoppedError


@contextlib.contextmanager
def stopped_by_signals() -> Iterator[Stop]:
    """Let SIGINT and SIGTERM ask for a stop instead of ending the process.

    Each signal does so once: when it comes again, it does what it did before, which usually ends the process. SIGTERM
    after SIGINT is no repetition, since torchrun sends both to its processes on one Ctrl-C. In a thread other than the
    main one, where Python handles no signals, nothing changes.

    Yields:
        The wish to stop.
    """
    stop, previous = Stop(), dict[int, Any]()

    def request(number: int, _frame: object) -> None:
        stop.requested = True
        signal.signal(number, previous.pop(number))

    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            previous[number] = signal.signal(number, request)
    try:
        yield stop
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)

"""Lines typed by the operator: a key and Enter, so that no terminal has to change its mode."""

import sys
import threading
from collections.abc import Callable


def listen(act: Callable[[str], None]) -> None:
    """Call `act` with each line that is typed, stripped, from a thread that ends with the process.

    Without a terminal nothing is read: a service's standard input is not an operator.
    """
    if sys.stdin is not None and sys.stdin.isatty():
        threading.Thread(target=_read, args=(act,), name="keyboard", daemon=True).start()


def _read(act: Callable[[str], None]) -> None:
    for line in sys.stdin:
        act(line.strip())

"""What is told to people, from a thread of its own: a terminal that takes no output must not delay control."""

import contextlib
import queue
import threading
import time
from collections.abc import Callable

_MOST = 1000  # lines that wait; what comes then is lost


class Aside:
    """Passes lines on to a function that may block, in their order, without waiting for it."""

    def __init__(self, tell: Callable[[str], None]) -> None:
        """Pass on to `tell`."""
        self._tell = tell
        self._lines: queue.Queue[str] = queue.Queue(_MOST)
        threading.Thread(target=self._work, name="telling", daemon=True).start()

    def __call__(self, line: str) -> None:
        """Take a line."""
        with contextlib.suppress(queue.Full):
            self._lines.put_nowait(line)

    def finish(self, patience: float = 1.0) -> None:
        """Wait until all lines are passed on, at most for a time [s]."""
        end = time.perf_counter() + patience
        while self._lines.unfinished_tasks and time.perf_counter() < end:
            time.sleep(0.001)

    def _work(self) -> None:
        while True:
            line = self._lines.get()
            with contextlib.suppress(OSError):  # a terminal that is gone, or a full disk
                self._tell(line)
            self._lines.task_done()

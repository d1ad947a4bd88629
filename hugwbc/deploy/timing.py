"""Timing of a deployment: latency from state to command, jitter of the publishing thread, and what keeps both small."""

import array
import contextlib
import dataclasses
import gc
import os
import sys
from collections.abc import Iterator

import numpy as np

_MS = 1e3
_SWITCH = 0.0005  # [s] for which one thread may keep the interpreter; the default of 5 ms is more than two commands


@contextlib.contextmanager
def real_time() -> Iterator[None]:
    """Let threads take turns quickly, and stop the garbage collector.

    A collection takes up to 50 ms at once. A control period makes no reference cycles, so that nothing piles up.
    """
    before = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCH)
    if _is_real_time():  # the network's threads first: of equals, the one that computes would keep its core
        lower = max(os.sched_getparam(0).sched_priority - 1, 1)
        os.sched_setscheduler(0, os.sched_getscheduler(0), os.sched_param(lower))
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        sys.setswitchinterval(before)


def _is_real_time() -> bool:
    return sys.platform == "linux" and os.sched_getscheduler(0) in (os.SCHED_FIFO, os.SCHED_RR)


def keep_apart(*, last: bool) -> None:
    """Keep this thread to the last core, or off it, if it is a real-time one; moved to and fro it finds cold caches."""
    if _is_real_time():
        *others, own = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, [own] if last or not others else others)


@dataclasses.dataclass(frozen=True)
class Spread:
    """How a measured time is spread [ms]; NaN without a measurement."""

    count: int  # number of measurements
    median: float  # the middle one
    p999: float  # the 99.9th percentile
    largest: float  # the largest one

    @classmethod
    def of(cls, seconds: np.ndarray) -> "Spread":
        """Summarise measured times [s]."""
        if seconds.size == 0:
            return cls(0, np.nan, np.nan, np.nan)
        median, p999 = np.percentile(seconds, (50.0, 99.9)) * _MS
        return cls(seconds.size, float(median), float(p999), float(seconds.max() * _MS))

    def __str__(self) -> str:
        """Return the figures in milliseconds."""
        if not self.count:
            return "not measured"
        return f"median {self.median:.2f} ms, 99.9 % {self.p999:.2f} ms, largest {self.largest:.2f} ms"


class Timing:
    """Times measured while a robot is controlled."""

    def __init__(self, period: float) -> None:
        """Measure a thread that publishes every `period` seconds."""
        self._period = period
        self._latency, self._deviation = array.array("d"), array.array("d")
        self._last: float | None = None
        self._missed_in_a_row = 0
        self.missed = 0  # commands that took longer than the controller's period, or were left out to catch up
        self.longest_miss = 0  # of these in a row

    def answered(self, seconds: float, limit: float, skipped: int = 0) -> None:
        """Note a command.

        Args:
            seconds: time from the arrival of its state to its publication [s].
            limit: the controller's period [s], beyond which it is late.
            skipped: periods before it without a command of their own.
        """
        self._latency.append(seconds)
        late = seconds > limit
        self.missed += skipped + late
        self._missed_in_a_row += skipped + late
        self.longest_miss = max(self.longest_miss, self._missed_in_a_row)
        if not late:  # those left out came before it
            self._missed_in_a_row = 0

    def published(self, now: float) -> None:
        """Note when the publishing thread has sent a message [s]."""
        if self._last is not None:
            self._deviation.append(abs(now - self._last - self._period))
        self._last = now

    @property
    def latency(self) -> Spread:
        """Time from the arrival of a state to the publication of the command that answers it."""
        return Spread.of(np.array(self._latency))

    @property
    def jitter(self) -> Spread:
        """Deviation of the time between two messages from the period."""
        return Spread.of(np.array(self._deviation))

"""What other programs send: read within bounds, counted, and told to the person at the terminal."""

import collections
import json
import math
import time
from collections.abc import Callable
from typing import Any

from hugwbc.errors import one_line

TELL_EVERY = 1.0  # [s] between two lines about problems of one kind


class Tally:
    """Counts of a stream's messages.

    Attributes:
        received: messages that have arrived.
        counts: problems by kind, such as "refused" and "missing".
        problem: the last one, in words; empty if there was none.
        gap: longest time between two arrivals [s].
    """

    def __init__(
        self,
        name: str,
        tell: Callable[[str], object] = lambda text: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin to count.

        Args:
            name: of the stream, for people.
            tell: called with a line about a problem, for each kind at most every `TELL_EVERY`.
            clock: returns seconds.
        """
        self._name, self._tell, self._clock = name, tell, clock
        self.received, self.gap, self.problem = 0, 0.0, ""
        self.counts: collections.Counter[str] = collections.Counter()
        self._last = math.inf
        self._told: dict[str, float] = {}

    def arrived(self, number: int = 1) -> None:
        """Count messages that arrive now."""
        now = self._clock()
        self.received += number
        self.gap, self._last = max(self.gap, now - self._last), now

    def note(self, kind: str, problem: str = "", number: int = 1) -> None:
        """Count a problem of a kind, and tell it in words if there are some."""
        self.counts[kind] += number
        if not problem:
            return
        self.problem, now = one_line(problem, 200), self._clock()
        if now - self._told.get(kind, -math.inf) >= TELL_EVERY:
            self._told[kind] = now
            self._tell(f"{self._name}: {kind} ({self.counts[kind]} so far): {self.problem}")

    def __str__(self) -> str:
        """Return all counts in a line."""
        counts = "".join(f", {count} {kind}" for kind, count in self.counts.items() if count)
        last = f"; the last problem: {self.problem}" if self.problem else ""
        return f"{self._name}: {self.received} messages{counts}, longest gap {1e3 * self.gap:.0f} ms{last}"


def read_object(message: bytes | str, longest: int) -> dict[str, Any]:
    """Read a JSON object of at most so many bytes or characters; anything else raises a `ValueError`."""
    if len(message) > longest:
        raise ValueError(f"it is longer than {longest} bytes")
    try:
        said = json.loads(message)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"it is not JSON ({error})") from error
    if not isinstance(said, dict):
        raise ValueError("it is not a JSON object")
    return said

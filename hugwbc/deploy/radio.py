"""A network that loses, delays and shuffles messages, for simulated robots."""

import heapq
from typing import Annotated, Generic, TypeVar

import numpy as np
from pydantic import Field

from hugwbc.settings import NotNegative, settings

Content = TypeVar("Content")


@settings
class Radio:
    """What a network does to messages, in each direction."""

    loss: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0  # part of the messages that is lost
    delay: NotNegative = 0.0  # time that a message takes [s]
    jitter: NotNegative = 0.0  # largest additional time, drawn evenly [s]; messages may overtake each other


class Channel(Generic[Content]):
    """Messages on their way in one direction."""

    def __init__(self, radio: Radio, rng: np.random.Generator, delay: float = 0.0) -> None:
        """Begin empty; the delay [s] comes in addition to the radio's."""
        self._radio, self._rng, self._delay = radio, rng, radio.delay + delay
        self._waiting: list[tuple[float, int, Content]] = []
        self._count = self.lost = 0  # messages sent and lost

    def put(self, message: Content, now: float) -> None:
        """Send a message at a time [s]."""
        loss, jitter = self._rng.uniform(size=2)
        if loss < self._radio.loss:
            self.lost += 1
            return
        self._count += 1
        heapq.heappush(self._waiting, (now + self._delay + jitter * self._radio.jitter, self._count, message))

    def take(self, now: float) -> list[Content]:
        """Return what has arrived by a time [s], in the order of arrival."""
        arrived = []
        while self._waiting and self._waiting[0][0] <= now + 1e-9:
            arrived.append(heapq.heappop(self._waiting)[2])
        return arrived

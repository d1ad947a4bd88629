"""Message transport: the interface, and a pair of endpoints within one process."""

import collections
import threading
import time
from collections.abc import Callable
from typing import Protocol

Service = Callable[[int, str], tuple[int, str]]
"""A service of the robot: takes the number of a call and its parameter, returns a code (0: done) and data."""
UNREACHABLE = 3104  # the maker's RPC_ERR_CLIENT_API_TIMEOUT


class Endpoint(Protocol):
    """One end of the connection between a robot and what controls it.

    The robot's end sends states and receives commands; the other one sends commands and receives states. Messages are
    the bytes of the maker's C structures.
    """

    def send(self, message: bytes) -> None:
        """Send a message; whether it arrives is not known."""
        ...

    def receive(self, timeout: float) -> list[bytes]:
        """Return the messages that have arrived, oldest first; wait up to `timeout` [s] for the first one."""
        ...

    def publish(self, topic: str, text: str) -> None:
        """Send a text on a topic besides states and commands."""
        ...

    def texts(self, topic: str) -> list[str]:
        """Return the texts that have arrived on a topic since the last call, oldest first."""
        ...

    def call(self, number: int, parameter: str, timeout: float) -> tuple[int, str]:
        """Call the robot's motion switcher.

        Args:
            number: of the call.
            parameter: JSON.
            timeout: how long to wait for the answer [s].

        Returns:
            The code of the answer, `UNREACHABLE` without one, and its data.
        """
        ...

    def serve(self, service: Service) -> None:
        """Answer calls of the motion switcher, from within `receive`."""
        ...

    def close(self) -> None:
        """Leave the network."""
        ...


class LocalEndpoint:
    """An end of a connection within one process, for tests; `local_pair` makes two."""

    def __init__(self, inbox: "_Box", outbox: "_Box") -> None:
        self._inbox, self._outbox = inbox, outbox

    def send(self, message: bytes) -> None:
        """Put a message into the other end's box."""
        self._outbox.put(message)

    def receive(self, timeout: float) -> list[bytes]:
        """Empty the box."""
        return self._inbox.take(timeout)

    def publish(self, topic: str, text: str) -> None:
        """Put a text into the other end's box."""
        self._outbox.texts[topic].append(text)

    def texts(self, topic: str) -> list[str]:
        """Empty the box of a topic."""
        waiting = self._inbox.texts[topic]
        return [waiting.popleft() for _ in range(len(waiting))]

    def call(self, number: int, parameter: str, timeout: float) -> tuple[int, str]:
        """Call the service of the other end at once."""
        service = self._outbox.service
        return (UNREACHABLE, "") if service is None else service(number, parameter)

    def serve(self, service: Service) -> None:
        """Offer a service to the other end."""
        self._inbox.service = service

    def close(self) -> None:
        """Do nothing; the boxes end with the process."""


class _Box:
    """A box of messages that keeps the newest few, as a reader of the network does."""

    def __init__(self, size: int) -> None:
        self._messages: collections.deque[bytes] = collections.deque(maxlen=size)
        self._changed = threading.Condition()
        self.texts: dict[str, collections.deque[str]] = collections.defaultdict(lambda: collections.deque(maxlen=size))
        self.service: Service | None = None

    def put(self, message: bytes) -> None:
        with self._changed:
            self._messages.append(message)
            self._changed.notify()

    def take(self, timeout: float) -> list[bytes]:
        end = time.perf_counter() + timeout
        with self._changed:
            while not self._messages and (left := end - time.perf_counter()) > 0.0:
                self._changed.wait(left)
            messages = list(self._messages)
            self._messages.clear()
        return messages


HISTORY = 32  # messages that wait for a reader


def local_pair() -> tuple[LocalEndpoint, LocalEndpoint]:
    """Return the robot's end and the other end of a connection within this process."""
    states, commands = _Box(HISTORY), _Box(HISTORY)
    return LocalEndpoint(commands, states), LocalEndpoint(states, commands)

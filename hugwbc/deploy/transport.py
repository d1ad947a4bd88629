"""The connection between a robot and what controls it."""

from collections.abc import Callable
from typing import Protocol

Service = Callable[[int, str], tuple[int, str]]
"""A service of the robot: takes the number of a call and its parameter, returns a code (0: done) and data."""
HISTORY = 32  # messages that wait for a reader
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

    def rivals(self) -> int:
        """Return how many messages others have sent in this end's place since the last call; the first one subscribes.

        A robot follows whoever sends last, so that two programs that command it make it fall.
        """
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

"""The connection between a robot and what controls it, and the robot's own motion modes.

While a motion mode is active, the robot's programs send commands to the same motors. The calls are those of the maker's
`MotionSwitcherClient` (unitree_sdk2_python, comm/motion_switcher). That class is not used, because it joins the network
by itself with multicast, which a second participant of this process would undo.
"""

import json
import time
from collections.abc import Callable
from typing import Protocol

from hugwbc.errors import DeploymentError, one_line

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

    def stop_receiving(self) -> None:
        """Leave the states and the rivals to another process of this end, to save the time that they cost here."""
        ...

    def publish(self, topic: str, text: str) -> None:
        """Send a text on a topic besides states and commands."""
        ...

    def texts(self, topic: str) -> list[str]:
        """Return the texts that have arrived on a topic since the last call, oldest first."""
        ...

    def call(self, number: int, parameter: str, timeout: float) -> tuple[int, str]:
        """Call the robot's motion switcher by the number of the call, with a parameter in JSON.

        Return the code of the answer, `UNREACHABLE` without one until the timeout [s], and its data.
        """
        ...

    def serve(self, service: Service) -> None:
        """Answer calls of the motion switcher, from within `receive`."""
        ...

    def close(self) -> None:
        """Leave the network."""
        ...


CHECK_MODE, RELEASE_MODE = 1001, 1003
DONE, UNKNOWN_CALL = 0, 3203
_TIMEOUT = 5.0  # [s] for one call
_TRIES, _PAUSE = 5, 0.5  # [s] between tries, for a mode to end


def release_modes(endpoint: Endpoint, *, required: bool) -> str:
    """Release the robot's motion modes until none is active; return what was done, for the log.

    A robot that does not answer is an error only if an answer is required: an H1 in its debug mode may have no motion
    switcher.
    """
    released: list[str] = []
    for attempt in range(_TRIES):
        code, data = endpoint.call(CHECK_MODE, "{}", _TIMEOUT)
        if code != DONE or (name := _active(data)) is None:
            said = {DONE: f"answers {one_line(data)!r}, which names no mode", UNREACHABLE: "does not answer"}
            outcome = said.get(code, f"answers with error {code}")
            if required:
                raise DeploymentError(
                    f"the robot's motion switcher {outcome}; check network and domain, or give --no-release if the "
                    "robot is in its debug mode"
                )
            return f"the motion switcher {outcome}"
        if not name:
            return f"released {', '.join(released)}" if released else "no motion mode is active"
        if name not in released:
            released.append(name)
        endpoint.call(RELEASE_MODE, "{}", _TIMEOUT)
        time.sleep(_PAUSE if attempt else 0.0)
    raise DeploymentError(
        f"motion mode '{released[-1]}' stays active; release it with the remote control (docs/deploy.md)"
    )


def _active(data: str) -> str | None:
    """Return the name of the active mode in an answer; empty if none is, None for an answer of another form."""
    try:
        content = json.loads(data)
    except (ValueError, RecursionError):
        return None
    if not isinstance(content, dict) or not isinstance(content.get("name", 0), str | None):
        return None
    return one_line(content["name"] or "")


class SimulatedSwitcher:
    """The motion switcher of a simulated robot."""

    def __init__(self, active: str = "") -> None:
        """Begin with a mode."""
        self.active = active  # name of the active mode; empty if none is

    def __call__(self, number: int, parameter: str) -> tuple[int, str]:
        """Answer a call."""
        if number == CHECK_MODE:
            return DONE, json.dumps({"form": "0", "name": self.active})
        if number == RELEASE_MODE:
            self.active = ""
            return DONE, ""
        return UNKNOWN_CALL, ""

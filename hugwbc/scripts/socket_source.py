"""Commands and hand targets from another program, as JSON over UDP on this machine (docs/how-to/teleoperate.md)."""

import dataclasses
import json
import math
import socket
import time
from collections.abc import Callable, Mapping
from typing import Any

from hugwbc.commands import COMMAND_NAMES, Command, default_command
from hugwbc.errors import ConfigError, HugwbcError
from hugwbc.gait import Gait
from hugwbc.targets import HandTargets

HOST = "127.0.0.1"
SILENCE = 0.3  # [s] without a message, after which the client is gone
LONGEST_MESSAGE = 4096  # [bytes]
_MOST_AT_ONCE = 64  # messages that one tick reads
_HAND_KEYS = ("left", "right", "frame", "left_direction", "right_direction", "together", "whole_body")
_KEYS = ("sequence", "gait", "command", "hands")


@dataclasses.dataclass(frozen=True)
class SocketCounts:
    """Messages since the start.

    Attributes:
        good: those that were followed.
        malformed: those that were no JSON object of the documented form, or out of range.
        late: those with a sequence number that is not above the last one's.
        silences: how often the client disappeared, so that the robot stopped.
    """

    good: int = 0
    malformed: int = 0
    late: int = 0
    silences: int = 0


class SocketSource:
    """A command source that follows the newest message; without one for `SILENCE`, it asks for rest.

    Hand targets stop with the client, too; those that jump are followed within the arms' limits
    (`hugwbc.upper_ik.UpperBodySource`).

    Attributes:
        port: that it listens on.
        counts: what arrived.
        problem: what was wrong with the last malformed message; empty if none was.
    """

    def __init__(self, port: int = 0, clock: Callable[[], float] = time.monotonic) -> None:
        """Listen on a port of this machine.

        Args:
            port: 0 for any that is free.
            clock: returns seconds, to tell silence.
        """
        if not 0 <= port <= 65535:
            raise ConfigError(f"port is {port}; give 1 to 65535, or 0 for any that is free")
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((HOST, port))
        except OSError as error:
            self._socket.close()
            raise ConfigError(f"cannot listen on port {port} of {HOST}: {error}; give another port") from error
        self._socket.setblocking(False)
        self.port = int(self._socket.getsockname()[1])
        self._clock, self._heard = clock, -math.inf
        self.counts, self.problem = SocketCounts(), ""
        self._command, self._hands, self._sequence = Command(), None, -1
        self._driven = False

    def close(self) -> None:
        """Stop listening."""
        self._socket.close()

    def command_at(self, t: float) -> Command:
        """Return the newest command; a stand once the client is silent."""
        self._receive()
        if self._driven and self._clock() - self._heard > SILENCE:
            self._driven, self._sequence = False, -1  # a client that is started again counts from the beginning
            self._command, self._hands = Command(), None
            self._count("silences")
        return self._command

    def hands_at(self, t: float) -> HandTargets | None:
        """Return the newest hand targets; None once the client is silent."""
        return self._hands

    def _receive(self) -> None:
        for _ in range(_MOST_AT_ONCE):
            try:
                message = self._socket.recv(LONGEST_MESSAGE + 1)
            except OSError:  # nothing left to read
                return
            try:
                self._take(message)
            except (HugwbcError, ValueError, TypeError, RecursionError, OverflowError) as error:
                self.problem = str(error)[:200]
                self._count("malformed")

    def _take(self, message: bytes) -> None:
        """Follow a message, or raise an error that says why not, leaving everything as it was."""
        if len(message) > LONGEST_MESSAGE:
            raise ValueError(f"a message is longer than {LONGEST_MESSAGE} bytes")
        said = json.loads(message)
        if not isinstance(said, dict) or not set(said) <= set(_KEYS):
            raise ValueError(f"a message is a JSON object with some of the keys {', '.join(_KEYS)}")
        sequence = said.get("sequence")
        if sequence is not None:
            if isinstance(sequence, bool) or not isinstance(sequence, int) or sequence < 0:
                raise ValueError("sequence is a whole number from 0")
            if sequence <= self._sequence:
                self._count("late")
                return
        command, hands = _command(said), _hands(said.get("hands"), sequence)
        self._command, self._hands = command, hands
        self._sequence = self._sequence if sequence is None else sequence
        self._heard, self._driven = self._clock(), True
        self._count("good")

    def _count(self, name: str) -> None:
        self.counts = dataclasses.replace(self.counts, **{name: getattr(self.counts, name) + 1})


def _command(said: Mapping[str, Any]) -> Command:
    values = said.get("command", {})
    if not isinstance(values, dict) or not set(values) <= set(COMMAND_NAMES):
        raise ValueError(f"command is an object with some of the keys {', '.join(COMMAND_NAMES)}")
    if any(isinstance(value, bool) or not isinstance(value, int | float) for value in values.values()):
        raise ValueError("values of a command are numbers")
    moving = any(values.get(name) for name in ("v_x", "v_y", "omega"))
    named = said.get("gait", "walking" if moving else "standing")
    if not isinstance(named, str):
        raise ValueError("gait is a name")
    gait = Gait.parse(named)
    return dataclasses.replace(default_command(gait), **{k: float(v) for k, v in values.items()}).validate()


def _hands(said: object, sequence: int | None) -> HandTargets | None:
    if said is None:
        return None
    if not isinstance(said, dict) or not set(said) <= set(_HAND_KEYS):
        raise ValueError(f"hands is an object with some of the keys {', '.join(_HAND_KEYS)}")
    if not isinstance(said.get("frame", "pelvis"), str):
        raise ValueError("frame is a name")
    if any(not isinstance(said.get(name, False), bool) for name in ("together", "whole_body")):
        raise ValueError("together and whole_body are true or false")
    rest = {name: value for name, value in said.items() if name not in ("left", "right")}
    return dataclasses.replace(HandTargets.of(said.get("left"), said.get("right"), **rest), sequence=sequence)

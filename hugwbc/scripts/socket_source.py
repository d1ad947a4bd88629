"""Commands and hand targets from another program, as JSON over UDP on this machine (docs/how-to/teleoperate.md)."""

import collections
import contextlib
import dataclasses
import math
import socket
import time
from collections.abc import Callable, Sequence
from typing import Any

from hugwbc.commands import COMMAND_NAMES, VELOCITY_NAMES, Command, default_command
from hugwbc.errors import ConfigError, HugwbcError, UnknownNameError
from hugwbc.gait import Gait
from hugwbc.robot import Robot
from hugwbc.streams import Tally, read_object
from hugwbc.targets import ORIENTATIONS, HandTargets

HOST = "127.0.0.1"
SILENCE = 0.3  # [s] without a message, after which the client is gone
LONGEST_MESSAGE = 4096  # [bytes]
_MOST_AT_ONCE = 4096  # messages that one tick takes from the socket, more than the system keeps
_NEWEST = 8  # newest of these messages, which it reads
_HAND_KEYS = ("left", "right", "frame", "left_direction", "right_direction", "together", "whole_body")
_HAND_KEYS += (*ORIENTATIONS, "orientation_weight")
_KEYS = ("sequence", "gait", "command", "hands")


class SocketSource:
    """A command source that follows the newest message; without one for `SILENCE`, it tells the robot to stand.

    Hand targets stop with the client, too; those that jump are followed within the arms' limits
    (`hugwbc.upper_ik.UpperBodySource`).

    Attributes:
        port: that it listens on.
        driven: whether a client gives the commands now.
        tally: what arrived. "overtaken" are messages that were not read because many newer ones waited.
    """

    def __init__(
        self,
        port: int = 0,
        clock: Callable[[], float] = time.monotonic,
        tell: Callable[[str], object] = lambda text: None,
        robot: Robot | None = None,
    ) -> None:
        """Listen on a port of this machine.

        Args:
            port: 0 for any that is free.
            clock: returns seconds, to tell silence.
            tell: called with what is wrong with messages, at most once a second for each kind of problem.
            robot: whose ranges and defaults commands have; None for the paper's.
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
        self._clock, self._heard, self._robot = clock, -math.inf, robot
        self.tally = Tally(f"UDP port {self.port}", tell, clock)
        self._stand = default_command(Gait.STANDING, robot)
        self._command, self._hands, self._sequence = self._stand, None, -1
        self.driven, self._followed = False, 0

    def close(self) -> None:
        """Stop listening."""
        self._socket.close()

    def command_at(self, t: float) -> Command:
        """Return the newest command; a stand once the client is silent."""
        self._receive()
        if self.driven and self._clock() - self._heard > SILENCE:
            self.driven, self._sequence = False, -1  # a client that is started again counts from the beginning
            self._command, self._hands = self._stand, None
            self.tally.note("silent", f"no good message for {SILENCE:g} s: the robot stands, with its own arms")
        return self._command

    def hands_at(self, t: float) -> HandTargets | None:
        """Return the newest hand targets; None once the client is silent."""
        return self._hands

    def _receive(self) -> None:
        """Empty the socket, so that the system never drops the newest messages, and read these."""
        waiting: collections.deque[bytes] = collections.deque(maxlen=_NEWEST)
        taken = 0
        with contextlib.suppress(OSError):  # nothing left to read
            while taken < _MOST_AT_ONCE:
                waiting.append(self._socket.recv(LONGEST_MESSAGE + 1))
                taken += 1
        if taken:
            self.tally.arrived(taken)
            self.tally.note("overtaken", number=taken - len(waiting))
        for number, message in enumerate(waiting, self.tally.received - len(waiting) + 1):
            try:
                self._take(message, number)
            except (HugwbcError, ValueError, TypeError, RecursionError, OverflowError) as error:
                self.tally.note("refused", str(error))

    def _take(self, message: bytes, number: int) -> None:
        """Follow message `number`; count a late one; raise an error on a bad one, and leave everything as it was."""
        said = read_object(message, LONGEST_MESSAGE)
        _check_keys("key of a message", said, _KEYS)
        sequence = said.get("sequence")
        if sequence is not None:
            if isinstance(sequence, bool) or not isinstance(sequence, int) or sequence < 0:
                raise ValueError("sequence is a whole number from 0")
            if sequence <= self._sequence:
                self.tally.note("late", f"sequence {sequence} is not above the last one, {self._sequence}")
                return
        command, hands = _command(said, self._robot), _hands(said.get("hands"), sequence)
        self._command, self._hands = command, hands
        if sequence is not None:
            if self._sequence >= 0:
                self.tally.note("missing", number=max(sequence - self._sequence - (number - self._followed), 0))
            self._sequence, self._followed = sequence, number
        self._heard, self.driven = self._clock(), True


def _check_keys(kind: str, said: object, known: Sequence[str]) -> None:
    """Refuse anything but a JSON object whose keys are all known."""
    if not isinstance(said, dict):
        raise ValueError(f"where a {kind} should be, there is no object; give one with some of {', '.join(known)}")
    for name in said:
        if name not in known:
            raise UnknownNameError(kind, name, known)


def _command(said: dict[str, Any], robot: Robot | None) -> Command:
    values = said.get("command", {})
    _check_keys("key of a command", values, COMMAND_NAMES)
    moving = any(values.get(name) for name in VELOCITY_NAMES)
    named = said.get("gait", "walking" if moving else "standing")
    if not isinstance(named, str):
        raise ValueError("gait is a name")
    return Command.from_mapping(values, Gait.parse(named), robot).validate(robot)


def _hands(said: dict[str, Any] | None, sequence: int | None) -> HandTargets | None:
    if said is None:
        return None
    _check_keys("key of hands", said, _HAND_KEYS)
    if not isinstance(said.get("frame", "pelvis"), str):
        raise ValueError("frame is a name")
    if any(not isinstance(said.get(name, False), bool) for name in ("together", "whole_body")):
        raise ValueError("together and whole_body are true or false")
    rest = {name: value for name, value in said.items() if name not in ("left", "right")}
    return dataclasses.replace(HandTargets.of(said.get("left"), said.get("right"), **rest), sequence=sequence)

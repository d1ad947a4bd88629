"""The operator: the remote control, whose buttons and sticks are part of every state message, and typed keys."""

import dataclasses
import enum
import math
import struct
import sys
import threading
from collections.abc import Callable

from hugwbc.commands import Command, command_ranges, default_command
from hugwbc.gait import Gait
from hugwbc.robot import Robot
from hugwbc.targets import HandTargets

BUTTONS = ("R1", "L1", "Start", "Select", "R2", "L2", "F1", "F2", "A", "B", "X", "Y", "up", "right", "down", "left")
REMOTE_SIZE = 40  # bytes
STICKS = {"lx": 4, "rx": 8, "ry": 12, "ly": 20}  # and where they are in the field
_BUTTONS_AT = 2
_DEAD = 0.05  # a stick's rest position is off by up to this


class Request(enum.Enum):
    """What the operator asks for."""

    START = "start"
    RUN = "run"
    STOP = "stop"


# The maker's deploy_real.py starts, runs and stops with these buttons.
_OF_BUTTON = {"Select": Request.STOP, "Start": Request.START, "A": Request.RUN}
OF_KEY = {"s": Request.START, "r": Request.RUN, "q": Request.STOP, " ": Request.STOP}


@dataclasses.dataclass(frozen=True)
class Remote:
    """One reading of the remote control."""

    pressed: frozenset[str] = frozenset()  # names of the pressed buttons, of `BUTTONS`
    lx: float = 0.0  # sticks, from -1 to 1; x to the right, y ahead
    ly: float = 0.0
    rx: float = 0.0
    ry: float = 0.0

    @classmethod
    def parse(cls, data: bytes) -> "Remote":
        """Read the field `wireless_remote`. A stick that is not finite, or is near its rest, is at 0."""
        bits = int.from_bytes(data[_BUTTONS_AT : _BUTTONS_AT + 2], "little")
        pressed = frozenset(name for bit, name in enumerate(BUTTONS) if bits >> bit & 1)
        return cls(pressed, **{name: _stick(data, at) for name, at in STICKS.items()})

    def pack(self) -> bytes:
        """Return the field `wireless_remote`."""
        data = bytearray(REMOTE_SIZE)
        bits = sum(1 << BUTTONS.index(name) for name in self.pressed)
        data[_BUTTONS_AT : _BUTTONS_AT + 2] = bits.to_bytes(2, "little")
        for name, at in STICKS.items():
            struct.pack_into("<f", data, at, getattr(self, name))
        return bytes(data)


def _stick(data: bytes, at: int) -> float:
    (value,) = struct.unpack_from("<f", data, at)
    return min(max(value, -1.0), 1.0) if _DEAD < abs(value) < math.inf else 0.0  # false for NaN as well


class ButtonPresses:
    """Turns presses of buttons into requests, once for each press."""

    def __init__(self) -> None:
        self._before: frozenset[str] | None = None

    def update(self, pressed: frozenset[str]) -> list[Request]:
        """Return new requests; a button that was held from the beginning counts as none."""
        new = frozenset() if self._before is None else pressed - self._before
        self._before = pressed
        return [request for name, request in _OF_BUTTON.items() if name in new]


_SLOPE = {"v_x": 0.5, "v_y": 0.4, "omega": 0.8}  # largest change [m/s^2], [rad/s^2]
_STILL = 1.0  # [s] with all sticks at rest and no speed left, after which the robot stands
_SMALL = 1e-6


class Sticks:
    """A source of commands: the left stick gives v_x and v_y, the right one omega.

    A stick at its end asks for half of the walking gait's range ahead, and for all of it to the other sides. Commands
    follow with limited slope; after a second without any, the robot stands.
    """

    def __init__(self, robot: Robot) -> None:
        """Begin standing; the ranges are the robot's."""
        self._ranges, self._walk = command_ranges(Gait.WALKING, robot), default_command(Gait.WALKING, robot)
        self._stand = default_command(Gait.STANDING, robot)
        self._requested = dict.fromkeys(_SLOPE, 0.0)
        self._used = dict.fromkeys(_SLOPE, 0.0)
        self._time: float | None = None
        self._moved = -math.inf

    def steer(self, remote: Remote, time: float) -> None:
        """Take the sticks at a time [s]."""
        step = 0.0 if self._time is None else max(time - self._time, 0.0)
        self._time = time
        self._requested = {
            "v_x": self._scaled("v_x", remote.ly) * (0.5 if remote.ly > 0.0 else 1.0),
            "v_y": self._scaled("v_y", -remote.lx),
            "omega": self._scaled("omega", -remote.rx),
        }
        for name, slope in _SLOPE.items():
            change = self._requested[name] - self._used[name]
            self._used[name] += min(max(change, -slope * step), slope * step)
        if any(abs(value) > _SMALL for value in (*self._requested.values(), *self._used.values())):
            self._moved = time

    def command_at(self, t: float) -> Command:
        """Return the command now; `t` does not matter."""
        if self._time is None or self._time - self._moved > _STILL:
            return self._stand
        return dataclasses.replace(self._walk, **self._used)

    def hands_at(self, t: float) -> HandTargets | None:
        """Leave the arms to the controller."""
        return None

    def _scaled(self, name: str, stick: float) -> float:
        low, high = self._ranges[name].finishing
        return stick * (high if stick > 0.0 else -low)


def listen(act: Callable[[str], None]) -> None:
    """Call `act` with each typed line, stripped, from a thread that ends with the process; Ctrl-D is an empty line.

    Without a terminal nothing is read: a service's standard input is not an operator.
    """
    if sys.stdin is not None and sys.stdin.isatty():
        threading.Thread(target=_read, args=(act,), name="keyboard", daemon=True).start()


def _read(act: Callable[[str], None]) -> None:
    line = "\n"
    while line or sys.stdin.isatty():  # after Ctrl-D a terminal goes on
        before, line = line, sys.stdin.readline()
        if not (before or line):  # it is gone
            return
        act(line.strip())

"""The remote control, whose buttons and sticks are part of every state message, and the keys for the same."""

import dataclasses
import enum
import struct

BUTTONS = ("R1", "L1", "Start", "Select", "R2", "L2", "F1", "F2", "A", "B", "X", "Y", "up", "right", "down", "left")
REMOTE_SIZE = 40  # bytes
_BUTTONS_AT, _STICKS = 2, {"lx": 4, "rx": 8, "ry": 12, "ly": 20}
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
    """One reading of the remote control.

    Attributes:
        pressed: names of the pressed buttons, of `BUTTONS`.
        lx, ly, rx, ry: sticks, from -1 to 1; x to the right, y ahead.
    """

    pressed: frozenset[str] = frozenset()
    lx: float = 0.0
    ly: float = 0.0
    rx: float = 0.0
    ry: float = 0.0

    @classmethod
    def parse(cls, data: bytes) -> "Remote":
        """Read the field `wireless_remote`. A stick that is not a number, or is near its rest, is at 0."""
        bits = int.from_bytes(data[_BUTTONS_AT : _BUTTONS_AT + 2], "little")
        pressed = frozenset(name for bit, name in enumerate(BUTTONS) if bits >> bit & 1)
        return cls(pressed, **{name: _stick(data, at) for name, at in _STICKS.items()})

    def pack(self) -> bytes:
        """Return the field `wireless_remote`."""
        data = bytearray(REMOTE_SIZE)
        bits = sum(1 << BUTTONS.index(name) for name in self.pressed)
        data[_BUTTONS_AT : _BUTTONS_AT + 2] = bits.to_bytes(2, "little")
        for name, at in _STICKS.items():
            struct.pack_into("<f", data, at, getattr(self, name))
        return bytes(data)


def _stick(data: bytes, at: int) -> float:
    (value,) = struct.unpack_from("<f", data, at)
    return min(max(value, -1.0), 1.0) if abs(value) > _DEAD else 0.0  # the comparison is false for NaN


class ButtonWatch:
    """A watch that turns presses of buttons into requests, once for each press."""

    def __init__(self) -> None:
        self._before: frozenset[str] | None = None

    def update(self, pressed: frozenset[str]) -> list[Request]:
        """Return new requests; a button that was held from the beginning counts as none."""
        new = frozenset() if self._before is None else pressed - self._before
        self._before = pressed
        return [request for name, request in _OF_BUTTON.items() if name in new]

"""Timed events of a simulated robot: buttons and sticks of its remote control, and its hoist."""

import dataclasses
from collections.abc import Sequence

from hugwbc.deploy.remote import BUTTONS, Remote
from hugwbc.errors import ConfigError

HOIST_WORDS = ("lift", "lower", "release")
_STICKS = ("lx", "ly", "rx", "ry")
_PRESS = 0.2  # [s] for which a button is held


@dataclasses.dataclass(frozen=True)
class Happening:
    """One event."""

    time: float  # when [s]
    word: str  # a button, a stick or a word for the hoist
    value: float = 0.0  # of a stick


class Schedule:
    """A list of events, and the next one to come."""

    def __init__(self, happenings: Sequence[Happening] = ()) -> None:
        """Begin before the first one."""
        self._next = sorted(happenings, key=lambda one: one.time)
        self._held: dict[str, float] = {}
        self._sticks: dict[str, float] = dict.fromkeys(_STICKS, 0.0)
        self.remote = Remote()  # the remote control now

    @classmethod
    def parse(cls, text: str) -> "Schedule":
        """Read a schedule such as "1 Start, 7 lower, 10 A, 12 ly=0.5, 30 Select"."""
        return cls([_happening(item.strip()) for item in text.split(",") if item.strip()])

    def update(self, now: float) -> list[str]:
        """Return the hoist commands due at a time [s], and set the remote control."""
        words = []
        while self._next and self._next[0].time <= now + 1e-9:
            one = self._next.pop(0)
            if one.word in HOIST_WORDS:
                words.append(one.word)
            elif one.word in BUTTONS:
                self._held[one.word] = one.time + _PRESS
            else:
                self._sticks[one.word] = one.value
        self._held = {name: until for name, until in self._held.items() if now < until}
        self.remote = Remote(frozenset(self._held), **self._sticks)
        return words

    def add(self, happening: Happening) -> None:
        """Add something, such as what a person asks for while the robot runs."""
        self._next = sorted([*self._next, happening], key=lambda one: one.time)


def _happening(item: str) -> Happening:
    valid = f"give TIME and one of {', '.join((*BUTTONS, *HOIST_WORDS))}, or lx, ly, rx or ry = -1 to 1"
    words = item.split()
    try:
        time = float(words[0])
        name, _, number = words[1].partition("=")
        value = float(number) if number else 0.0
    except (IndexError, ValueError):
        raise ConfigError(f"'{item}' in the schedule is not valid; {valid}") from None
    known = name in _STICKS if number else name in (*BUTTONS, *HOIST_WORDS)
    if len(words) != 2 or not known or not 0.0 <= time < float("inf") or not -1.0 <= value <= 1.0:
        raise ConfigError(f"'{item}' in the schedule is not valid; {valid}")
    return Happening(time, name, value)

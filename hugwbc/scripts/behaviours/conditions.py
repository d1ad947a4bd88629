"""Conditions on what is seen and felt, for `WaitUntil`, and for steps that end by them."""

import dataclasses
from typing import Protocol

import numpy as np

from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.robot import SIDES
from hugwbc.scripts.behaviours.behaviour import check_time, check_within, seen
from hugwbc.scripts.behaviours.view import View
from hugwbc.targets import FARTHEST

HANDS = (*SIDES, "both")
STRONGEST = 1000.0  # [N], no hand feels more
_LEAST = 0.001  # [m] or [N]
TOUCH = 3.0  # [N], a smaller force on a hand may be noise


def check_place(name: str, value: tuple[float, float]) -> None:
    """Refuse what is not two numbers, x and y of a place that can be walked to [m]."""
    if len(value) != 2 or not np.all(np.abs(value) <= FARTHEST):
        raise ConfigError(f"{name} is {value}; give two finite numbers, x and y, from -{FARTHEST:g} to {FARTHEST:g} m")


class Condition(Protocol):
    """A question with its answer at a tick."""

    def __call__(self, view: View, begin: View) -> tuple[bool, str]:
        """Return whether it holds, and in words how far it is.

        Args:
            view: now.
            begin: when the behaviour that asks began.
        """
        ...


def rows_of(hand: str) -> list[int]:
    """Return the rows of one hand or both."""
    if hand not in HANDS:
        raise UnknownNameError("hand", hand, HANDS)
    return [row for row, side in enumerate(SIDES) if hand in (side, "both")]


@dataclasses.dataclass(frozen=True)
class ForceAbove:
    """The force on a hand, or on each of both, is above a limit [N]."""

    force: float
    hand: str = "both"

    def __post_init__(self) -> None:
        rows_of(self.hand)
        check_within("force", self.force, _LEAST, STRONGEST, "N")

    def __call__(self, view: View, begin: View) -> tuple[bool, str]:
        """Return whether it holds; never where nothing tells the force."""
        if view.hand_force is None:
            return False, "no force on the hands is known"
        least = float(np.linalg.norm(view.hand_force[rows_of(self.hand)], axis=1).min())
        return least > self.force, f"the hand feels {least:.0f} of {self.force:g} N"


class Contact(ForceAbove):
    """A hand, or each of both, touches something."""

    def __init__(self, hand: str = "both") -> None:
        """Ask for one hand or both."""
        super().__init__(TOUCH, hand)


@dataclasses.dataclass(frozen=True)
class Lifted:
    """An object has risen since the behaviour began, by a height [m]."""

    object: str
    height: float = 0.03

    def __post_init__(self) -> None:
        check_within("height", self.height, _LEAST, 10.0)

    def __call__(self, view: View, begin: View) -> tuple[bool, str]:
        """Return whether it holds."""
        rise = float(seen(view, self.object).position[2] - seen(begin, self.object).position[2])
        return rise >= self.height, f"'{self.object}' has risen by {100 * rise:.1f} of {100 * self.height:g} cm"


@dataclasses.dataclass(frozen=True)
class Moved:
    """An object has moved since the behaviour began, by a distance [m]."""

    object: str
    distance: float

    def __post_init__(self) -> None:
        check_within("distance", self.distance, _LEAST, 100.0)

    def __call__(self, view: View, begin: View) -> tuple[bool, str]:
        """Return whether it holds."""
        way = seen(view, self.object).position - seen(begin, self.object).position
        moved = float(np.linalg.norm(way))
        return moved >= self.distance, f"'{self.object}' has moved by {100 * moved:.0f} of {100 * self.distance:g} cm"


@dataclasses.dataclass(frozen=True)
class Arrived:
    """The pelvis is over a point of the world [m], to a tolerance [m]."""

    position: tuple[float, float]
    tolerance: float = 0.03

    def __post_init__(self) -> None:
        check_within("tolerance", self.tolerance, _LEAST, 10.0)
        check_place("position", self.position)

    def __call__(self, view: View, begin: View) -> tuple[bool, str]:
        """Return whether it holds."""
        distance = float(np.linalg.norm(view.position[:2] - self.position))
        return distance <= self.tolerance, f"{100 * distance:.1f} cm from the place"


@dataclasses.dataclass(frozen=True)
class Elapsed:
    """A time has passed since the behaviour began [s]."""

    seconds: float

    def __post_init__(self) -> None:
        check_time("seconds", self.seconds)

    def __call__(self, view: View, begin: View) -> tuple[bool, str]:
        """Return whether it holds."""
        passed = view.time - begin.time
        return passed >= self.seconds, f"{passed:.1f} of {self.seconds:g} s have passed"

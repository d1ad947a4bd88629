"""Values of a scene that differ from episode to episode."""

import dataclasses
import math
from typing import Any, TypeAlias

import numpy as np

from hugwbc.errors import SceneError


@dataclasses.dataclass(frozen=True)
class Uniform:
    """A number that is drawn anew for every episode, evenly between two bounds.

    Attributes:
        low, high: the bounds.

    Raises:
        SceneError: if a bound is not finite, or they are in the wrong order.
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low <= self.high):
            raise SceneError(f"uniform from {self.low} to {self.high}; give two finite numbers, the smaller one first")


@dataclasses.dataclass(frozen=True)
class Choice:
    """A value that is drawn anew for every episode, one of several with equal chances.

    Attributes:
        values: numbers, or colours.

    Raises:
        SceneError: if there are none.
    """

    values: tuple[Any, ...]

    def __post_init__(self) -> None:
        if not self.values:
            raise SceneError("a choice has no values; give at least one")


Number: TypeAlias = float | Uniform | Choice
Colour: TypeAlias = str | Choice


def options(value: Any) -> tuple[Any, ...]:  # noqa: ANN401  numbers and colours
    """Return the values between which all draws of a value lie: its bounds, its choices, or the value itself."""
    if isinstance(value, Uniform):
        return value.low, value.high
    return value.values if isinstance(value, Choice) else (value,)


def drawn(value: Any, rng: np.random.Generator) -> Any:  # noqa: ANN401  numbers, colours, and tuples of them
    """Return a value without variation; tuples are drawn entry by entry."""
    if isinstance(value, Uniform):
        return float(rng.uniform(value.low, value.high))
    if isinstance(value, Choice):
        return value.values[int(rng.integers(len(value.values)))]
    if isinstance(value, tuple | list):
        return tuple(drawn(entry, rng) for entry in value)
    return value


def varies(value: Any) -> bool:  # noqa: ANN401  as for `drawn`
    """Return whether a value differs from episode to episode."""
    if isinstance(value, tuple | list):
        return any(varies(entry) for entry in value)
    return isinstance(value, Choice) or (isinstance(value, Uniform) and value.low != value.high)


def settled(value: Number) -> float:
    """Return a number that has been drawn.

    Raises:
        SceneError: if it still varies.
    """
    if isinstance(value, Uniform | Choice):
        raise SceneError(f"{value} has not been drawn; call `Scene.draw` first")
    return float(value)

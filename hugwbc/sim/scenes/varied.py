"""Values of a scene that differ from episode to episode."""

import math
import re
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field, PlainValidator

from hugwbc.errors import ConfigError, SceneError
from hugwbc.settings import refusing, settings

_FORMS = "a number, {uniform: [low, high]} or {choice: [a, b]}"


@settings
class Uniform:
    """A number that is redrawn for every episode, evenly between two bounds."""

    low: float
    high: float

    def __post_init__(self) -> None:
        if self.low > self.high:
            raise ConfigError(f"uniform from {self.low} to {self.high}; give the smaller one first")


@settings
class Choice:
    """A value that is redrawn for every episode, one of several with equal chances.

    Attributes:
        values: numbers, or colours.
    """

    values: Annotated[tuple[Any, ...], Field(min_length=1)]


def _variation(value: Any) -> Any:  # noqa: ANN401  numbers, colours and their variations
    """Return the variation that a mapping declares, and anything else as it is."""
    match value:
        case {"uniform": [low, high], **more} if not more:
            return Uniform(low, high)
        case {"choice": [*values], **more} if not more:
            return Choice(tuple(values))
        case Mapping():
            raise ConfigError(f"{value} is not a variation; give {_FORMS}")
    return value


def _number(value: Any) -> Any:  # noqa: ANN401
    varied = _variation(value)
    if isinstance(varied, Uniform):
        return varied
    try:
        numbers = [float(number) for number in options(varied)]
    except (TypeError, ValueError):
        numbers = [math.nan]
    if not all(map(math.isfinite, numbers)):
        raise ValueError(f"should be {_FORMS}")
    return Choice(tuple(numbers)) if isinstance(varied, Choice) else numbers[0]


def _colour(value: Any) -> Any:  # noqa: ANN401
    varied = _variation(value)
    if not all(isinstance(colour, str) and re.fullmatch("#[0-9a-fA-F]{6}", colour) for colour in options(varied)):
        raise ValueError('should be "#rrggbb", such as "#b9a58a", or a choice of them')
    return varied


def between(low: float, high: float) -> AfterValidator:
    """Return the annotation of a number whose every draw lies in a range."""

    def check(value: Any) -> Any:  # noqa: ANN401
        if not all(low <= number <= high for number in options(value)):
            raise ValueError(f"should be {low:g} to {high:g}")
        return value

    return AfterValidator(check)


Number = Annotated[float | Uniform | Choice, PlainValidator(refusing(_number))]
Colour = Annotated[str | Choice, PlainValidator(refusing(_colour))]
Length = Annotated[Number, between(0.001, 10.0)]  # [m]
Mass = Annotated[Number, between(0.001, 500.0)]  # [kg]


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


def scaled(value: Any, factor: float) -> Any:  # noqa: ANN401  numbers, and tuples of them
    """Return a value with every number times a factor."""
    if isinstance(value, Uniform):
        return Uniform(factor * value.low, factor * value.high)
    if isinstance(value, Choice):
        return Choice(scaled(value.values, factor))
    return tuple(scaled(entry, factor) for entry in value) if isinstance(value, tuple | list) else factor * value


def varies(value: Any) -> bool:  # noqa: ANN401  as for `drawn`
    """Return whether a value is drawn for every episode, perhaps from equal bounds."""
    if isinstance(value, tuple | list):
        return any(varies(entry) for entry in value)
    return isinstance(value, Uniform | Choice)


def settled(value: Number) -> float:
    """Return a number as a float; refuse one that has not been drawn."""
    if isinstance(value, Uniform | Choice):
        raise SceneError(f"{value} has not been drawn; call `Scene.draw` first")
    return float(value)

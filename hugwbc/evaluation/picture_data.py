"""Pictures of results as plain data: experiments say what to draw, the report draws it."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

XY = tuple[np.ndarray, np.ndarray]


@dataclasses.dataclass(frozen=True)
class Curves:
    """One curve for each controller.

    Attributes:
        title: what the picture shows.
        series: x and y of each controller, in the order of their colours; empty arrays for one without a result.
        labels: of the x and the y axis.
        dashed: x and y of a line to compare with.
        bottom: lower end of the y axis; None fits it to the data.
    """

    title: str
    series: Mapping[str, XY]
    labels: tuple[str, str]
    dashed: XY | None = None
    bottom: float | None = None


@dataclasses.dataclass(frozen=True)
class Polar:
    """One closed curve over directions for each controller, 0 pointing ahead and growing to the left.

    Attributes:
        title: what the picture shows.
        angles: directions [rad].
        series: values of each controller, in the order of their colours; None where there is none.
        unit: of the values.
    """

    title: str
    angles: Sequence[float]
    series: Mapping[str, Sequence[float | None]]
    unit: str


@dataclasses.dataclass(frozen=True)
class HeatMaps:
    """A map for every ordered pair of quantities, for one controller.

    Attributes:
        title: what the picture shows.
        names: of the quantities.
        maps: for (first, second) a square map, rows bottom up; NaN where there is no value.
        label: of the values.
    """

    title: str
    names: Sequence[str]
    maps: Mapping[tuple[str, str], np.ndarray]
    label: str


@dataclasses.dataclass(frozen=True)
class GaitDiagram:
    """When one controller's feet are on the ground, over the clock of the gait.

    Attributes:
        title: what the picture shows.
        time: [s], shape (T,).
        contact: whether the left and the right foot is on the ground, shape (T, 2), bool.
        clock: clock signal of the left and the right foot, in [-1, 1], shape (T, 2).
        controller: whose colour to use.
        length: of the time axis [s].
    """

    title: str
    time: np.ndarray
    contact: np.ndarray
    clock: np.ndarray
    controller: str
    length: float


Picture = Curves | Polar | HeatMaps | GaitDiagram

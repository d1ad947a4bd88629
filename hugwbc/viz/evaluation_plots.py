"""Plots of evaluations: polar plots, gait diagrams and curves."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from hugwbc.robot import SIDES
from hugwbc.viz.framing import LABEL_COLOURS, spans
from hugwbc.viz.plots import INK, Panel, picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.projections.polar import PolarAxes

_POLAR_HEIGHT = 5.0  # [in]


def polar(title: str, angles: Sequence[float], series: Mapping[str, Sequence[float | None]], unit: str) -> Panel:
    """Draw one closed curve for each name over directions [rad]; 0 (ahead) points up, angles grow to the left."""

    def draw(axes: "PolarAxes") -> None:
        axes.set_theta_zero_location("N")
        round_trip = [*angles, angles[0]]
        for (name, values), colour in zip(series.items(), LABEL_COLOURS, strict=False):
            numbers = [math.nan if value is None else value for value in values]
            axes.plot(round_trip, [*numbers, numbers[0]], color=colour, marker="o", markersize=4, label=name)
        axes.set_ylim(bottom=0.0)
        axes.set_xticks(list(angles), [f"{math.degrees(angle):.0f}°" for angle in angles])

    return Panel(f"{title} [{unit}]", picture(title, draw, height=_POLAR_HEIGHT, projection="polar"))


def gait_diagram(
    title: str, time: np.ndarray, contact: np.ndarray, clock: np.ndarray, controller: int, length: float
) -> Panel:
    """Draw when each foot is on the ground (bars) and the gait's clock signals (curves), the left foot on top.

    Contacts of both feet (bool) and their clock signals, in [-1, 1], have the shape (T, 2), the times [s] (T,). The
    number of the controller gives the colour of the bars, and the time axis has a length [s].
    """
    colour = LABEL_COLOURS[controller % len(LABEL_COLOURS)]

    def draw(axes: "Axes") -> None:
        for foot, lane in enumerate((1.0, 0.0)):
            bars = [(start, stop - start) for start, stop in spans(time, contact[:, foot])]
            axes.broken_barh(bars, (lane - 0.36, 0.72), facecolors=colour, alpha=0.35)
            axes.plot(time, lane + 0.36 * clock[:, foot], color=INK, linewidth=1.1)
        axes.set_yticks([1.0, 0.0], SIDES)
        axes.set_ylim(-0.6, 1.6)
        axes.set_xlim(time[0], time[0] + length)
        axes.set_xlabel("s")
        axes.grid(visible=False, axis="y")

    return Panel(title, picture(title, draw))


def curves(title: str, series: Mapping[str, tuple[np.ndarray, np.ndarray]], labels: tuple[str, str]) -> Panel:
    """Draw a curve of x and y values for each name, in the colours of `LABEL_COLOURS`, and y = x as a dashed line.

    Where there is no point at all, the picture says so. The labels are those of the two axes.
    """
    line = np.unique(np.concatenate([x for x, _ in series.values()]))

    def draw(axes: "Axes") -> None:
        for (name, (x, y)), colour in zip(series.items(), LABEL_COLOURS, strict=False):
            axes.plot(x, y, color=colour, marker="o" if len(x) <= 12 else None, markersize=4, label=name)
        axes.plot(line, line, color=INK, linestyle="--", linewidth=1.0)
        if not len(line):
            axes.text(0.5, 0.5, "nothing was measured", color=INK, ha="center", transform=axes.transAxes)
        axes.set_xlabel(labels[0])
        axes.set_ylabel(labels[1])

    return Panel(title, picture(title, draw))

"""Pictures of evaluations: heat maps, polar plots, gait diagrams, clouds of hand positions and curves."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from hugwbc.viz.framing import LABEL_COLOURS
from hugwbc.viz.plots import INK, Panel, picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.projections.polar import PolarAxes

_MAPS_HEIGHT, _POLAR_HEIGHT, _CLOUD_HEIGHT = 5.0, 5.0, 5.0  # [in]
_GAP = 1  # number of empty cells between two heat maps
_TOP = 3.0  # value of the brightest colour of a heat map
FEET = ("left", "right")


def heat_maps(title: str, names: Sequence[str], maps: Mapping[tuple[str, str], np.ndarray], label: str) -> Panel:
    """Draw heat maps of all ordered pairs of quantities: a row for each first name, a column for each second.

    A map is square, with its rows from bottom to top; NaN cells are crossed out. The label is that of the colour bar,
    which goes from 0 to `_TOP`.
    """

    def draw(axes: "Axes") -> None:
        points = len(next(iter(maps.values())))
        pitch = points + _GAP
        size = pitch * len(names) - _GAP
        whole = np.full((size, size), np.nan)
        crosses: list[tuple[float, float]] = []
        for (first, second), values in maps.items():
            # Names read from the top, whereas rows count from the bottom.
            row, column = pitch * (len(names) - 1 - names.index(first)), pitch * names.index(second)
            whole[row : row + points, column : column + points] = values
            crosses += [(column + x, row + y) for y, x in np.argwhere(~np.isfinite(values))]
        image = axes.imshow(whole, origin="lower", interpolation="none", cmap="viridis", vmin=0.0, vmax=_TOP)
        if crosses:
            axes.plot(*zip(*crosses, strict=True), "x", color=INK, markersize=3, markeredgewidth=0.8)
        middles = pitch * np.arange(len(names)) + (points - 1) / 2
        axes.set_xticks(middles, names)
        axes.set_yticks(middles, list(reversed(names)))
        axes.grid(visible=False)
        axes.set_xlabel("against")
        axes.set_ylabel("error of")
        assert axes.figure is not None
        axes.figure.colorbar(image, ax=axes, label=label, extend="max")

    return Panel(title, picture(title, draw, height=_MAPS_HEIGHT), coloured=False)


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


def spans(time: np.ndarray, on: np.ndarray) -> list[tuple[float, float]]:
    """Return start and length of every stretch of evenly spaced samples in which something is on, shape (T,), bool."""
    changes = np.flatnonzero(np.diff(np.concatenate(([False], on, [False])).astype(int)))
    step = time[1] - time[0] if len(time) > 1 else 1.0
    return [(float(time[a]), float((b - a) * step)) for a, b in zip(changes[::2], changes[1::2], strict=True)]


def gait_diagram(
    title: str, time: np.ndarray, contact: np.ndarray, clock: np.ndarray, controller: int, length: float
) -> Panel:
    """Draw when each foot is on the ground (bars) and the gait's clock signals (curves), the left foot on top.

    Args:
        title: title of the picture.
        time: times of the samples [s], shape (T,).
        contact: whether the left and the right foot are on the ground, shape (T, 2), bool.
        clock: clock signals of the left and the right foot, in [-1, 1], shape (T, 2).
        controller: number of the controller, which gives the colour of the bars.
        length: length of the time axis [s].
    """
    colour = LABEL_COLOURS[controller % len(LABEL_COLOURS)]

    def draw(axes: "Axes") -> None:
        for foot, lane in enumerate((1.0, 0.0)):
            axes.broken_barh(spans(time, contact[:, foot]), (lane - 0.36, 0.72), facecolors=colour, alpha=0.35)
            axes.plot(time, lane + 0.36 * clock[:, foot], color=INK, linewidth=1.1)
        axes.set_yticks([1.0, 0.0], FEET)
        axes.set_ylim(-0.6, 1.6)
        axes.set_xlim(time[0], time[0] + length)
        axes.set_xlabel("s")
        axes.grid(visible=False, axis="y")

    return Panel(title, picture(title, draw))


def hand_cloud(title: str, left: np.ndarray, right: np.ndarray) -> Panel:
    """Draw hand positions (n, 3) in the pelvis frame as seen from behind, with y to the left and z up [m]."""

    def draw(axes: "Axes") -> None:
        for points, colour, name in ((left, LABEL_COLOURS[0], FEET[0]), (right, LABEL_COLOURS[1], FEET[1])):
            axes.plot(points[:, 1], points[:, 2], ".", color=colour, markersize=2.5, alpha=0.6, label=name)
        axes.set_aspect("equal")
        axes.set_xlim(1.1, -1.1)
        axes.set_ylim(-0.5, 1.2)
        axes.set_xlabel("y [m]")
        axes.set_ylabel("z [m]")

    return Panel(title, picture(title, draw, height=_CLOUD_HEIGHT))


def curves(
    title: str,
    series: Mapping[str, tuple[np.ndarray, np.ndarray]],
    labels: tuple[str, str],
    *,
    dashed: tuple[np.ndarray, np.ndarray],
    bottom: float | None = None,
) -> Panel:
    """Draw a curve of x and y values for each name, in the colours of `LABEL_COLOURS`, and a dashed reference line.

    The labels are those of the two axes; `bottom` is the lower end of the vertical axis.
    """

    def draw(axes: "Axes") -> None:
        for (name, (x, y)), colour in zip(series.items(), LABEL_COLOURS, strict=False):
            axes.plot(x, y, color=colour, marker="o" if len(x) <= 12 else None, markersize=4, label=name)
        axes.plot(*dashed, color=INK, linestyle="--", linewidth=1.0)
        if bottom is not None:
            axes.set_ylim(bottom=bottom)
        axes.set_xlabel(labels[0])
        axes.set_ylabel(labels[1])

    return Panel(title, picture(title, draw))

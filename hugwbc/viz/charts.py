"""Pictures of evaluations: heat maps, polar plots, gait diagrams, clouds of hand positions, curves."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.projections.polar import PolarAxes

from hugwbc.viz.framing import LABEL_COLOURS
from hugwbc.viz.plots import INK, Panel, picture

_MAPS_HEIGHT, _POLAR_HEIGHT, _CLOUD_HEIGHT = 5.0, 5.0, 5.0  # [in]
_GAP = 1  # cells between two heat maps
_TOP = 3.0  # of the colours of heat maps
FEET = ("left", "right")


def heat_maps(title: str, names: Sequence[str], maps: Mapping[tuple[str, str], np.ndarray], label: str) -> Panel:
    """Maps of every ordered pair of quantities in one picture: a row for each first name, a column for each second.

    Args:
        title: what it shows.
        names: of the quantities.
        maps: for (first, second) a square map, rows bottom up; NaN, which is crossed out, where there is no value.
        label: of the values, which are coloured from 0 to `_TOP`.
    """

    def draw(axes: Axes) -> None:
        points = len(next(iter(maps.values())))
        pitch = points + _GAP
        size = pitch * len(names) - _GAP
        whole = np.full((size, size), np.nan)
        crosses: list[tuple[float, float]] = []
        for (first, second), values in maps.items():
            # The first name's row is the uppermost.
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

    return Panel(title, picture(title, draw, height=_MAPS_HEIGHT))


def polar(title: str, angles: Sequence[float], series: Mapping[str, Sequence[float | None]], unit: str) -> Panel:
    """One closed curve a name over the directions, 0 pointing up (ahead) and growing to the left.

    Args:
        title: what it shows.
        angles: [rad].
        series: values of each name, None where there is none.
        unit: of the values.
    """

    def draw(axes: PolarAxes) -> None:
        axes.set_theta_zero_location("N")
        round_trip = [*angles, angles[0]]
        for (name, values), colour in zip(series.items(), LABEL_COLOURS, strict=False):
            numbers = [math.nan if value is None else value for value in values]
            axes.plot(round_trip, [*numbers, numbers[0]], color=colour, marker="o", markersize=4, label=name)
        axes.set_ylim(bottom=0.0)
        axes.set_xticks(list(angles), [f"{math.degrees(angle):.0f}°" for angle in angles])

    return Panel(f"{title} [{unit}]", picture(title, draw, height=_POLAR_HEIGHT, projection="polar"))


def spans(time: np.ndarray, on: np.ndarray) -> list[tuple[float, float]]:
    """Start and length of every stretch of samples in which something is on.

    Args:
        time: of the samples, evenly spaced, shape (T,).
        on: shape (T,), bool.
    """
    changes = np.flatnonzero(np.diff(np.concatenate(([False], on, [False])).astype(int)))
    step = time[1] - time[0] if len(time) > 1 else 1.0
    return [(float(time[a]), float((b - a) * step)) for a, b in zip(changes[::2], changes[1::2], strict=True)]


def gait_diagram(
    title: str, time: np.ndarray, contact: np.ndarray, clock: np.ndarray, colour: str, length: float
) -> Panel:
    """When each foot is on the ground (bars), and the clock signals (curves), left foot above the right one.

    Args:
        title: what it shows.
        time: [s], shape (T,).
        contact: of the left and right foot, shape (T, 2), bool.
        clock: of the left and right foot, in [-1, 1], shape (T, 2).
        colour: of the bars.
        length: of the time axis [s].
    """

    def draw(axes: Axes) -> None:
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
    """Hand positions seen from behind, y to the left and z up [m].

    Args:
        title: what it shows.
        left: positions of the left hand in the pelvis frame [m], shape (n, 3).
        right: of the right hand.
    """

    def draw(axes: Axes) -> None:
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
    dashed: tuple[np.ndarray, np.ndarray] | None = None,
    named: bool = False,
    bottom: float | None = None,
) -> Panel:
    """One curve a name, in the colours of `LABEL_COLOURS`.

    Args:
        title: what it shows.
        series: x and y of each name.
        labels: of x and y.
        dashed: x and y of a line to compare with.
        named: whether the names stand in the picture.
        bottom: of the vertical axis; None for what fits.
    """

    def draw(axes: Axes) -> None:
        for (name, (x, y)), colour in zip(series.items(), LABEL_COLOURS, strict=False):
            axes.plot(x, y, color=colour, marker="o" if len(x) <= 12 else None, markersize=4, label=name)
        if dashed is not None:
            axes.plot(*dashed, color=INK, linestyle="--", linewidth=1.0)
        if named:
            axes.legend(frameon=False, labelcolor=INK)
        if bottom is not None:
            axes.set_ylim(bottom=bottom)
        axes.set_xlabel(labels[0])
        axes.set_ylabel(labels[1])

    return Panel(title, picture(title, draw))

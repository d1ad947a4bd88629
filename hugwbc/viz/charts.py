"""Pictures of evaluations: gait diagrams, clouds of hand positions and curves."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from hugwbc.viz.framing import LABEL_COLOURS
from hugwbc.viz.plots import INK, Panel, picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_CLOUD_HEIGHT = 5.0  # [in]
FEET = ("left", "right")


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
) -> Panel:
    """Draw a curve of x and y values for each name, in the colours of `LABEL_COLOURS`, and a dashed reference line.

    The labels are those of the two axes.
    """

    def draw(axes: "Axes") -> None:
        for (name, (x, y)), colour in zip(series.items(), LABEL_COLOURS, strict=False):
            axes.plot(x, y, color=colour, marker="o" if len(x) <= 12 else None, markersize=4, label=name)
        axes.plot(*dashed, color=INK, linestyle="--", linewidth=1.0)
        axes.set_xlabel(labels[0])
        axes.set_ylabel(labels[1])

    return Panel(title, picture(title, draw))

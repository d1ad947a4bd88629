"""Plots of runs as small SVG pictures in the page's text colour, readable on light and dark backgrounds."""

import dataclasses
import io
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from hugwbc import rotations
from hugwbc.commands import COMMAND_NAMES, COMMAND_UNITS, MEASURED_NAMES
from hugwbc.gait import Gait
from hugwbc.robot import load_robot
from hugwbc.runtime.trace import Trace
from hugwbc.viz.framing import LABEL_COLOURS, Chapter, chapter_spans

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TITLES = {
    "v_x": "Forward velocity v_x",
    "v_y": "Sideways velocity v_y",
    "omega": "Yaw rate ω",
    "l": "Sole clearance, the higher foot, and commanded swing height l",
    "h": "Body height h",
    "p": "Body pitch p",
    "w": "Waist yaw w",
}
_SIZE = (6.0, 2.6)  # [in]
_LETTERS = 95  # of the names of chapters that fit above the axes
_MARGIN = 0.5  # [m] around the paths
SMALLEST_SPAN = 0.2  # shortest vertical axis, in the quantity's unit
# A placeholder that becomes the page's text colour (currentColor) when the picture is written.
INK = "#010203"
_STYLE = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 10,
    "text.color": INK,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "grid.color": INK,
    "grid.alpha": 0.15,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "lines.linewidth": 1.2,
}


@dataclasses.dataclass(frozen=True)
class Panel:
    """One picture."""

    title: str  # title of the picture
    svg: str  # the `<svg>` element, which scales with its container


def tracking_panels(traces: Sequence[Trace], chapters: Sequence[Chapter] = ()) -> list[Panel]:
    """Plot commanded (dashed) and measured velocities, height, pitch and waist, and swing height with sole clearance.

    A command that differs between the runs has their colours. Every other one of the chapters is shaded.
    """
    panels = []
    for name in (*MEASURED_NAMES, "l"):

        def draw(axes: "Axes", name: str = name) -> None:
            for trace, colour in zip(traces, LABEL_COLOURS, strict=False):
                # Lines that lie on each other stay visible, above all the quick ones of the soles.
                measured = trace.clearance.max(axis=1) if name == "l" else trace.measured[:, MEASURED_NAMES.index(name)]
                axes.plot(trace.time, measured, color=colour, alpha=0.75 if name == "l" else 0.9)
            commanded = [_commanded(trace, name) for trace in traces]
            longest = max(commanded, key=len)
            # A behaviour gives each controller its own commands, and so do hands that the body helps.
            shared = all(np.allclose(one, longest[: len(one)], atol=1e-3, equal_nan=True) for one in commanded)
            for trace, one, colour in zip(traces, commanded, LABEL_COLOURS, strict=False):
                if one is longest or not shared:
                    look = {"color": INK if shared else colour, "linestyle": "--", "linewidth": 1.0}
                    axes.plot(trace.time, one, drawstyle="steps-post", **look)
            axes.set_ylabel(COMMAND_UNITS[name])
            low, high = axes.get_ylim()
            missing = max(0.0, SMALLEST_SPAN - (high - low)) / 2  # so that ripples of a constant quantity look small
            axes.set_ylim(low - missing, high + missing)

        panels.append(_time_panel(TITLES[name], draw, traces, chapters))
    return panels


def _commanded(trace: Trace, name: str) -> np.ndarray:
    """Return the commanded values of a run, shape (T,); NaN for a swing height while standing, which has no meaning."""
    values = trace.command[:, COMMAND_NAMES.index(name)]
    return np.where(trace.gait == Gait.STANDING, np.nan, values) if name == "l" else values


def hand_panels(traces: Sequence[Trace], chapters: Sequence[Chapter] = ()) -> list[Panel]:
    """Plot the distance of the left and the right hand to their targets; no panel of one that has none in any run."""
    panels = []
    for index, side in enumerate(("Left", "Right")):
        if not any(np.isfinite(trace.hand_error[:, index]).any() for trace in traces):
            continue

        def draw(axes: "Axes", index: int = index) -> None:
            for trace, colour in zip(traces, LABEL_COLOURS, strict=False):
                axes.plot(trace.time, 100 * trace.hand_error[:, index], color=colour)
            axes.set_ylim(bottom=0.0)
            axes.set_ylabel("cm")

        panels.append(_time_panel(f"{side} hand, distance to its target", draw, traces, chapters))
    return panels


def torque_panels(traces: Sequence[Trace], chapters: Sequence[Chapter] = ()) -> list[Panel]:
    """Plot the torque of the joint nearest to its limit over time, and the RMS torque of every joint."""

    def draw_peak(axes: "Axes") -> None:
        for trace, colour in zip(traces, LABEL_COLOURS, strict=False):
            limit = load_robot(trace.robot).torque_limit
            axes.plot(trace.time, 100 * np.max(np.abs(trace.torque) / limit, axis=1), color=colour)
        axes.set_ylim(0.0, 105.0)
        axes.set_ylabel("% of limit")

    def draw_rms(axes: "Axes") -> None:
        width = 0.8 / len(traces)
        robot = load_robot(traces[0].robot)
        slots = np.arange(len(robot.joint_names))
        for i, (trace, colour) in enumerate(zip(traces, LABEL_COLOURS, strict=False)):
            rms = np.sqrt(np.mean(trace.torque**2, axis=0))
            axes.bar(slots + (i - (len(traces) - 1) / 2) * width, rms, width, color=colour)
        names = [name.removesuffix("_joint").replace("_", " ") for name in robot.joint_names]
        axes.set_xticks(slots, names, rotation=60, ha="right", rotation_mode="anchor", fontsize=8)
        axes.grid(axis="x", visible=False)
        axes.set_ylabel("N·m")

    return [
        _time_panel("Torque of the joint nearest to its limit", draw_peak, traces, chapters),
        Panel("RMS torque of each joint", picture("rms", draw_rms, height=3.4)),
    ]


def _time_panel(
    title: str, draw: Callable[["Axes"], None], traces: Sequence[Trace], chapters: Sequence[Chapter]
) -> Panel:
    def with_time(axes: "Axes") -> None:
        draw(axes)
        axes.set_xlabel("s")
        start, end = (f(trace.time[i] for trace in traces) for f, i in ((min, 0), (max, -1)))
        end = max(end, start + 0.1)
        axes.set_xlim(start, end)
        _shade(axes, chapters, start, end)

    return Panel(title, picture(title, with_time))


def _shade(axes: "Axes", chapters: Sequence[Chapter], start: float, end: float) -> None:
    """Shade every other chapter, and write the names of those that are long enough above the axes."""
    for number, (name, begin, stop) in enumerate(chapter_spans(chapters, start, end)):
        if number % 2:
            axes.axvspan(begin, stop, color=INK, alpha=0.07, linewidth=0.0)
        room = int(_LETTERS * (stop - begin) / (end - start))
        if room >= 3:
            short = name if len(name) <= room else f"{name[: room - 1]}…"
            place = axes.get_xaxis_transform()
            axes.text((begin + stop) / 2, 1.01, short, transform=place, ha="center", va="bottom", fontsize=7)


def path_panel(traces: Sequence[Trace]) -> Panel:
    """Draw the paths of the robots from above, each with a triangle that points ahead at its end; a cross is a fall."""

    def draw(axes: "Axes") -> None:
        # Names of robots that end side by side are readable, and stand in the order of the robots.
        ranks = np.argsort(np.argsort([trace.qpos[-1, 1] for trace in traces])) - (len(traces) - 1) / 2
        for rank, trace, colour in zip(ranks.tolist(), traces, LABEL_COLOURS, strict=False):
            way = trace.qpos[:, :2]
            axes.plot(way[:, 0], way[:, 1], color=colour)
            yaw = float(rotations.yaw_of(trace.qpos[-1, 3:7]))
            ahead: Any = (3, 0, np.degrees(yaw) - 90.0)  # a triangle, turned
            axes.plot(*way[-1], marker="X" if trace.fell else ahead, color=colour, markersize=11)
            place: Any = {"xytext": (10, 11 * rank), "textcoords": "offset points", "va": "center"}
            axes.annotate(trace.name, way[-1], **place, color=colour, fontsize=9)
        axes.plot(0.0, 0.0, "s", color=INK, markersize=4)
        points = np.concatenate([trace.qpos[:, :2] for trace in traces])
        low, high = points.min(axis=0) - _MARGIN, points.max(axis=0) + _MARGIN
        axes.plot(*np.stack((low, high), axis=1), linestyle="none")  # room for the names
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("x, ahead at the start [m]")
        axes.set_ylabel("y, left [m]")

    title = "The ways from above: square start, triangle end and heading, cross fall"
    return Panel(title, picture("ways", draw, height=3.2))


def picture(salt: str, draw: Callable[[Any], Any], height: float = _SIZE[1], **axes: Any) -> str:  # noqa: ANN401
    """Return an `<svg>` element that scales with its container and takes the page's text colour.

    The salt makes the ids in the picture: different for each picture of a page, equal in every run. The height [in] is
    that at a width of 6 in, and `axes` are options of `Figure.add_subplot`.
    """
    text = drawing(salt, lambda figure: draw(figure.add_subplot(**axes)), (_SIZE[0], height), layout="constrained")
    text = text[text.index("<svg") :].replace(INK, "currentColor")
    # Without width and height, the viewBox makes the picture scale with its container.
    opening, rest = text.split(">", 1)
    kept = [part for part in opening.split(" ") if not part.startswith(("width=", "height="))]
    return " ".join(kept) + ">" + rest


def drawing(salt: str, draw: Callable[["Figure"], Any], size: tuple[float, float], **figure: Any) -> str:  # noqa: ANN401
    """Return what is drawn as an SVG file, equal in every run, of a size [in]; `figure` are options of `Figure`."""
    import matplotlib  # here: every verb that knows experiments imports this module, and few draw
    from matplotlib.figure import Figure

    style = cast("Any", {**_STYLE, "svg.hashsalt": salt})
    with matplotlib.rc_context(style):
        drawn = Figure(figsize=size, **figure)
        draw(drawn)
        file = io.StringIO()
        drawn.savefig(file, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    return file.getvalue()

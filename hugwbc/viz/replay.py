"""A self-contained page that replays runs in three dimensions: play, pause, scrub, and choose which marks to show."""

import base64
import html
import pathlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import meshcat
import numpy as np
import umsgpack
from meshcat.animation import Animation, AnimationClip, AnimationTrack
from meshcat.path import Path
from meshcat.servers.zmqserver import VIEWER_ROOT

from hugwbc.robot import load_robot
from hugwbc.runtime.trace import Trace
from hugwbc.viz.framing import (
    LABEL_COLOURS,
    Chapter,
    camera_path,
    chapter_spans,
    check_traces,
    frame_samples,
    lanes,
    snapshot,
    spans,
    title_of,
)
from hugwbc.viz.marks import LAYERS, STANCE, SWING, Mark, in_stance
from hugwbc.viz.meshcat_scene import WORLD, RobotView, Scene, world_offset

FPS = 25
_ROOT = Path(("meshcat",))
# Heights in the gait bar, in the picture's units: of a foot's row, between rows, of the contact line within a row.
ROW, GAP, LINE = 9.0, 3.0, 3.0
CONTACT = "#1c2430"
ARMS = 0.75  # [m], how far a robot reaches to either side of its middle


class _Recorder:
    """A stand-in for meshcat's window that keeps the commands instead of sending them to a server."""

    def __init__(self) -> None:
        self.commands: list[bytes] = []

    def send(self, command: Any) -> None:  # noqa: ANN401  one of meshcat's
        # Single precision halves the size of the page; positions are still exact to a micrometre.
        self.commands.append(umsgpack.packb(command.lower(), force_float_precision="single"))


def replay_html(traces: Sequence[Trace], *, title: str = "hugwbc replay", chapters: Sequence[Chapter] = ()) -> str:
    """Return the page: one to four robots side by side, the first leftmost, in the colours of `LABEL_COLOURS`.

    It loads nothing. The browser interpolates between the frames. The names of the chapters stand on the time axis.
    """
    check_traces(traces)
    recorder = _Recorder()
    robot = load_robot(traces[0].robot)
    names, around = [trace.name for trace in traces], [trace.scene for trace in traces]
    scene = Scene(meshcat.Visualizer(window=recorder), names, robot, around)
    end = max(float(trace.time[-1]) for trace in traces)
    animation = Animation(default_framerate=FPS)
    for view, trace in zip(scene.robots, traces, strict=True):
        samples = frame_samples(trace.time, FPS, end)
        robot = _ROOT.append(WORLD).append(view.path)
        for path, tracks in (*_tracks(view, trace, samples), *_footprint_tracks(view, trace, samples)):
            animation.clips[robot.append(path)] = _clip(tracks)
    centre, distance = camera_path(traces, FPS, end)
    # The camera cannot stand back (see `WORLD`); shrinking the world by the same factor gives the same picture.
    scale = 1.0 / distance[:, None]
    world: Tracks = [
        ("position", "vector3", (scale * world_offset(centre)).tolist()),
        ("scale", "vector3", np.repeat(scale, 3, axis=1).tolist()),
    ]
    animation.clips[_ROOT.append(WORLD)] = _clip(world)
    scene.visualizer.set_animation(animation, play=False, repetitions=1_000_000)
    begin = float(traces[0].time[0])
    strips = {"@GAITS@": gait_bar(traces, begin, end), "@CHAPTERS@": chapter_bar(chapters, begin, end)}
    return _page(recorder.commands, traces, title, strips)


def chapter_bar(chapters: Sequence[Chapter], begin: float, end: float) -> str:
    """Return a row of names below the time axis, each as wide as its chapter; a click goes to its beginning."""
    names = "".join(
        f'<button type="button" data-time="{start - begin:.3f}" title="{html.escape(name)}"'
        f' style="flex-grow:{1000.0 * (stop - start):.0f}">{html.escape(name)}</button>'
        for name, start, stop in chapter_spans(chapters, begin, end)
    )
    return f'<div id="chapters">{names}</div>' if names else ""


Tracks = list[tuple[str, str, list]]


def _clip(tracks: Tracks) -> AnimationClip:
    frames = {name: list(range(len(values))) for name, _, values in tracks}
    return AnimationClip(
        tracks={name: AnimationTrack(name, kind, frames[name], values) for name, kind, values in tracks}, fps=FPS
    )


def _tracks(view: RobotView, trace: Trace, samples: np.ndarray) -> Iterator[tuple[str, Tracks]]:
    """Yield the tracks of what moves, appears or vanishes; place the rest once and for all."""
    frames = [view.at(snapshot(trace, int(sample))) for sample in samples]
    for name in frames[0]:
        marks = [frame[name] for frame in frames]
        shown = np.array([mark.visible for mark in marks])
        if not shown.any():
            view.place(name, marks[0])
            continue
        # A hidden mark stays in its last place: the browser interpolates, and would show it flying to the next one.
        last = np.maximum.accumulate(np.where(shown, np.arange(len(marks)), np.argmax(shown)))
        marks = [marks[index] for index in last]
        view.place(name, marks[0])
        tracks = [] if shown.all() else [("visible", "bool", shown.tolist())]
        tracks += _motion(marks)
        if tracks:
            yield name, tracks


def _motion(marks: Sequence[Mark]) -> Tracks:
    candidates = (
        ("position", "vector3", np.array([mark.position for mark in marks])),
        ("quaternion", "quaternion", np.array([mark.quaternion for mark in marks])[:, [1, 2, 3, 0]]),
        ("scale", "vector3", np.array([mark.scale for mark in marks])),
    )
    return [(name, kind, values.tolist()) for name, kind, values in candidates if np.ptp(values, axis=0).any()]


def _footprint_tracks(view: RobotView, trace: Trace, samples: np.ndarray) -> Iterator[tuple[str, Tracks]]:
    """Yield the tracks of footprints, which appear when a foot comes down and then stay."""
    for number, (time, mark) in enumerate(view.marks.footprints(trace)):
        name = view.add_footprint(number, mark)
        shown = np.arange(len(samples)) / FPS + trace.time[0] >= time
        yield name, [("visible", "bool", shown.tolist())]


def gait_bar(traces: Sequence[Trace], begin: float, end: float) -> str:
    """Return an `<svg>` that shows, foot by foot, the contact by the gait's clock and the measured one.

    Each run has two rows, the left foot over the right one.
    """
    rows = []
    for index, trace in enumerate(traces):
        stance = in_stance(trace.phase, trace.gait, trace.foot_contact)
        rows.append(f"<g><title>{html.escape(trace.name)}</title>")
        for foot in range(2):
            y = (2 * index + foot) * (ROW + GAP)
            rows.append(_box(begin, float(trace.time[-1]), y, ROW, SWING))
            rows += [_box(*span, y, ROW, STANCE) for span in spans(trace.time, stance[:, foot])]
            contacts = spans(trace.time, trace.foot_contact[:, foot])
            rows += [_box(*span, y + 0.5 * (ROW - LINE), LINE, CONTACT) for span in contacts]
        y = 2 * index * (ROW + GAP)
        rows.append(_box(begin - 0.01 * (end - begin), begin, y, 2 * ROW + GAP, LABEL_COLOURS[index]) + "</g>")
    height = 2 * len(traces) * (ROW + GAP)
    view = f"{begin - 0.01 * (end - begin):.3f} 0 {1.01 * (end - begin):.3f} {height:g}"
    return f'<svg viewBox="{view}" preserveAspectRatio="none" style="height:{height:g}px">{"".join(rows)}</svg>'


def _box(start: float, stop: float, y: float, height: float, colour: str) -> str:
    return f'<rect x="{start:.3f}" y="{y:g}" width="{stop - start:.3f}" height="{height:g}" fill="{colour}"/>'


def _page(commands: Sequence[bytes], traces: Sequence[Trace], title: str, strips: Mapping[str, str]) -> str:
    viewer = (pathlib.Path(VIEWER_ROOT) / "main.min.js").read_text(encoding="utf-8")
    data = ",\n".join(f'"{base64.b64encode(command).decode("ascii")}"' for command in commands)
    names = "".join(
        f'<div class="name" style="border-color:{colour}">{html.escape(title_of(trace))}</div>'
        for trace, colour in zip(traces, LABEL_COLOURS, strict=False)
    )
    layers = "".join(
        f'<label><input type="checkbox" id="{layer}" checked> {html.escape(name)}</label>'
        for layer, name in LAYERS.items()
    )
    template = (pathlib.Path(__file__).parent / "replay_page.html").read_text(encoding="utf-8")
    for mark, strip in strips.items():
        template = template.replace(mark, strip)
    half_width = float(np.abs(lanes(len(traces))).max()) + ARMS
    return (
        template.replace("@TITLE@", html.escape(title))
        .replace("@LAYERS@", layers)
        .replace("@COLOURS@", f"--stance: {STANCE}; --swing: {SWING}; --contact: {CONTACT};")
        .replace("@HALF_WIDTH@", f"{half_width:g}")
        .replace("@ROBOTS@", str(len(traces)))
        .replace("@TRUNK@", load_robot(traces[0].robot).trunk)
        .replace("@NAMES@", names)
        .replace("@COMMANDS@", data)
        .replace("@VIEWER@", viewer)
    )

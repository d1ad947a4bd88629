"""A self-contained page that replays one or more runs in three dimensions, with play, pause and scrubbing."""

import base64
import html
import pathlib
from collections.abc import Iterator, Sequence
from typing import Any, Protocol

import meshcat
import numpy as np
import umsgpack
from meshcat.animation import Animation, AnimationClip, AnimationTrack
from meshcat.path import Path
from meshcat.servers.zmqserver import VIEWER_ROOT

from hugwbc.robot import SIDES
from hugwbc.viz.meshcat_scene import WORLD, RobotView, Scene, world_offset
from hugwbc.viz.trace import LABEL_COLOURS, Trace, camera_path, check_traces, frame_samples

FPS = 25
_ROOT = Path(("meshcat",))


class _Command(Protocol):
    def lower(self) -> dict[str, Any]: ...


class _Recorder:
    """Stands where meshcat expects its window, and keeps the commands instead of sending them to a server."""

    def __init__(self) -> None:
        self.commands: list[bytes] = []

    def send(self, command: _Command) -> None:
        # Single precision halves the page; positions keep a micrometre.
        self.commands.append(umsgpack.packb(command.lower(), force_float_precision="single"))


def replay_html(traces: Sequence[Trace], *, title: str = "hugwbc replay", fps: int = FPS) -> str:
    """The page: robots side by side, the first leftmost, in the colours of `LABEL_COLOURS`; needs no network.

    Args:
        traces: 1 to 4 runs.
        title: of the page.
        fps: frames per second of the recording; the browser interpolates between them.

    Raises:
        ConfigError: if there is nothing to draw, or too much.
    """
    check_traces(traces)
    recorder = _Recorder()
    scene = Scene(meshcat.Visualizer(window=recorder), [trace.name for trace in traces])
    end = max(float(trace.time[-1]) for trace in traces)
    animation = Animation(default_framerate=fps)
    for view, trace in zip(scene.robots, traces, strict=True):
        samples = frame_samples(trace.time, fps, end)
        for path, tracks in _robot_tracks(view, trace, samples):
            animation.clips[path] = _clip(tracks, fps)
    centre, distance = camera_path(traces, fps, end)
    # A camera that stands back by a factor sees what this one sees of a world that has shrunk by it.
    scale = 1.0 / distance[:, None]
    world: Tracks = [
        ("position", "vector3", (scale * world_offset(centre)).tolist()),
        ("scale", "vector3", np.repeat(scale, 3, axis=1).tolist()),
    ]
    animation.clips[_ROOT.append(WORLD)] = _clip(world, fps)
    scene.visualizer.set_animation(animation, play=False, repetitions=1_000_000)
    return _page(recorder.commands, traces, title)


def write_replay(path: pathlib.Path, traces: Sequence[Trace], *, title: str = "hugwbc replay", fps: int = FPS) -> None:
    """Write `replay_html` to a file."""
    path.write_text(replay_html(traces, title=title, fps=fps), encoding="utf-8")


Tracks = list[tuple[str, str, list]]


def _clip(tracks: Tracks, fps: int) -> AnimationClip:
    frames = {name: list(range(len(values))) for name, _, values in tracks}
    return AnimationClip(
        tracks={name: AnimationTrack(name, kind, frames[name], values) for name, kind, values in tracks}, fps=fps
    )


def _robot_tracks(view: RobotView, trace: Trace, samples: np.ndarray) -> Iterator[tuple[Path, Tracks]]:
    """Tracks of every link and of both hand targets."""
    placements = [view.placements(trace.qpos[sample]) for sample in samples]
    positions = np.array([position for position, _ in placements])
    quaternions = np.array([quaternion for _, quaternion in placements])[..., [1, 2, 3, 0]]
    robot = _ROOT.append(WORLD).append(view.path)
    for index, link in enumerate(view.links):
        tracks: Tracks = [
            ("position", "vector3", positions[:, index].tolist()),
            ("quaternion", "quaternion", quaternions[:, index].tolist()),
        ]
        yield robot.append(link), tracks
    for index, side in enumerate(SIDES):
        targets = trace.hand_target_world[samples, index]
        shown = np.all(np.isfinite(targets), axis=1)
        if shown.any():
            path = np.where(shown[:, None], targets + view.offset, 0.0)
            yield (
                robot.append(f"target_{side}"),
                [("position", "vector3", path.tolist()), ("visible", "bool", shown.tolist())],
            )


def _page(commands: Sequence[bytes], traces: Sequence[Trace], title: str) -> str:
    viewer = (pathlib.Path(VIEWER_ROOT) / "main.min.js").read_text(encoding="utf-8")
    data = ",\n".join(f'"{base64.b64encode(command).decode("ascii")}"' for command in commands)
    legend = "".join(
        f'<li><span style="background:{colour}"></span>{html.escape(trace.name)}{" (fell)" if trace.fell else ""}</li>'
        for trace, colour in zip(traces, LABEL_COLOURS, strict=False)
    )
    return (
        _TEMPLATE.replace("@TITLE@", html.escape(title))
        .replace("@LEGEND@", legend)
        .replace("@COMMANDS@", data)
        .replace("@VIEWER@", viewer)
    )


_TEMPLATE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>@TITLE@</title>
<style>
  html, body { margin: 0; height: 100%; font: 15px/1.4 system-ui, sans-serif; color: #1c2430; }
  #meshcat-pane { position: fixed; inset: 0; overflow: hidden; }
  .panel { position: fixed; left: 12px; background: #ffffffd9; border-radius: 8px; padding: 8px 12px; }
  #legend { top: 12px; margin: 0; list-style: none; }
  #legend span { display: inline-block; width: 12px; height: 12px; border-radius: 3px; margin-right: 8px; }
  #bar { bottom: 12px; right: 12px; display: flex; gap: 12px; align-items: center; }
  #bar input { flex: 1; min-width: 40px; }
  #bar button { font: inherit; width: 5em; }
  #bar output { font-variant-numeric: tabular-nums; white-space: nowrap; }
</style>
</head>
<body>
<div id="meshcat-pane"></div>
<ul id="legend" class="panel">@LEGEND@</ul>
<div id="bar" class="panel">
  <button id="play" type="button">Play</button>
  <input id="time" type="range" min="0" step="0.01" value="0" aria-label="Time">
  <output id="clock"></output>
</div>
<script>@VIEWER@</script>
<script>
"use strict";
const viewer = new MeshCat.Viewer(document.getElementById("meshcat-pane"));
for (const text of [
@COMMANDS@
]) {
  viewer.handle_command_bytearray(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)));
}
viewer.gui.close();
const animator = viewer.animator;
const play = document.getElementById("play"), slider = document.getElementById("time");
const clock = document.getElementById("clock");
slider.max = animator.duration;
function seek(time) { animator.seek(time); animator.display_progress(time); }
function show(time) {
  slider.value = time;
  clock.textContent = `${time.toFixed(2)} / ${animator.duration.toFixed(2)} s`;
  play.textContent = animator.playing ? "Pause" : "Play";
}
play.addEventListener("click", () => animator.playing ? animator.pause() : animator.play());
slider.addEventListener("input", () => { animator.pause(); seek(Number(slider.value)); });
document.addEventListener("keydown", (event) => {
  if (event.code === "Space" && event.target !== play) { event.preventDefault(); play.click(); }
});
const start = new URLSearchParams(location.search).get("t");
animator.play();
if (start !== null) { animator.pause(); seek(Number(start)); }
(function tick() { show(animator.time); requestAnimationFrame(tick); })();
</script>
</body>
</html>
"""

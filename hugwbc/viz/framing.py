"""Parts that pictures of runs share: colours, lanes, chapters, frames at a fixed rate, and a camera that follows."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from hugwbc.errors import ConfigError
from hugwbc.runtime.trace import SNAPSHOT_FIELDS, Snapshot, Trace

LANE = 1.5  # [m], distance between robots side by side
FRAMED_RADIUS = 1.0  # [m], distance from the point looked at up to which a robot is well in the picture
CAMERA_TIME = 1.0  # [s], length of the moving average that smooths the camera's path
# Readable on light and dark backgrounds, and distinct for people with red-green colour blindness.
LABEL_COLOURS = ("#2f7fd6", "#e0702a", "#8a5bd0", "#1a9c84")


@dataclasses.dataclass(frozen=True)
class Chapter:
    """A stretch of time with a name, such as a segment of a script; it begins at a time [s] and ends with the next."""

    begin: float
    name: str


def chapter_spans(chapters: Sequence[Chapter], begin: float, end: float) -> list[tuple[str, float, float]]:
    """Return name, begin and end [s] of the chapters between two times, cut to them; the last one lasts to the end."""
    shown = [chapter for chapter in chapters if chapter.begin < end]
    ends = [*(chapter.begin for chapter in shown[1:]), end] if shown else []
    return [(c.name, max(c.begin, begin), stop) for c, stop in zip(shown, ends, strict=True) if stop > begin]


def spans(time: np.ndarray, on: np.ndarray) -> list[tuple[float, float]]:
    """Return begin and end of every stretch of samples in which something is on, shape (T,), bool.

    A stretch lasts until the next sample, if there is one.
    """
    changes = np.flatnonzero(np.diff(on, prepend=False, append=False))
    later = np.append(time, time[-1])
    return [(float(time[a]), float(later[b])) for a, b in zip(changes[::2], changes[1::2], strict=True)]


def snapshot(trace: Trace, sample: int) -> Snapshot:
    """Return what a picture of one sample of a run shows."""
    recorded = [name for name in SNAPSHOT_FIELDS if len(getattr(trace, name))]
    return Snapshot(**{name: getattr(trace, name)[sample] for name in recorded})


def title_of(trace: Trace) -> str:
    """Return the name of a run, and whether it fell or knelt down."""
    return f"{trace.name} ({'fell' if trace.fell else 'knelt down'})" if trace.down else trace.name


def check_count(count: int, what: str = "runs to draw") -> None:
    """Refuse a number of runs that a picture cannot show in different colours; `what` they are is for the message."""
    if not 1 <= count <= len(LABEL_COLOURS):
        raise ConfigError(f"{count} {what}; give 1 to {len(LABEL_COLOURS)}")


def check_traces(traces: Sequence[Trace]) -> None:
    """Refuse runs that cannot be drawn."""
    check_count(len(traces))
    for trace in traces:
        if len(trace.time) == 0:
            raise ConfigError(f"the run of '{trace.name}' has no samples; record at least one")
    if len(robots := dict.fromkeys(trace.robot for trace in traces)) > 1:
        raise ConfigError(f"the runs are of {' and '.join(robots)}; give runs of one robot")


def lanes(count: int) -> np.ndarray:
    """Return sideways offsets [m], shape (count,): the first robot is leftmost for a camera ahead of them."""
    return LANE * (np.arange(count) - (count - 1) / 2)


def frame_samples(time: np.ndarray, fps: float, end: float) -> np.ndarray:
    """Return the index of the last sample at or before each frame of a film up to an end [s], shape (frames,).

    The first frame is at the first sample. A run that ended early stays at its last sample.
    """
    frames = time[0] + np.arange(int((end - time[0]) * fps + 1e-6) + 1) / fps
    return np.clip(np.searchsorted(time, frames + 1e-9, side="right") - 1, 0, len(time) - 1)


def camera_path(traces: Sequence[Trace], fps: float, end: float) -> tuple[np.ndarray, np.ndarray]:
    """Return where to look, and from how far, so that all robots stay in the picture until an end [s].

    These are the mean position of the robots in their lanes [m], shape (frames, 2), and the factor, at least 1, by
    which the camera has to stand back because they have drifted apart, shape (frames,). Both paths are smoothed. A run
    that has ended is left behind while another continues.
    """
    samples = [frame_samples(trace.time, fps, end) for trace in traces]
    ways = np.stack([trace.qpos[sample, :2] for trace, sample in zip(traces, samples, strict=True)])
    ways[..., 1] += lanes(len(traces))[:, None]
    frames = traces[0].time[0] + np.arange(ways.shape[1]) / fps
    longest = max(trace.time[-1] for trace in traces)
    running = np.array([(frames <= trace.time[-1]) | (trace.time[-1] == longest) for trace in traces])
    centre = _smooth(np.sum(ways * running[..., None], axis=0) / running.sum(axis=0)[:, None], fps)
    farthest = np.max(np.linalg.norm(ways - centre, axis=-1) * running, axis=0)
    in_picture = max(FRAMED_RADIUS, float(np.abs(lanes(len(traces))).max()))
    return centre, _smooth(np.maximum(1.0, farthest / in_picture)[:, None], fps)[:, 0]


def _smooth(values: np.ndarray, fps: float) -> np.ndarray:
    """Return the moving average of the columns over `CAMERA_TIME`, shape (frames, columns)."""
    from scipy.ndimage import uniform_filter1d  # here: every verb that knows experiments imports this module

    width = 2 * max(1, int(CAMERA_TIME * fps / 2)) + 1
    # The ends are repeated, so that the camera neither starts nor stops short of the robots.
    return uniform_filter1d(values, width, axis=0, mode="nearest")

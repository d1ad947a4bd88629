"""What the pictures need to know of a run, and the colours that tell several runs apart."""

from collections.abc import Sequence

import numpy as np

from hugwbc.errors import ConfigError
from hugwbc.runtime.moment import MOMENT_FIELDS, Moment
from hugwbc.runtime.trace import Trace

LANE = 1.5  # [m] between robots shown side by side
FRAMED_RADIUS = 1.0  # [m] about the point looked at within which robots are well in the picture
CAMERA_TIME = 1.0  # [s] over which the camera's motion is smoothed
# Readable on light and on dark ground, and told apart by people who confuse red and green.
LABEL_COLOURS = ("#2f7fd6", "#e0702a", "#8a5bd0", "#1a9c84")


def moment(trace: Trace, sample: int) -> Moment:
    """What a picture of one sample shows."""
    return Moment(**{name: getattr(trace, name)[sample] for name in MOMENT_FIELDS})


def check_count(runs: int) -> None:
    """Refuse a number of runs, or of controllers, that cannot be told apart in a picture.

    Raises:
        ConfigError: if there is none, or more than there are colours.
    """
    if not 1 <= runs <= len(LABEL_COLOURS):
        raise ConfigError(f"{runs} runs to draw; give 1 to {len(LABEL_COLOURS)}")


def check_traces(traces: Sequence[Trace]) -> None:
    """Refuse what cannot be drawn.

    Raises:
        ConfigError: if there is no trace, more than there are colours, or one without samples.
    """
    check_count(len(traces))
    for trace in traces:
        if len(trace.time) == 0:
            raise ConfigError(f"the run of '{trace.name}' has no samples; record at least one")


def lanes(count: int) -> np.ndarray:
    """Sideways offsets of robots side by side, the first one leftmost when seen from ahead [m], shape (count,)."""
    return LANE * (np.arange(count) - (count - 1) / 2)


def frame_samples(time: np.ndarray, fps: float, end: float) -> np.ndarray:
    """Index of the last sample at or before each frame, from the first sample's time to `end` [s], `fps` a second.

    A run that ended early stays at its last sample.
    """
    frames = time[0] + np.arange(int((end - time[0]) * fps + 1e-6) + 1) / fps
    return np.clip(np.searchsorted(time, frames + 1e-9, side="right") - 1, 0, len(time) - 1)


def camera_path(traces: Sequence[Trace], fps: float, end: float) -> tuple[np.ndarray, np.ndarray]:
    """Where to look, and from how far, so that all robots stay in the picture; smoothed.

    A run that has ended is left behind while another one goes on.

    Returns:
        The mean of the robots, in their lanes, shape (frames, 2) [m]; and by which factor, at least 1, the camera has
        to stand back because they have drifted apart, shape (frames,).
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
    """Moving average of the columns over `CAMERA_TIME`, shape (frames, columns)."""
    half = max(1, int(CAMERA_TIME * fps / 2))
    padded = np.pad(values, ((half, half), (0, 0)), mode="edge")
    kernel = np.full(2 * half + 1, 1 / (2 * half + 1))
    return np.stack([np.convolve(column, kernel, mode="valid") for column in padded.T], axis=1)

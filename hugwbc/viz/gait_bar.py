"""A strip over time that shows, foot by foot, what the gait's clock asked for and when the foot was on the ground."""

import html
import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from hugwbc.viz.framing import LABEL_COLOURS, Trace
from hugwbc.viz.marks import in_stance
from hugwbc.viz.overlays import STANCE, SWING

ROW, GAP, LINE = 9.0, 3.0, 3.0  # of a foot, between feet, of the contact within it, in the picture's units
CONTACT = "#1c2430"


def gait_bar(traces: Sequence[Trace], begin: float, end: float) -> str:
    """An `<svg>` as wide as its container, from `begin` to `end` [s]; two rows for every run, left foot over right."""
    rows = []
    for index, trace in enumerate(traces):
        stance = in_stance(trace.phase, trace.gait, trace.foot_contact)
        rows.append(f"<g><title>{html.escape(trace.name)}</title>")
        for foot in range(2):
            y = (2 * index + foot) * (ROW + GAP)
            for start, stop, on in _runs(trace.time, stance[:, foot]):
                rows.append(_box(start, stop, y, ROW, STANCE if on else SWING))
            for start, stop, on in _runs(trace.time, trace.foot_contact[:, foot]):
                if on:
                    rows.append(_box(start, stop, y + 0.5 * (ROW - LINE), LINE, CONTACT))
        y = 2 * index * (ROW + GAP)
        rows.append(_box(begin - 0.01 * (end - begin), begin, y, 2 * ROW + GAP, LABEL_COLOURS[index]) + "</g>")
    height = 2 * len(traces) * (ROW + GAP)
    view = f"{begin - 0.01 * (end - begin):.3f} 0 {1.01 * (end - begin):.3f} {height:g}"
    return f'<svg viewBox="{view}" preserveAspectRatio="none" style="height:{height:g}px">{"".join(rows)}</svg>'


def _runs(time: np.ndarray, values: np.ndarray) -> Iterator[tuple[float, float, bool]]:
    """Begin, end and value of every stretch of equal values."""
    changes = [0, *(np.flatnonzero(np.diff(values)) + 1).tolist(), len(values)]
    for start, stop in itertools.pairwise(changes):
        yield float(time[start]), float(time[min(stop, len(time) - 1)]), bool(values[start])


def _box(start: float, stop: float, y: float, height: float, colour: str) -> str:
    return f'<rect x="{start:.3f}" y="{y:g}" width="{stop - start:.3f}" height="{height:g}" fill="{colour}"/>'

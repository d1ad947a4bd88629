"""What happened in each segment of a script, where each robot ended, and a sentence that sums up a comparison."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hugwbc import rotations
from hugwbc.commands import COMMAND_UNITS
from hugwbc.evaluation.comparison import HAND_NOTE
from hugwbc.evaluation.metrics import command_errors, hand_travel
from hugwbc.evaluation.tables import Cell, Table
from hugwbc.kinematics import MEASURED_NAMES
from hugwbc.runtime.trace import Trace
from hugwbc.scripts.script import Script

# Differences of errors that somebody would see, in m/s, rad/s, m and rad of the commands, and in m of the hands.
SEEN = {"v_x": 0.01, "v_y": 0.01, "omega": 0.01, "h": 0.003, "p": 0.01, "w": 0.01}
SEEN_BY_HANDS = 0.003
NAMES = {"v_x": "forward speed", "v_y": "sideways speed", "omega": "turning", "h": "height", "p": "pitch",
         "w": "waist"}  # fmt: skip


def segment_spans(script: Script) -> list[tuple[str, float, float]]:
    """Return label, begin and end of every segment [s]."""
    ends = np.cumsum([segment.duration for segment in script.segments]).tolist()
    return [(s.label, b, e) for s, b, e in zip(script.segments, [0.0, *ends[:-1]], ends, strict=True)]


def segment_table(script: Script, traces: Sequence[Trace]) -> Table:
    """Return a table with a row for each segment: hand errors after arrival, and the command with the largest error."""
    reaching = any(np.isfinite(trace.hand_error).any() for trace in traces)
    parts = ("largest error", "hands there [cm]", "hands on the way [cm]", "on the way for [s]")[: 4 if reaching else 1]
    rows: list[list[Cell]] = []
    for label, begin, end in segment_spans(script):
        row: list[Cell] = [f"{label} ({begin:g} to {end:g} s)"]
        for trace in traces:
            kept = (trace.time >= begin - 1e-9) & (trace.time < end - 1e-9)
            if not kept.any():
                row += [f"fell at {trace.survived_s:.1f} s", None, None, None][: len(parts)]
                continue
            fell = trace.fell and begin <= trace.survived_s < end
            errors = command_errors(trace)[kept].mean(axis=0)
            worst = int(np.argmax(errors / _SCALES))
            hands = hand_travel(trace, kept)
            text = f"{NAMES[MEASURED_NAMES[worst]]} {errors[worst]:.2f} {COMMAND_UNITS[MEASURED_NAMES[worst]]}"
            cells: list[Cell] = [
                f"{text}, fell at {trace.survived_s:.1f} s" if fell else text,
                _centimetres(hands["arrived"]), _centimetres(hands["travelling"]), hands["travel_time"] or None,
            ]  # fmt: skip
            row += cells[: len(parts)]
        rows.append(row)
    columns = ["", *(f"{trace.name}: {part}" for trace in traces for part in parts)]
    return Table("Segment by segment", columns, rows, HAND_NOTE if reaching else "")


# What counts as an equally large error in each measured command, to name the largest one.
_SCALES = np.array([0.5, 0.5, 0.8, 0.1, 0.2, 0.4])


def _centimetres(value: float | None) -> float | None:
    return None if value is None else 100.0 * value


def pose_table(traces: Sequence[Trace]) -> Table:
    """Return a table of where each robot was at its last sample, in the world, and how far from the first one's."""
    rows: list[list[Cell]] = []
    first = _pose(traces[0])
    for trace in traces:
        x, y, yaw = _pose(trace)
        apart = math.hypot(x - first[0], y - first[1])
        turned = math.degrees(math.remainder(yaw - first[2], 2.0 * math.pi))
        fate = f"fell after {trace.survived_s:.1f} s" if trace.fell else f"up for {trace.survived_s:.1f} s"
        other: list[Cell] = [None, None] if trace is traces[0] else [apart, round(turned, 1)]
        rows.append([trace.name, fate, round(x, 3), round(y, 3), round(math.degrees(yaw), 1), *other])
    columns = ("", "fate", "x [m]", "y [m]", "heading [°]", f"from {traces[0].name} [m]", "turned against it [°]")
    return Table("Where they ended", columns, rows)


def _pose(trace: Trace) -> tuple[float, float, float]:
    x, y = trace.qpos[-1, :2].tolist()
    return x, y, float(rotations.yaw_of(trace.qpos[-1, 3:7]))


def headline(controllers: Mapping[str, Mapping[str, Any]]) -> str:
    """Return what became of every controller, and the smallest and the largest error of each kind that differs.

    It reads the "controllers" of `comparison.comparison_summary`.
    """
    fates: dict[str, list[str]] = {}
    for name, figures in controllers.items():
        fates.setdefault(_fate(figures), []).append(name)
    text = "; ".join(f"{_listed(names)} {fate}" for fate, names in fates.items())
    kinds = [(NAMES[k], {n: f["errors"][k] for n, f in controllers.items()}, k, 1.0) for k in NAMES]
    kinds.append(("hands once there", {n: f["hand_travel"]["arrived"] for n, f in controllers.items()}, "", 100.0))
    parts = []
    for words, errors, command, scale in kinds:
        known = sorted((e, name) for name, e in errors.items() if e is not None and math.isfinite(e))
        if known and known[-1][0] - known[0][0] >= SEEN.get(command, SEEN_BY_HANDS):
            (least, best), (most, worst) = known[0], known[-1]
            unit = COMMAND_UNITS.get(command, "cm")
            parts.append(f"{words} {scale * least:.2g} ({best}) to {scale * most:.2g} {unit} ({worst})")
    return f"{text}. Mean errors: {', '.join(parts)}." if parts else f"{text}."


def _fate(figures: Mapping[str, Any]) -> str:
    if figures["fell"]:
        return f"fell after {figures['survived_s']:.1f} s"
    if "verdict" not in figures:
        ending = f" ({figures['ending']})" if "ending" in figures else ""
        return f"stayed up for {figures['survived_s']:.1f} s{ending}"
    verdict = figures["verdict"]
    return f"did the task in {figures['survived_s']:.1f} s" if verdict["success"] else f"did not ({verdict['reason']})"


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"

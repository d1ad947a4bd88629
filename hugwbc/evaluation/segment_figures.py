"""What happened in each segment of a script, where each robot ended, and a sentence that compares them."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from hugwbc import rotations
from hugwbc.commands import COMMAND_NAMES, COMMAND_UNITS
from hugwbc.evaluation.comparison import Outcome
from hugwbc.evaluation.tables import Cell, Table
from hugwbc.kinematics import MEASURED_NAMES
from hugwbc.runtime.trace import Trace
from hugwbc.scripts.script import Script

ARRIVED = 0.05  # [m]; a hand that came this close to its target has arrived
JUMP = 0.1  # [m]; a target that moves by more between two samples is a new one, to which the hand has to travel
CLEARLY = 0.85  # an error below this share of another one is clearly smaller
# ... unless nobody would see the difference: in m/s, rad/s, m and rad of the commands, and in m of the hands.
SEEN = {"v_x": 0.01, "v_y": 0.01, "omega": 0.01, "h": 0.003, "p": 0.01, "w": 0.01}
SEEN_BY_HANDS = 0.003
NAMES = {"v_x": "forward speed", "v_y": "sideways speed", "omega": "turning", "h": "height", "p": "pitch",
         "w": "waist"}  # fmt: skip
ARRIVAL_NOTE = (
    f"A hand travels to a new target until it is within {100 * ARRIVED:.0f} cm of it for the first time; from then on "
    "it has arrived. Means over both hands."
)


def arrived(trace: Trace) -> np.ndarray:
    """Return whether each hand had arrived at its present target, shape (T, 2), bool; False without a target."""
    found = np.zeros(trace.hand_error.shape, dtype=bool)
    for side in range(2):
        error, target = trace.hand_error[:, side], trace.hand_target_world[:, side]
        there = False
        for sample in range(len(error)):
            if not np.isfinite(error[sample]):
                there = False
                continue
            if sample and np.linalg.norm(target[sample] - target[sample - 1]) > JUMP:
                there = False
            there = there or bool(error[sample] <= ARRIVED)
            found[sample, side] = there
    return found


@dataclasses.dataclass(frozen=True)
class HandTravel:
    """The hands' errors apart from the way there.

    Attributes:
        travelling: mean error before arrival [m]; None if the hands never travelled.
        arrived: mean error after arrival [m]; None if no hand arrived.
        travel_time: time that the hands travelled, mean of both [s].
    """

    travelling: float | None
    arrived: float | None
    travel_time: float


def hand_travel(trace: Trace, kept: np.ndarray | None = None) -> HandTravel:
    """Return the hands' errors before and after arrival.

    Args:
        trace: the run.
        kept: samples that count, shape (T,), bool; None for all.
    """
    there = arrived(trace)
    counts = np.isfinite(trace.hand_error) & (np.ones(len(there), dtype=bool) if kept is None else kept)[:, None]
    away = counts & ~there
    period = float(np.median(np.diff(trace.time))) if len(trace.time) > 1 else 0.0
    return HandTravel(
        _mean(trace.hand_error[away]), _mean(trace.hand_error[counts & there]), float(away.sum()) / 2.0 * period
    )


def _mean(values: np.ndarray) -> float | None:
    return float(values.mean()) if values.size else None


def segment_spans(script: Script) -> list[tuple[str, float, float]]:
    """Return label, begin and end of every segment [s]."""
    ends = np.cumsum([segment.duration for segment in script.segments]).tolist()
    return [(s.label, b, e) for s, b, e in zip(script.segments, [0.0, *ends[:-1]], ends, strict=True)]


def segment_table(script: Script, traces: Sequence[Trace]) -> Table:
    """Return a table with a row for each segment: hand errors after arrival, and the command with the largest error.

    Args:
        script: the script that was played.
        traces: the runs, at least one.
    """
    rows: list[list[Cell]] = []
    for label, begin, end in segment_spans(script):
        row: list[Cell] = [f"{label} ({begin:g} to {end:g} s)"]
        for trace in traces:
            kept = (trace.time >= begin - 1e-9) & (trace.time < end - 1e-9)
            if not kept.any():
                row += [f"fell at {trace.survived_s:.1f} s", None, None, None]
                continue
            fell = trace.fell and begin <= trace.survived_s < end
            errors = np.abs(_errors(trace)[kept]).mean(axis=0)
            worst = int(np.argmax(errors / _SCALES))
            hands = hand_travel(trace, kept)
            text = f"{NAMES[MEASURED_NAMES[worst]]} {errors[worst]:.2f} {COMMAND_UNITS[MEASURED_NAMES[worst]]}"
            row += [
                f"{text}, fell at {trace.survived_s:.1f} s" if fell else text,
                _centimetres(hands.arrived), _centimetres(hands.travelling), hands.travel_time or None,
            ]  # fmt: skip
        rows.append(row)
    parts = ("largest error", "hands there [cm]", "hands on the way [cm]", "on the way for [s]")
    columns = ["", *(f"{trace.name}: {part}" for trace in traces for part in parts)]
    return Table("Segment by segment", columns, rows, ARRIVAL_NOTE)


# What counts as an equally large error in each measured command, to name the largest one.
_SCALES = np.array([0.5, 0.5, 0.8, 0.1, 0.2, 0.4])


def _errors(trace: Trace) -> np.ndarray:
    columns = [COMMAND_NAMES.index(name) for name in MEASURED_NAMES]
    return trace.measured - trace.command[:, columns]


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


def verdict(outcomes: Mapping[str, Outcome], traces: Sequence[Trace]) -> str:
    """Return a sentence: who stayed up, and who followed which command clearly better in this run.

    Args:
        outcomes: figures by the controller's name, at least one.
        traces: the runs, in the same order.
    """
    fates = {
        name: f"fell after {outcome.survived_s:.1f} s" if outcome.fell else f"stayed up for {outcome.survived_s:.1f} s"
        for name, outcome in outcomes.items()
    }
    if len(set(fates.values())) == 1 and len(fates) > 1:
        parts = [f"{'Both' if len(fates) == 2 else 'All'} {next(iter(fates.values()))}"]
    else:
        parts = [", ".join(f"{name} {fate}" for name, fate in fates.items())]
    if len(outcomes) > 1:
        wins = _wins(outcomes)
        parts += [f"{name} followed {_listed(won)} clearly better" for name, won in wins.items() if won]
        parts += _hands(traces)
    return "; ".join(parts) + "."


def _wins(outcomes: Mapping[str, Outcome]) -> dict[str, list[str]]:
    """Return the commands that each controller followed clearly better than every other one."""
    wins: dict[str, list[str]] = {name: [] for name in outcomes}
    for command, words in NAMES.items():
        errors = {name: outcome.errors[command] for name, outcome in outcomes.items()}
        ranked = sorted((error, name) for name, error in errors.items() if math.isfinite(error))
        if len(ranked) > 1 and ranked[0][0] < min(CLEARLY * ranked[1][0], ranked[1][0] - SEEN[command]):
            wins[ranked[0][1]].append(words)
    return wins


def _hands(traces: Sequence[Trace]) -> list[str]:
    """Compare how close the hands stayed once they had arrived."""
    found = sorted((error, trace.name) for trace in traces if (error := hand_travel(trace).arrived) is not None)
    if not found:
        return []
    if len(found) < len(traces):
        return [f"only the hands of {_listed([name for _, name in found])} arrived"]
    (best, name), (second, other) = found[0], found[1]
    near = f"{100 * best:.1f} cm against {100 * second:.1f} cm"
    if best < min(CLEARLY * second, second - SEEN_BY_HANDS):
        return [f"{name}'s hands were nearer to their targets once there ({near} of {other})"]
    return [f"the hands were equally near to their targets once there ({name} {near} of {other})"]


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"

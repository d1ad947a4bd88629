"""Compare controllers on one script, behaviour or task: play it with each, and sum up every run and its segments."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from hugwbc.behaviours import Behaviour, BehaviourSource
from hugwbc.behaviours.source import LONGEST
from hugwbc.commands import COMMAND_UNITS, MEASURED_NAMES
from hugwbc.controller import Controller
from hugwbc.evaluation import metrics
from hugwbc.evaluation.tables import Cell, Table
from hugwbc.runtime.rollout import rollout
from hugwbc.runtime.trace import Trace
from hugwbc.scripts.script import Script
from hugwbc.sim import Arena, Scene
from hugwbc.tasks import Task, run_task
from hugwbc.upper_ik import UpperBodySource

Progress = Callable[[float], object]
# Figures of `metrics.hand_travel` with their labels and scales, for tables.
HAND_ROWS = (
    ("arrived", "hand error once there, mean [cm]", 100.0),
    ("arrived_p95", "hand error once there, 95th percentile [cm]", 100.0),
    ("travelling", "hand error on the way, mean [cm]", 100.0),
    ("travel_time", "hands on the way [s]", 1.0),
)
HAND_NOTE = (
    f"A hand travels to a new target until it is within {100 * metrics.ARRIVED:.0f} cm of it for the first time; from "
    "then on it is there. Means over the hands that have targets."
)


def summarise(trace: Trace) -> dict[str, Any]:
    """Return the figures of one run.

    - `fate`: how it ended, in words; `survived_s`: time until the fall, or the duration of the script [s].
    - `errors`: mean absolute error of v_x, v_y, omega, h, p, w over all samples of the record, ramps included.
    - `hand_error_m`, `hand_travel`: those of `metrics.hand_errors` and `metrics.hand_travel`.
    - `tick_ms`, `ik_ms`: p50 and p99 of the time of a call of the controller and of the hand IK [ms]; None without one.
    - `footsteps`: number of touch-downs of both feet.
    - `problems`: what went wrong with the objects, such as one that left the world.
    """
    return {
        "fell": trace.fell,
        "fate": trace.fate,
        "survived_s": trace.survived_s,
        "errors": metrics.tracking_errors(trace, settle=0.0),
        "hand_error_m": metrics.hand_errors(trace.hand_error, trace.reachable),
        "hand_travel": metrics.hand_travel(trace),
        "tick_ms": metrics.percentiles(trace.tick_ms),
        "ik_ms": metrics.percentiles(trace.ik_ms),
        "steps": trace.steps,
        "footsteps": sum(times.size for times in trace.touch_downs),
        "safety": dataclasses.asdict(trace.safety),
        "problems": trace.problems,
    }


@dataclasses.dataclass(frozen=True, eq=False)
class Played:
    """One run of a comparison."""

    trace: Trace  # its record, under the label of the controller
    # the figures of `summarise`; of a task also its verdict and what was gripped, of a behaviour how it ended
    outcome: dict[str, Any]


def compare(
    controllers: Mapping[str, Controller],
    played: Script | Behaviour | Task,
    *,
    seed: int = 0,
    arena: Arena | None = None,
    scene: Scene | None = None,
    on_progress: Progress | None = None,
) -> list[Played]:
    """Play a script, a behaviour or a task with each controller in turn, each in an equal simulation of its own.

    Args:
        controllers: controllers by their labels.
        played: what to play.
        seed: of the sensor noise, and of what varies in the scene.
        arena: robot, drives, sensors and ground; None for the default.
        scene: objects around the robot; a task has its own.
        on_progress: called with the fraction of the work that is done.
    """
    arena, runs = arena or Arena(), []
    for index, (label, controller) in enumerate(controllers.items()):

        def advance(fraction: float, done: int = index) -> None:
            if on_progress is not None:
                on_progress((done + fraction) / len(controllers))

        if isinstance(played, Task):
            simulation = arena.simulation(seed=seed, scene=played.scene)
            run = run_task(played, controller, simulation, on_progress=advance, strict=False)
            verdict = {**dataclasses.asdict(run.verdict), "seconds": run.seconds}
            trace, further = run.trace, {"verdict": verdict, "gripped": run.record.gripped}
        else:
            source = played if isinstance(played, Script) else BehaviourSource(played)
            behaviour = source if isinstance(source, BehaviourSource) else None
            trace = rollout(
                controller,
                source,
                arena.simulation(seed=seed, scene=scene),
                UpperBodySource(robot=arena.known_robot),
                duration=_longest(played),
                on_progress=advance,
                until=None if behaviour is None else lambda behaviour=behaviour: behaviour.done,
                strict=False,
            )
            further = {} if behaviour is None else {"ending": behaviour.ending}
        runs.append(Played(dataclasses.replace(trace, name=label), summarise(trace) | further))
    return runs


def _longest(script: Script | Behaviour) -> float:
    """Return how long a script lasts, or a behaviour at most [s]."""
    return script.duration if isinstance(script, Script) else LONGEST


def comparison_summary(
    played: Script | Behaviour | Task,
    outcomes: Mapping[str, Mapping[str, Any]],
    *,
    seed: int = 0,
    arena: Arena | None = None,
    scene: str | None = None,
) -> dict[str, Any]:
    """Return a comparison as JSON: what was played, in which scene, and the figures by the controller's label."""
    if isinstance(played, Task):
        about = {"task": played.name, "limit": played.limit}
    else:
        name = played.name if isinstance(played, Script) else getattr(played, "__name__", "behaviour")
        about = {"script": name, "scene": scene, "duration": _longest(played)}
    return {**about, "seed": seed, "arena": dataclasses.asdict(arena or Arena()), "controllers": dict(outcomes)}


def figure_table(outcomes: Mapping[str, Mapping[str, Any]]) -> Table:
    """Return a table with a row for each figure, verdicts of a task on top, and a column for each controller."""
    first = next(iter(outcomes.values()))
    rows: list[tuple[Any, ...]] = []

    def add(label: str, value: Callable[[Mapping[str, Any]], Any]) -> None:
        rows.append((label, *map(value, outcomes.values())))

    if "verdict" in first:
        add("task done", lambda outcome: outcome["verdict"]["success"])
        add("why not", lambda outcome: outcome["verdict"]["reason"] or None)
        add("score", lambda outcome: outcome["verdict"]["score"])
        add("idealised gripper", lambda outcome: ", ".join(outcome["gripped"]) or None)
    if "ending" in first:
        add("behaviour", lambda outcome: outcome["ending"])
    add("fell", lambda outcome: outcome["fell"])
    add("survived [s]", lambda outcome: outcome["survived_s"])
    for name in first["errors"]:
        add(f"error {name} [{COMMAND_UNITS[name]}]", lambda outcome, name=name: outcome["errors"][name])
    for part, label, scale in HAND_ROWS:
        values = [outcome["hand_travel"][part] for outcome in outcomes.values()]
        rows.append((label, *(None if value is None else scale * value for value in values)))
    add("part of targets that the IK calls reachable", lambda outcome: outcome["hand_error_m"]["reachable_fraction"])
    for field, label in (("tick_ms", "tick"), ("ik_ms", "hand IK")):
        for part in ("p50", "p99"):
            add(f"{label} {part} [ms]", lambda outcome, field=field, part=part: outcome[field][part])
    add("control steps", lambda outcome: outcome["steps"])
    add("footsteps", lambda outcome: outcome["footsteps"])
    return Table("Figures", ("", *outcomes), rows, HAND_NOTE)


# Smallest differences of errors that somebody would see: of the commands [m/s, rad/s, m, rad], and of the hands.
SEEN = {"v_x": 0.01, "v_y": 0.01, "omega": 0.01, "h": 0.003, "p": 0.01, "w": 0.01}
SEEN_BY_HANDS, SEEN_ON_THE_WAY = 0.003, 0.5  # [m], [s]
NAMES = {"v_x": "forward speed", "v_y": "sideways speed", "omega": "turning", "h": "height", "p": "pitch",
         "w": "waist"}  # fmt: skip


def segment_spans(script: Script) -> list[tuple[str, float, float]]:
    """Return label, begin and end of every segment [s]."""
    ends = np.cumsum([segment.duration for segment in script.segments]).tolist()
    return [(s.label, b, e) for s, b, e in zip(script.segments, [0.0, *ends[:-1]], ends, strict=True)]


def segment_table(script: Script, traces: Sequence[Trace]) -> Table:
    """Return a table with a row for each segment: the command with the largest error, and the errors of the hands."""
    reaching = any(np.isfinite(trace.hand_error).any() for trace in traces)
    parts = ("largest error", "hands there [cm]", "hands on the way [cm]", "on the way for [s]")[: 4 if reaching else 1]
    rows: list[list[Cell]] = []
    for label, begin, end in segment_spans(script):
        row: list[Cell] = [f"{label} ({begin:g} to {end:g} s)"]
        for trace in traces:
            kept = (trace.time >= begin - 1e-9) & (trace.time < end - 1e-9)
            if not kept.any():
                over = trace.fell and trace.survived_s <= begin + 1e-9
                row += [f"fell at {trace.survived_s:.1f} s" if over else None, None, None, None][: len(parts)]
                continue
            fell = trace.fell and begin <= trace.survived_s < end
            errors = metrics.command_errors(trace)[kept].mean(axis=0)
            worst = int(np.argmax(errors / _SCALES))
            hands = metrics.hand_travel(trace, kept)
            text = f"{NAMES[MEASURED_NAMES[worst]]} {errors[worst]:.2f} {COMMAND_UNITS[MEASURED_NAMES[worst]]}"
            cells: list[Cell] = [
                f"{text}, fell at {trace.survived_s:.1f} s" if fell else text,
                _centimetres(hands["arrived"]), _centimetres(hands["travelling"]), hands["travel_time"] or None,
            ]  # fmt: skip
            row += cells[: len(parts)]
        rows.append(row)
    columns = ["", *(f"{trace.name}: {part}" for trace in traces for part in parts)]
    return Table("Segment by segment", columns, rows)


# What counts as an equally large error in each measured command, to name the largest one.
_SCALES = np.array([0.5, 0.5, 0.8, 0.1, 0.2, 0.4])


def _centimetres(value: float | None) -> float | None:
    return None if value is None else 100.0 * value


def headline(controllers: Mapping[str, Mapping[str, Any]]) -> str:
    """Return what became of every controller, and the smallest and the largest error of each kind that differs.

    It reads the "controllers" of `comparison_summary`. Errors up to a fall are marked as such. Beside the hands' error
    once there stands how long they were on the way: a hand that never arrives has no such error.
    """
    fates: dict[str, list[str]] = {}
    for name, figures in controllers.items():
        fates.setdefault(_fate(figures), []).append(name)
    text = "; ".join(f"{_listed(names)} {fate}" for fate, names in fates.items())
    kinds = [(NAMES[k], {n: f["errors"][k] for n, f in controllers.items()}, SEEN[k], COMMAND_UNITS[k]) for k in NAMES]
    hands = {n: f["hand_travel"] for n, f in controllers.items()}
    there = {n: _centimetres(found["arrived"]) for n, found in hands.items()}
    kinds.append(("hands once there", there, 100.0 * SEEN_BY_HANDS, "cm"))
    kinds.append(("on the way", {n: found["travel_time"] for n, found in hands.items()}, SEEN_ON_THE_WAY, "s"))
    whose, parts = {n: f"{n}, until its fall" if f["fell"] else n for n, f in controllers.items()}, []
    for words, errors, seen, unit in kinds:
        known = sorted((e, name) for name, e in errors.items() if e is not None and math.isfinite(e))
        if known and known[-1][0] - known[0][0] >= seen:
            (least, best), (most, worst) = known[0], known[-1]
            parts.append(f"{words} {least:.2g} ({whose[best]}) to {most:.2g} {unit} ({whose[worst]})")
    return f"{text}. Mean errors: {', '.join(parts)}." if parts else f"{text}."


def _fate(figures: Mapping[str, Any]) -> str:
    if figures["fell"] or "verdict" not in figures:
        ending = f" ({figures['ending']})" if "ending" in figures and not figures["fell"] else ""
        return f"{figures['fate']}{ending}"
    verdict = figures["verdict"]
    return f"did the task in {verdict['seconds']:.1f} s" if verdict["success"] else f"did not ({verdict['reason']})"


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"

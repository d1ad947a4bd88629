"""The figures of every protocol's result, and what each table of the report is about."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from hugwbc.evaluation.engine import CellResult
from hugwbc.evaluation.intervals import Estimate, bootstrap_mean, wilson_percentage
from hugwbc.evaluation.paper import ERROR_NAMES, ERROR_UNITS, other_controllers
from hugwbc.evaluation.protocols.robustness import GRID_UNITS, NOMINAL
from hugwbc.evaluation.protocols.tour import WAYPOINTS, blow_outcomes
from hugwbc.report import ablation
from hugwbc.report.figures import Figure, falls_figure

FORCES = {"constant": "constant", "second": "for one second"}
# Of a row of the effort protocol: name, unit, and factor to that unit.
EFFORTS = {
    "power": ("mechanical power", "W", 1.0),
    "cost_of_transport": ("cost of transport", "", 1.0),
    "torque_rms": ("torque, RMS, of the busiest joint", "% of limit", 100.0),
    "torque_peak": ("torque, peak", "% of limit", 100.0),
    "joint_speed_peak": ("joint speed, peak", "% of limit", 100.0),
    "torque_rate": ("change of torques, RMS", "N·m/s", 1.0),
    "tick_p50_ms": ("time of a call, median", "ms", 1.0),
    "tick_p99_ms": ("time of a call, 99th percentile", "ms", 1.0),
}


@dataclasses.dataclass(frozen=True)
class Section:
    """A part of the report.

    Attributes:
        title: heading.
        protocols: whose tables belong here.
        text: how its figures are measured.
    """

    title: str
    protocols: tuple[str, ...]
    text: str


def single_command_figures(measured: CellResult) -> list[Figure]:
    """Tracking errors of single commands; walking with the figures that the paper prints for other controllers."""
    result, name = measured.result, measured.controller
    table = f"Single command, {result['gait']}"
    figures = []
    for error in ERROR_NAMES:
        errors = [row["error"] for row in result["rows"] if row["error_name"] == error]
        paper = result["paper"].get(error)
        if errors or paper is not None:
            figures.append(Figure(table, error, ERROR_UNITS[error], name, bootstrap_mean(errors), paper))
    return [*figures, falls_figure(table, name, result["rows"])]


def published_figures() -> list[Figure]:
    """What the paper prints for other controllers: published, not measured here."""
    table = "Single command, walking"
    return [
        Figure(table, error, ERROR_UNITS[error], name, None, published=value)
        for name, errors in other_controllers().items()
        for error, value in errors.items()
    ]


def ramp_figures(measured: CellResult) -> list[Figure]:
    """Errors of p and w on the ramp."""
    result, name = measured.result, measured.controller
    table = f"Ramp, {result['gait']}"
    figures = [
        Figure(
            table,
            f"E_{command}",
            "rad",
            name,
            bootstrap_mean([row["error"] for row in result["rows"] if row["command"] == command]),
            result["paper"].get(f"E_{command}"),
        )
        for command in ("p", "w")
    ]
    return [*figures, falls_figure(table, name, result["rows"])]


def disturbance_figures(measured: CellResult) -> list[Figure]:
    """Largest force that is tolerated by direction, with the bracket that the search ended in."""
    result, figures = measured.result, []
    for kind, forces in result["tolerated"].items():
        table = f"Tolerated force, {FORCES[kind]}"
        for direction, force in forces.items():
            estimate = Estimate(force, force, result["refused"][kind][direction], result["rollouts"])
            figures.append(Figure(table, f"{direction}°", "N", measured.controller, estimate, higher_is_better=True))
    return figures


def heatmap_figures(measured: CellResult) -> list[Figure]:
    """In what part of the other commands' ranges a command is tracked as well as alone, mean over the others."""
    result, figures = measured.result, []
    table = f"Orthogonality, {result['gait']}"
    for command in dict.fromkeys(entry["tracked"] for entry in result["orthogonality"]):
        shares = [100.0 * entry["share"] for entry in result["orthogonality"] if entry["tracked"] == command]
        estimate = Estimate(sum(shares) / len(shares), None, None, len(shares))
        name = f"error of {command}"
        figures.append(Figure(table, name, "% of ranges", measured.controller, estimate, higher_is_better=True))
    return [*figures, falls_figure(table, measured.controller, result["rows"])]


def relative_maps(result: Mapping[str, Any]) -> dict[tuple[str, str], np.ndarray]:
    """For every ordered pair of commands the first one's error relative to its error alone; NaN in a fall.

    A map has a row for each value of the first command and a column for each of the second, both rising.
    """
    maps = {}
    for entry in result["maps"]:
        for first, second in ((entry["first"], entry["second"]), (entry["second"], entry["first"])):
            errors = np.array(entry["errors"][first], dtype=float)
            single = result["single"][first] or math.nan
            maps[first, second] = (errors if first == entry["first"] else errors.T) / single
    return maps


def tour_figures(measured: CellResult) -> list[Figure]:
    """How far tours went, and how near to their waypoints."""
    result, name = measured.result, measured.controller
    table, rows = f"Tour with blows, {result['gait']}", result["rows"]
    upright = wilson_percentage([not row["fell"] for row in rows])
    blows = wilson_percentage([up for row in rows for up in blow_outcomes(row["blows"], row["felled"])])
    reached = bootstrap_mean([100.0 * row["reached"] / WAYPOINTS for row in rows])
    return [
        Figure(table, "completed", "% of tours", name, upright, higher_is_better=True),
        Figure(table, "blows survived", "% of blows", name, blows, higher_is_better=True),
        Figure(table, "waypoints reached", "%", name, reached, higher_is_better=True),
        Figure(table, "survived", "s", name, bootstrap_mean([r["survived_s"] for r in rows]), higher_is_better=True),
        Figure(table, "position error", "m", name, bootstrap_mean([row["position_error"] for row in rows])),
        Figure(table, "yaw error", "rad", name, bootstrap_mean([row["yaw_error"] for row in rows])),
    ]


def robustness_figures(measured: CellResult) -> list[Figure]:
    """What every difference of the robot costs: error relative to the unchanged robot's, and falls."""
    result, name = measured.result, measured.controller
    title, ratios, falls = f"Robustness, {result['gait']}", [], []
    for level in result["levels"]:
        factor = level["factor"]
        label = factor if factor == NOMINAL else f"{factor} {level['level']:g} {GRID_UNITS.get(factor, '')}".strip()
        rows = [r for r in result["rows"] if (r["factor"], r["level"]) == (factor, level["level"])]
        estimate = Estimate(level["ratio"], None, None, len(rows))
        ratios.append(Figure(f"{title}: error over the unchanged robot's", label, "", name, estimate))
        fell = wilson_percentage([row["fell"] for row in rows])
        falls.append(Figure(f"{title}: falls", label, "% of episodes", name, fell))
    return [*ratios[1:], *falls]


def effort_figures(measured: CellResult) -> list[Figure]:
    """What motion costs, a table for each speed."""
    result, figures = measured.result, []
    for row in result["rows"]:
        table = f"Effort, {result['gait']}, {row['v_x']:g} m/s"
        for field, (quantity, unit, factor) in EFFORTS.items():
            if row[field] is not None:
                estimate = Estimate(factor * row[field], None, None, 1)
                figures.append(Figure(table, quantity, unit, measured.controller, estimate))
        figures.append(falls_figure(table, measured.controller, [row]))
    return figures


def contacts_figures(measured: CellResult) -> list[Figure]:
    """In what part of the time each foot does what the clock says."""
    result, name = measured.result, measured.controller
    parts = [None if row["agreement"] is None else 100.0 * row["agreement"] for row in result["rows"]]
    table, quantity = "Contacts that agree with the clock", str(result["gait"]).replace("_", " ")
    return [Figure(table, quantity, "%", name, bootstrap_mean(parts), higher_is_better=True)]


FIGURES: Mapping[str, Callable[[CellResult], list[Figure]]] = {
    "single-command": single_command_figures,
    "intervention": ablation.intervention_figures,
    "foot-displacement": ablation.foot_displacement_figures,
    "heatmap": heatmap_figures,
    "disturbance": disturbance_figures,
    "ramp": ramp_figures,
    "tour": tour_figures,
    "robustness": robustness_figures,
    "effort": effort_figures,
    "contacts": contacts_figures,
}

SECTIONS: Sequence[Section] = (
    Section(
        "Single commands",
        ("single-command",),
        "One command is sampled over its range, the others are at their defaults. Foot commands (f, l) are judged "
        "over complete gait cycles, the others over control steps. HOVER and ExBody are as the paper prints them, not "
        "run here.",
    ),
    Section(
        "Intervention",
        ("intervention",),
        "The same while the arms are moved from outside. A policy stands beside the paper's that was trained with the "
        "same: noise, motions or nothing; a controller that was not trained beside the one trained with noise. Where "
        "there is no policy of ours, the paper's figures stand alone. The paper's motions are recorded from people, "
        "ours are generated or given.",
    ),
    Section(
        "Foot displacement",
        ("foot-displacement",),
        "Length of both feet's paths of a robot that is to stand for 20 s; episodes with a fall are left out of the "
        "length and counted.",
    ),
    Section(
        "Pairs of commands",
        ("heatmap",),
        "Every pair of commands over the ranges of both. Maps: the error of one command (rows) against another one "
        "(columns), both rising to the right and up, relative to its error when it is scanned alone; crosses are "
        "falls. Table: the part of the other commands' ranges, about their defaults, in which the error stays within "
        "1.5 times that; the paper shows maps, and has no such number.",
    ),
    Section(
        "Disturbance tolerance",
        ("disturbance",),
        "Largest force at the torso of a standing robot with at least 98 % survival, from its front (0°) to its left "
        "(90°), found by bisection; the interval is the bracket in which the search ended. The paper prints a figure "
        "without numbers.",
    ),
    Section(
        "Ramp",
        ("ramp",),
        "p and w go from minimum to maximum, every run on a robot with other friction, payload and gains. The paper's "
        "figures are of its real robot, ours of simulation.",
    ),
    Section(
        "Tour with blows",
        ("tour",),
        "60 s over 12 waypoints, the arms moved by noise, one blow of 0.08 s a leg on a random link; the strongest "
        "changes the velocity as much as 600 N do that of a G1: 1.4 m/s. A waypoint is reached within 0.5 m. A blow is "
        "survived if the robot does not fall within 3 s; the intervals of completion and of blows are score intervals.",
    ),
    Section(
        "Robustness",
        ("robustness",),
        "One thing at a time differs from the robot that the controllers know. Errors are relative to the unchanged "
        "robot's on the same commands, without the episodes with a fall, which are counted.",
    ),
    Section(
        "Effort",
        ("effort",),
        "What the motion costs; of a robot that fell there are times alone. They are those of the machine that made "
        "this report, with whatever else ran on it.",
    ),
    Section(
        "Contacts",
        ("contacts",),
        "When each foot is on the ground (bars) and the clock of the commanded gait (curves: high in stance). The "
        "clock is shifted in time to where it agrees best: a controller starts it when it is ready.",
    ),
)


def all_figures(results: Sequence[CellResult]) -> list[Figure]:
    """The figures of all results, ordered as the sections are."""
    figures = []
    for section in SECTIONS:
        for measured in results:
            if measured.protocol in section.protocols:
                figures += FIGURES[measured.protocol](measured)
        if section.protocols == ("single-command",) and figures:
            figures += published_figures()
    return [*figures, *ablation.unmeasured_figures(results)]

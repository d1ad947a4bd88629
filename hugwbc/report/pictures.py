"""The report's pictures of each protocol, from its results."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from hugwbc import gait as gaits
from hugwbc.evaluation.engine import CellResult
from hugwbc.evaluation.protocols.contacts import clock_phases
from hugwbc.evaluation.protocols.robustness import GRID_UNITS
from hugwbc.gait import Gait
from hugwbc.report.sections import FORCES, relative_maps
from hugwbc.runtime.trace import RECORD_PERIOD
from hugwbc.viz import charts as pictures
from hugwbc.viz.framing import LABEL_COLOURS
from hugwbc.viz.plots import Panel

_SHOWN_S = 2.0  # [s] of a gait diagram


class Drawn(Protocol):
    """What pictures are drawn of: a `report_page.Report` has these attributes and more."""

    @property
    def results(self) -> Sequence[CellResult]:
        """The protocols' results."""
        ...

    @property
    def controllers(self) -> Sequence[str]:
        """Labels, in the order of the colours."""
        ...


def _gait_diagrams(report: Drawn) -> list[Panel]:
    """Contacts and clock of the first episode of each gait and controller."""
    panels = []
    for measured in report.results:
        if measured.protocol != "contacts":
            continue
        row: Mapping[str, Any] = measured.result["rows"][0]
        contact = np.array([row["left"], row["right"]], dtype=bool).T[: round(_SHOWN_S / RECORD_PERIOD)]
        title = f"{row['gait']}, {measured.controller}{' (fell)' if row['fell'] else ''}".replace("_", " ")
        if not len(contact):
            continue
        clock = gaits.clock(clock_phases(Gait.parse(row["gait"]), row["frequency"], row["offset"], len(contact)))
        time = RECORD_PERIOD * np.arange(len(contact))
        colour = LABEL_COLOURS[list(report.controllers).index(measured.controller) % len(LABEL_COLOURS)]
        panels.append(pictures.gait_diagram(title, time, contact, clock, colour, _SHOWN_S))
    return panels


def _tolerated_forces(report: Drawn) -> list[Panel]:
    """Force over direction, a picture for each kind of force."""
    results = {r.controller: r.result["tolerated"] for r in report.results if r.protocol == "disturbance"}
    kinds = dict.fromkeys(kind for tolerated in results.values() for kind in tolerated)
    panels = []
    for kind in kinds:
        directions = list(dict.fromkeys(d for tolerated in results.values() for d in tolerated[kind]))
        # Controllers without a result keep their place, so that the colours are the same on the whole page.
        found = {name: results.get(name, {}).get(kind, {}) for name in report.controllers}
        series = {name: [forces.get(d) for d in directions] for name, forces in found.items()}
        angles = [math.radians(float(d)) for d in directions]
        panels.append(pictures.polar(f"Tolerated force, {FORCES[kind]}", angles, series, "N"))
    return panels


def _ramps(report: Drawn) -> list[Panel]:
    """Measured over commanded value, mean over the runs, of each gait and command."""
    results = [result for result in report.results if result.protocol == "ramp"]
    panels = []
    for gait in dict.fromkeys(result.result["gait"] for result in results):
        for command in ("p", "w"):
            found = {r.controller: _mean_curve(r.result["rows"], command) for r in results if r.result["gait"] == gait}
            nothing = (np.zeros(0), np.zeros(0))
            series = {name: found.get(name, nothing) for name in report.controllers}
            commanded = np.unique(np.concatenate([x for x, _ in series.values()]))
            labels = (f"commanded {command} [rad]", "measured [rad]")
            panels.append(pictures.curves(f"{command}, {gait}", series, labels, dashed=(commanded, commanded)))
    return panels


def _mean_curve(rows: Sequence[Mapping[str, Any]], command: str) -> tuple[np.ndarray, np.ndarray]:
    """Commanded values, and the mean of what the runs that got there measured."""
    curves = [row["curve"] for row in rows if row["command"] == command]
    values = sorted({float(value) for curve in curves for value in curve})
    means = [float(np.mean([m for c in curves for v, m in c.items() if float(v) == value])) for value in values]
    return np.array(values), np.array(means)


def _heat_maps(report: Drawn) -> list[Panel]:
    """All pairs of commands, a picture for each gait and controller."""
    panels = []
    for measured in report.results:
        if measured.protocol == "heatmap":
            result = measured.result
            title, names = f"{result['gait']}, {measured.controller}", list(result["values"])
            panels.append(pictures.heat_maps(title, names, relative_maps(result), "times the error alone"))
    return panels


def _robustness(report: Drawn) -> list[Panel]:
    """Error over what differs, a picture for each gait and factor."""
    panels = []
    results = [result for result in report.results if result.protocol == "robustness"]
    for gait in dict.fromkeys(result.result["gait"] for result in results):
        found = {r.controller: r.result["levels"] for r in results if r.result["gait"] == gait}
        for factor in dict.fromkeys(level["factor"] for levels in found.values() for level in levels[1:]):
            series = {name: _levels(found.get(name, ()), factor) for name in report.controllers}
            extent = np.concatenate([x for x, _ in series.values()])
            one = (np.array([extent.min(), extent.max()]), np.ones(2))
            labels = (f"{factor} {GRID_UNITS.get(factor, '')}".strip(), "times the error")
            panels.append(pictures.curves(f"{factor}, {gait}", series, labels, dashed=one, bottom=0.0))
    return panels


def _levels(levels: Sequence[Mapping[str, Any]], factor: str) -> tuple[np.ndarray, np.ndarray]:
    """Values of a factor in rising order, and the relative errors."""
    mine = sorted((level["level"], level["ratio"]) for level in levels if level["factor"] == factor)
    return np.array([x for x, _ in mine]), np.array([math.nan if y is None else y for _, y in mine])


def _transport(report: Drawn) -> list[Panel]:
    """Cost of transport over executed speed, a picture for each gait that moves."""
    panels = []
    results = [result for result in report.results if result.protocol == "effort"]
    for gait in dict.fromkeys(result.result["gait"] for result in results):
        series = {}
        for name in report.controllers:
            rows = [
                row for r in results if (r.controller, r.result["gait"]) == (name, gait) for row in r.result["rows"]
            ]
            points = [(row["speed"], row["cost_of_transport"]) for row in rows if row["cost_of_transport"] is not None]
            series[name] = (np.array([x for x, _ in points]), np.array([y for _, y in points]))
        if any(len(x) for x, _ in series.values()):
            panels.append(pictures.curves(f"Cost of transport, {gait}", series, ("m/s", ""), bottom=0.0))
    return panels


# By protocol; what is not here has tables only.
PICTURES: Mapping[str, Callable[[Drawn], list[Panel]]] = {
    "heatmap": _heat_maps,
    "disturbance": _tolerated_forces,
    "ramp": _ramps,
    "robustness": _robustness,
    "effort": _transport,
    "contacts": _gait_diagrams,
}

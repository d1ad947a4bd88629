"""Calibration of a policy by feed-forward: what to request from it, so that it executes the command."""

import dataclasses
import json
import math
import operator
import pathlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from hugwbc.commands import command_ranges
from hugwbc.files import finite_json, write_whole
from hugwbc.gait import Gait
from hugwbc.learned.config import CalibrationConfig
from hugwbc.learned.policy import POLICY_FILE, load_policy, save_policy
from hugwbc.learned.policy.contract import LARGEST_CHANGE, Curves
from hugwbc.robot import Robot

ROUNDS = "rounds.json"
_TRIAL = "trial.safetensors"
_DECIMALS = 4

Errors = dict[str, dict[str, list[float | None]]]
"""Commanded minus executed value by gait, command and knot; None where the robot fell."""
Executed = Callable[[pathlib.Path, list[dict[str, Any]], CalibrationConfig], list[dict[str, float]]]
"""Returns what a policy executes under some commands, one episode each: means by name, NaN after a fall."""


def knots_of(config: CalibrationConfig, robot: Robot) -> Curves:
    """Return curves that change nothing: each gait and command that has a range, at knots spread evenly over it."""
    curves: Curves = {}
    for label in config.gaits:
        gait = Gait.parse(label)
        for name in config.commands:
            low, high = command_ranges(gait, robot)[name].finishing
            if low < high and not (gait is Gait.STANDING and name == "l"):
                knots = np.linspace(low, high, config.knots).round(_DECIMALS).tolist()
                curves.setdefault(label, {})[name] = [[knot, knot] for knot in knots]
    return curves


def corrected(curves: Curves, errors: Errors, rate: float, robot: Robot) -> Curves:
    """Return curves in which a fraction of the measured errors is taken out.

    No value outside a command's range is asked for, where the policy was never trained; but higher swings are, which
    the network does not read (`Contract.read`).

    Args:
        curves: pairs of command and what to ask for.
        errors: what was measured with these curves.
        rate: the fraction.
        robot: whose ranges count.
    """
    result: Curves = {}
    for label, of_gait in curves.items():
        ranges = command_ranges(Gait.parse(label), robot)
        for name, pairs in of_gait.items():
            (low, high), limit = ranges[name].finishing, LARGEST_CHANGE[name]
            high = math.inf if name == "l" else high
            new = []
            for (knot, asked), error in zip(pairs, errors[label][name], strict=True):
                wanted = asked if error is None else asked + rate * error
                valid = min(max(wanted, low, knot - limit), high, knot + limit)
                new.append([knot, round(valid, _DECIMALS)])
            result.setdefault(label, {})[name] = new
    return result


def calibrate(
    config: CalibrationConfig, folder: pathlib.Path, executed: Executed, on_round: Callable[[int, float], None]
) -> dict[str, float | None]:
    """Measure a policy at every knot, correct its curves, and keep at each knot what gave the smallest error.

    Finished rounds are in the folder: an interrupted calibration continues after them.

    Args:
        config: the settings.
        folder: folder of the calibrated policy.
        executed: runs the policy in the arena.
        on_round: called with the number of each round and the mean error.

    Returns:
        Mean errors by gait, command, and "uncalibrated" or "calibrated".
    """
    controller = load_policy(config.policy, threads=None)
    robot = controller.contract.described

    def write(name: str, curves: Curves) -> None:
        contract = dataclasses.replace(controller.contract, feed_forward=curves)
        save_policy(folder / name, controller.actor, contract, controller.training)

    place = folder / ROUNDS
    rounds: list[tuple[Curves, Errors]] = json.loads(place.read_text()) if place.exists() else []
    for number in range(len(rounds), config.rounds + 1):
        curves = corrected(*rounds[-1], config.rate, robot) if rounds else knots_of(config, robot)
        write(_TRIAL, curves)
        errors = _errors(config, folder / _TRIAL, curves, executed)
        rounds.append((curves, errors))
        write_whole(place, json.dumps(rounds, indent=1) + "\n")
        on_round(number, _mean([error for of_gait in errors.values() for found in of_gait.values() for error in found]))
    kept, figures = _best_curves(rounds)
    write(POLICY_FILE, kept)
    (folder / _TRIAL).unlink(missing_ok=True)
    return figures


def _errors(config: CalibrationConfig, policy: pathlib.Path, curves: Curves, executed: Executed) -> Errors:
    """Measure every knot of every curve, gait by gait."""
    errors: Errors = {}
    for label, of_gait in curves.items():
        places = [(name, pair[0]) for name, pairs in of_gait.items() for pair in pairs]
        found = executed(policy, [{"gait": label, name: knot} for name, knot in places], config)
        for (name, knot), values in zip(places, found, strict=True):
            error = knot - values.get(name, math.nan)
            errors.setdefault(label, {}).setdefault(name, []).append(error if math.isfinite(error) else None)
    return errors


def _mean(errors: Sequence[float | None]) -> float:
    """Return the mean size of the errors without those of falls; NaN if all fell."""
    sizes = [abs(error) for error in errors if error is not None]
    return float(np.mean(sizes)) if sizes else math.nan


def _best_curves(rounds: Sequence[tuple[Curves, Errors]]) -> tuple[Curves, dict[str, float | None]]:
    """Return at each knot the value with the smallest error; where the robot always fell, the command itself."""
    kept: Curves = {}
    figures: dict[str, float] = {}
    first, before = rounds[0]
    for label, of_gait in first.items():
        for name, pairs in of_gait.items():
            chosen, left = [], []
            for index, knot in enumerate(pairs):
                tried = [(errors[label][name][index], curves[label][name][index]) for curves, errors in rounds]
                known = [(abs(error), pair) for error, pair in tried if error is not None]
                error, pair = min(known, key=operator.itemgetter(0), default=(None, knot))
                chosen.append(pair)
                left.append(error)
            kept.setdefault(label, {})[name] = chosen
            figures[f"{label}/{name}/uncalibrated"] = _mean(before[label][name])
            figures[f"{label}/{name}/calibrated"] = _mean(left)
    return kept, finite_json(figures)

"""Calibration of a policy by feed-forward: what to request from it, so that it executes the command."""

import dataclasses
import json
import math
import pathlib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hugwbc.commands import command_ranges
from hugwbc.files import finite_json, write_whole
from hugwbc.gait import Gait
from hugwbc.learned.config import CalibrationConfig
from hugwbc.learned.policy import load_policy, save_policy
from hugwbc.learned.policy.feed_forward import LARGEST_CHANGE, Curves

ROUNDS = "rounds.json"
_TRIAL = "trial.safetensors"
_DECIMALS = 4

Errors = dict[tuple[str, str, int], float]
Executed = Callable[[pathlib.Path, list[dict[str, Any]], CalibrationConfig], list[dict[str, float]]]
"""Returns what a policy executes under some commands, one episode each: means by name, NaN after a fall."""


def knots_of(config: CalibrationConfig) -> Curves:
    """Return curves that change nothing: each gait and command that has a range, at knots spread evenly over it."""
    curves: Curves = {}
    for label in config.gaits:
        gait = Gait.parse(label)
        for name in config.commands:
            low, high = command_ranges(gait)[name].finishing
            if low < high and not (gait is Gait.STANDING and name == "l"):
                knots = np.linspace(low, high, config.knots).round(_DECIMALS).tolist()
                curves.setdefault(label, {})[name] = [[knot, knot] for knot in knots]
    return curves


def corrected(curves: Curves, errors: Errors, rate: float) -> Curves:
    """Return curves in which a fraction of the measured errors is taken out.

    Args:
        curves: pairs of command and what to ask for.
        errors: commanded minus executed value by gait, command and number of the knot; NaN where the robot fell.
        rate: the fraction.
    """
    result: Curves = {}
    for label, of_gait in curves.items():
        for name, pairs in of_gait.items():
            new = []
            for index, (knot, asked) in enumerate(pairs):
                error = errors.get((label, name, index), math.nan)
                change = asked - knot + (rate * error if math.isfinite(error) else 0.0)
                limit = LARGEST_CHANGE[name]
                new.append([knot, round(knot + min(max(change, -limit), limit), _DECIMALS)])
            result.setdefault(label, {})[name] = new
    return result


def calibrate(
    config: CalibrationConfig, folder: pathlib.Path, executed: Executed, on_round: Callable[[int, float], None]
) -> dict[str, float | None]:
    """Measure a policy at every knot, correct its curves, and keep those that made the mean error smaller.

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

    def write(name: str, curves: Curves) -> None:
        contract = dataclasses.replace(controller.contract, feed_forward=curves)
        save_policy(folder / name, controller.actor, contract, controller.training)

    place = folder / ROUNDS
    rounds: list[dict[str, Any]] = json.loads(place.read_text()) if place.exists() else []
    curves = rounds[-1]["next"] if rounds else knots_of(config)
    for number in range(len(rounds), config.rounds + 1):
        write(_TRIAL, curves)
        errors = _errors(config, folder / _TRIAL, curves, executed)
        means = {f"{label}/{name}": _mean_error(errors, label, name) for label in curves for name in curves[label]}
        following = corrected(curves, errors, config.rate)
        rounds.append({"curves": curves, "means": finite_json(means), "next": following})
        write_whole(place, json.dumps(rounds, indent=1) + "\n")
        curves = following
        on_round(number, float(np.nanmean([*means.values()])) if np.isfinite([*means.values()]).any() else math.nan)
    kept, figures = _best_curves(rounds)
    write("policy.safetensors", kept)
    (folder / _TRIAL).unlink(missing_ok=True)
    return figures


def _errors(config: CalibrationConfig, policy: pathlib.Path, curves: Curves, executed: Executed) -> Errors:
    """Measure every knot of every curve, gait by gait."""
    errors: Errors = {}
    for label, of_gait in curves.items():
        places = [(name, index, pair[0]) for name, pairs in of_gait.items() for index, pair in enumerate(pairs)]
        found = executed(policy, [{"gait": label, name: knot} for name, _, knot in places], config)
        for (name, index, knot), values in zip(places, found, strict=True):
            errors[label, name, index] = knot - values.get(name, math.nan)
    return errors


def _mean_error(errors: Mapping[tuple[str, str, int], float], label: str, name: str) -> float:
    found = [abs(error) for key, error in errors.items() if key[:2] == (label, name)]
    return float(np.mean(found)) if found and all(map(math.isfinite, found)) else math.nan


def _best_curves(rounds: list[dict[str, Any]]) -> tuple[Curves, dict[str, float | None]]:
    """Return for each curve the one with the smallest mean error, without those where none was smaller than before."""
    kept: Curves = {}
    figures: dict[str, float | None] = {}
    for key, before in rounds[0]["means"].items():
        label, _, name = key.partition("/")
        known = [(one["means"][key], index) for index, one in enumerate(rounds) if one["means"][key] is not None]
        value, best = min(known, default=(None, 0))
        if best > 0:
            kept.setdefault(label, {})[name] = rounds[best]["curves"][label][name]
        figures |= {f"{key}/uncalibrated": before, f"{key}/calibrated": value}
    return kept, figures

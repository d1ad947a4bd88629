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
from hugwbc.learned.policy.contract import LARGEST_CHANGE, MOST_STOP, Curves
from hugwbc.robot import Robot

ROUNDS = "rounds.json"
_TRIAL = "trial.safetensors"
_DECIMALS = 4
# Where large values made a robot fall, the share of its largest safe one that is kept: other robots fall earlier.
_SAFE = 0.85

Errors = dict[str, dict[str, list[float | None]]]
"""Commanded minus executed value by gait, command and knot; None where the robot fell."""
Round = tuple[Curves, Errors]
"""What was asked for, and what was measured with it."""
Executed = Callable[[pathlib.Path, list[dict[str, Any]], CalibrationConfig], list[dict[str, float]]]
"""Returns what a policy executes under some commands, one episode each: means by name, NaN after a fall."""


@dataclasses.dataclass(frozen=True)
class Arena:
    """What a calibration measures in the arena.

    Attributes:
        executed: what a policy executes under some commands.
        stop: by how much a stop moves the robot (`Contract.stop`).
    """

    executed: Executed
    stop: Callable[[pathlib.Path, CalibrationConfig], tuple[float, float, float]]


def knots_of(config: CalibrationConfig, robot: Robot) -> Curves:
    """Return curves that change nothing, for each gait and command with a range, at knots spread evenly over it."""
    curves: Curves = {}
    for label in config.gaits:
        gait = Gait.parse(label)
        for name in config.commands:
            low, high = command_ranges(gait, robot)[name].finishing
            if low < high and not (gait is Gait.STANDING and name == "l"):
                knots = np.linspace(low, high, config.knots).round(_DECIMALS).tolist()
                curves.setdefault(label, {})[name] = [[knot, knot] for knot in knots]
    return curves


def corrected(rounds: Sequence[Round], rate: float, robot: Robot) -> Curves:
    """Return curves in which a fraction of the errors of the last round is taken out.

    No value outside a command's range is asked for, where the policy was never trained; but higher swings are, which
    the network does not read (`Contract.read`). Where values above the largest with which the robot stayed up made it
    fall, no more is asked for than the middle between that value and the least of those above it.

    Args:
        rounds: what was asked for and measured so far.
        rate: the fraction.
        robot: the robot whose ranges count.
    """
    result: Curves = {}
    curves, errors = rounds[-1]
    for label, of_gait in curves.items():
        ranges = command_ranges(Gait.parse(label), robot)
        for name, pairs in of_gait.items():
            (low, high), limit = ranges[name].finishing, LARGEST_CHANGE[name]
            high = math.inf if name == "l" else high
            new = []
            for (knot, asked), error in zip(pairs, errors[label][name], strict=True):
                wanted = asked if error is None else asked + rate * error
                valid = min(max(wanted, low, knot - limit), high, knot + limit)
                stood, fell = _bracket(rounds, label, name, valid)
                size = min(abs(valid), 0.5 * (stood + fell))
                new.append([knot, round(math.copysign(size, valid), _DECIMALS)])
            result.setdefault(label, {})[name] = new
    return result


def _bracket(rounds: Sequence[Round], label: str, name: str, value: float) -> tuple[float, float]:
    """Return the largest value asked for with which the robot stayed up, and the least above it with which it fell.

    They are sizes of the values that have the sign of `value`. The second is infinite if no larger one made it fall;
    both are infinite if it never stayed up.
    """
    tried = [
        (abs(asked), error is None)
        for curves, errors in rounds
        for (_, asked), error in zip(curves[label][name], errors[label][name], strict=True)
        if asked * value > 0.0
    ]
    stood = max((size for size, fell in tried if not fell), default=math.inf)
    return stood, min((size for size, fell in tried if fell and size > stood), default=math.inf)


def calibrate(
    config: CalibrationConfig, folder: pathlib.Path, arena: Arena, on_round: Callable[[int, float], None]
) -> dict[str, float | None]:
    """Measure a policy at every knot, correct its curves, and keep at each knot what gave the smallest error.

    Then measure by how much a stop moves the robot, if walks are calibrated. Finished rounds are in the folder: an
    interrupted calibration continues after them.

    Args:
        config: the settings.
        folder: folder of the calibrated policy.
        arena: runs the policy.
        on_round: called after each round with its number, 0 for the curves that change nothing, and the mean absolute
            error over all commands.

    Returns:
        Mean absolute errors by "GAIT/COMMAND/uncalibrated" and "GAIT/COMMAND/calibrated"; None without any.
    """
    controller = load_policy(config.policy, threads=None)
    robot = controller.contract.described

    def write(name: str, curves: Curves, stop: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        before = controller.contract.feed_forward  # gaits and commands that are not calibrated keep theirs
        every = before | {label: before.get(label, {}) | of_gait for label, of_gait in curves.items()}
        contract = dataclasses.replace(controller.contract, feed_forward=every, stop=stop)
        save_policy(folder / name, controller.actor, contract, controller.training)

    place = folder / ROUNDS
    rounds: list[Round] = json.loads(place.read_text()) if place.exists() else []
    for number in range(len(rounds), config.rounds + 1):
        curves = corrected(rounds, config.rate, robot) if rounds else knots_of(config, robot)
        write(_TRIAL, curves)
        errors = _errors(config, folder / _TRIAL, curves, arena.executed)
        rounds.append((curves, errors))
        write_whole(place, json.dumps(rounds, indent=1) + "\n")
        on_round(number, _mean([error for of_gait in errors.values() for found in of_gait.values() for error in found]))
    kept, figures = _best_curves(rounds)
    write(_TRIAL, kept)
    stop = controller.contract.stop
    if Gait.WALKING.label in config.gaits:
        x, y, turn = np.clip(arena.stop(folder / _TRIAL, config), np.negative(MOST_STOP), MOST_STOP).tolist()
        stop = x, y, turn
    write(POLICY_FILE, kept, stop)
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
    """Return the mean absolute error without the knots at which the robot fell; NaN if it fell at all of them."""
    sizes = [abs(error) for error in errors if error is not None]
    return float(np.mean(sizes)) if sizes else math.nan


def _best_curves(rounds: Sequence[Round]) -> tuple[Curves, dict[str, float | None]]:
    """Return at each knot the value with the smallest error, or the command itself if the robot fell with all of them.

    Where values above the largest with which it stayed up made it fall, no value is above `_SAFE` of that largest one.
    Also return the mean errors, as `calibrate` does.
    """
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
                stood, fell = _bracket(rounds, label, name, pair[1])
                if math.isfinite(fell) and abs(pair[1]) > _SAFE * stood:
                    error, pair = None, [knot[0], round(math.copysign(_SAFE * stood, pair[1]), _DECIMALS)]
                chosen.append(pair)
                left.append(error)
            kept.setdefault(label, {})[name] = chosen
            figures[f"{label}/{name}/uncalibrated"] = _mean(before[label][name])
            figures[f"{label}/{name}/calibrated"] = _mean(left)
    return kept, finite_json(figures)

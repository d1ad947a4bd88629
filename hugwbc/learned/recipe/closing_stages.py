"""The stages that train nothing: calibration of the student, evaluation at the report seed, export."""

import dataclasses
import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from hugwbc.commands import command_ranges
from hugwbc.files import finite_json, write_whole
from hugwbc.gait import Gait
from hugwbc.learned.policy import load_policy, save_policy
from hugwbc.learned.policy.feed_forward import LARGEST_CHANGE, Curves
from hugwbc.learned.recipe.recipe_records import (
    FIGURES,
    POLICY,
    TAKEN_BY_NAME,
    CalibrationSettings,
    EvaluationSettings,
    ExportSettings,
)
from hugwbc.learned.recipe.stage_work import Outcome, StageWork, read_state, write_state

CALIBRATION, ONNX, TRIAL = "calibration.json", "policy.onnx", "trial.safetensors"
UNCALIBRATED = "figures_uncalibrated.json"
_DECIMALS = 4


# Calibration ----------------------------------------------------------------------------------------------------------


def knots_of(settings: CalibrationSettings) -> Curves:
    """Return curves that change nothing: each gait and command that has a range, at knots spread evenly over it."""
    curves: Curves = {}
    for label in settings.gaits:
        gait = Gait.parse(label)
        for name in settings.commands:
            low, high = command_ranges(gait)[name].finishing
            if low < high and not (gait is Gait.STANDING and name == "l"):
                knots = np.linspace(low, high, settings.knots).round(_DECIMALS).tolist()
                curves.setdefault(label, {})[name] = [[knot, knot] for knot in knots]
    return curves


def corrected(curves: Curves, errors: Mapping[tuple[str, str, int], float], rate: float) -> Curves:
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


def run_calibration(work: StageWork) -> Outcome:
    """Measure a policy at every knot, correct its curves, and keep those that made the mean error smaller.

    Raises:
        StoppedError: if the run was asked to stop.
    """
    settings: CalibrationSettings = work.stage.config()
    controller = load_policy(work.inputs["policy"], threads=None)

    def write(name: str, curves: Curves) -> None:
        contract = dataclasses.replace(controller.contract, feed_forward=curves)
        save_policy(work.folder / name, controller.actor, contract, controller.training)

    state = read_state(work.folder) or {"rounds": []}
    curves = state["rounds"][-1]["next"] if state["rounds"] else knots_of(settings)
    for number in range(len(state["rounds"]), settings.rounds + 1):
        write(TRIAL, curves)
        errors = _errors(work, settings, curves)
        following = corrected(curves, errors, settings.rate)
        means = {f"{label}/{name}": _mean_error(errors, label, name) for label in curves for name in curves[label]}
        state["rounds"].append({"curves": curves, "means": finite_json(means), "next": following})
        write_state(work.folder, state)
        curves = following
        known = [value for value in means.values() if math.isfinite(value)]
        work.say(
            f"{work.stage.name}: round {number} of {settings.rounds}, mean error {np.mean(known or [math.nan]):.4f}"
        )
    kept, figures = _best_curves(state["rounds"])
    write(POLICY, kept)
    (work.folder / TRIAL).unlink(missing_ok=True)
    content = {
        "meaning": "what to ask the policy for, by gait and command: feed-forward, measured once",
        "curves": kept,
    }
    write_whole(work.folder / CALIBRATION, json.dumps({**content, "mean errors": figures}, indent=1) + "\n")
    flat = {f"{name}/{when}": value for name, pair in figures.items() for when, value in pair.items()}
    return Outcome(figures={name: value for name, value in flat.items() if value is not None}, seeds=(settings.seed,))


def _errors(work: StageWork, settings: CalibrationSettings, curves: Curves) -> dict[tuple[str, str, int], float]:
    """Measure every knot of every curve, gait by gait."""
    errors: dict[tuple[str, str, int], float] = {}
    for label, of_gait in curves.items():
        places = [(name, index, pair[0]) for name, pairs in of_gait.items() for index, pair in enumerate(pairs)]
        commands = [{"gait": label, name: knot} for name, _, knot in places]
        found = work.services.executed(work.folder / TRIAL, commands, settings, work.workers or 1)
        work.session.work(episodes=len(found))
        for (name, index, knot), executed in zip(places, found, strict=True):
            errors[label, name, index] = knot - executed.get(name, math.nan)
        work.stop.check()
    return errors


def _mean_error(errors: Mapping[tuple[str, str, int], float], label: str, name: str) -> float:
    own = [abs(error) for key, error in errors.items() if key[:2] == (label, name)]
    return float(np.mean(own)) if own and all(map(math.isfinite, own)) else math.nan


def _best_curves(rounds: list[dict[str, Any]]) -> tuple[Curves, dict[str, dict[str, float | None]]]:
    """Return for each curve the one with the smallest mean error, without those where none was smaller than before."""
    kept: Curves = {}
    figures: dict[str, dict[str, float | None]] = {}
    for key, before in rounds[0]["means"].items():
        label, _, name = key.partition("/")
        known = [(one["means"][key], index) for index, one in enumerate(rounds) if one["means"][key] is not None]
        value, best = min(known, default=(None, 0))
        if best > 0:
            kept.setdefault(label, {})[name] = rounds[best]["curves"][label][name]
        figures[key] = {"uncalibrated": before, "calibrated": value}
    return kept, figures


# Evaluation -----------------------------------------------------------------------------------------------------------


def run_evaluation(work: StageWork) -> Outcome:
    """Run all tables at the report seed; finished episodes are not run again.

    Raises:
        StoppedError: if the run was asked to stop.
    """
    settings: EvaluationSettings = work.stage.config()
    done: list[dict[str, Any]] = (read_state(work.folder) or {"tables": []})["tables"]
    seconds = [work.services.simulated_seconds(table) for table in work.stage.tables]
    passed = sum(seconds[: len(done)])

    def on_episode() -> None:
        work.session.work(episodes=1)
        work.stop.check()

    for index, table in enumerate(work.stage.tables):
        if index >= len(done):
            result = work.services.run_table(
                work.inputs["policy"],
                table,
                seed=settings.seed,
                workers=work.workers or settings.workers,
                folder=work.folder / "results",
                on_episode=on_episode,
            )
            done.append({"table": dict(table), "result": {k: v for k, v in result.items() if k != "rows"}})
            write_state(work.folder, {"tables": done})
            passed += seconds[index]
            work.say(f"{work.stage.name}: {_title(table)}, {result.get('falls')} falls")
        work.progress(passed / max(sum(seconds), 1e-9))
    write_whole(work.folder / FIGURES, json.dumps({"seed": settings.seed, "tables": done}, indent=1) + "\n")
    figures: dict[str, float] = {}
    for one in done:
        title = _title(one["table"])
        errors = one["result"].get("errors")
        values = dict(errors) if isinstance(errors, dict) else {}
        values["falls"] = one["result"].get("falls")
        figures |= {f"{title}/{k}": float(v) for k, v in values.items() if isinstance(v, int | float)}
    return Outcome(figures=figures, seeds=(settings.seed,))


def _title(table: Mapping[str, Any]) -> str:
    others = [f"{k} {v}" for k, v in table.items() if k not in ("protocol", "gait", "episodes")]
    return " ".join([str(table["protocol"]), str(table.get("gait", "walking")), *others])


# Export ---------------------------------------------------------------------------------------------------------------


def run_export(work: StageWork) -> Outcome:
    """Copy policy, snapshot and figures into one folder, with policy.onnx if asked for.

    Raises:
        ConfigError: if onnx is asked for and not installed.
    """
    settings: ExportSettings = work.stage.config()
    for name, path in work.inputs.items():
        target = UNCALIBRATED if name == "uncalibrated" else TAKEN_BY_NAME[name]
        write_whole(work.folder / target, path.read_bytes())
    if settings.onnx:
        from hugwbc.learned.policy.onnx_export import export_onnx

        export_onnx(load_policy(work.folder / POLICY, threads=None), work.folder / ONNX)
    return Outcome()

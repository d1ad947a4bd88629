import json
import math
import pathlib
from collections.abc import Callable
from typing import Any

import pytest

from hugwbc.learned.policy import load_policy
from hugwbc.learned.policy.feed_forward import LARGEST_CHANGE
from hugwbc.learned.recipe.closing_stages import corrected, knots_of
from hugwbc.learned.recipe.recipe_records import CalibrationSettings, Recipe
from hugwbc.learned.recipe.recipe_run import RunOptions, run_recipe
from hugwbc.learned.recipe.run_folder import RunFolder


def test_knots_lie_in_the_ranges_of_each_gait() -> None:
    curves = knots_of(CalibrationSettings(knots=3))
    assert "v_x" not in curves["standing"] and "l" not in curves["standing"] and "h" in curves["standing"]
    assert [pair[0] for pair in curves["walking"]["v_x"]] == [-0.6, 0.7, 2.0]
    assert all(knot == asked for of_gait in curves.values() for pairs in of_gait.values() for knot, asked in pairs)


def test_a_correction_takes_out_a_fraction_of_the_error_within_bounds() -> None:
    curves = {"walking": {"v_x": [[0.0, 0.0], [1.0, 1.1], [2.0, 2.0]]}}
    errors = {("walking", "v_x", 0): 0.1, ("walking", "v_x", 1): math.nan, ("walking", "v_x", 2): 9.0}
    pairs = corrected(curves, errors, 0.5)["walking"]["v_x"]
    assert pairs == [[0.0, 0.05], [1.0, 1.1], [2.0, 2.0 + LARGEST_CHANGE["v_x"]]]


def test_a_calibrated_policy_executes_what_is_commanded(finished: pathlib.Path) -> None:
    """The policy of the test executes 0.8 of what it is asked for."""
    place = RunFolder(finished).stage("calibrated")
    content = json.loads((place / "calibration.json").read_text())
    before, after = content["mean errors"]["walking/h"].values()
    assert after < 0.5 * before
    curves = load_policy(place).contract.feed_forward
    assert curves == content["curves"] and set(curves["walking"]) == {"v_x", "h"}
    record = RunFolder(finished).records()["calibrated"]
    assert record.figures["walking/h/uncalibrated"] == before and record.seeds == (0,)
    # The policy that it came from has none, so that its figures can stand beside.
    assert not load_policy(RunFolder(finished).stage("merged")).contract.feed_forward


def test_a_curve_that_helps_nothing_is_left_out(
    finished: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stubborn(policy: pathlib.Path, commands: list[dict[str, Any]], *rest: Any) -> list[dict[str, float]]:
        return [{name: 0.0 for name in values if name != "gait"} for values in commands]

    monkeypatch.setattr(services, "executed", stubborn)
    assert run_recipe(make_recipe(), RunOptions(finished, redo=("calibrated",)), services)
    assert not load_policy(RunFolder(finished).stage("calibrated")).contract.feed_forward


def test_falls_leave_a_calibration_without_curves(
    finished: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(services, "executed", lambda policy, commands, *rest: [{} for _ in commands])
    assert run_recipe(make_recipe(), RunOptions(finished, redo=("calibrated",)), services)
    content = json.loads((RunFolder(finished).stage("calibrated") / "calibration.json").read_text())
    assert content["curves"] == {} and content["mean errors"]["walking/v_x"] == {
        "uncalibrated": None,
        "calibrated": None,
    }


def test_tables_that_are_done_are_not_run_again(
    finished: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any
) -> None:
    run = services.run_table

    def once(policy: pathlib.Path, table: Any, **options: Any) -> dict[str, Any]:
        if services.tables:
            raise KeyboardInterrupt
        return run(policy, table, **options)

    services.run_table = once
    with pytest.raises(KeyboardInterrupt):
        run_recipe(make_recipe(), RunOptions(finished, redo=("figures",)), services)
    services.run_table = run
    assert run_recipe(make_recipe(), RunOptions(finished), services)
    assert [table["gait"] for table in services.tables] == ["walking", "standing"]


def test_the_exported_folder_has_everything_to_ship(
    finished: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any, tiny: str
) -> None:
    place = RunFolder(finished).stage("policy")
    names = {path.name for path in place.iterdir()}
    assert names == {"policy.safetensors", "snapshot.safetensors", "figures.json", "ancestry.json", "record.json"}
    pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    recipe = make_recipe(
        tiny, ("inputs: {policy: calibrated, snap", "settings: {onnx: true}\n    inputs: {policy: calibrated, snap")
    )
    assert run_recipe(recipe, RunOptions(finished, redo=("changed",)), services)
    assert "policy.onnx" in RunFolder(finished).records()["policy"].outputs

import json
import pathlib
import subprocess
import sys

import pytest

from hugwbc.cli import main
from hugwbc.learned.policy import checkpoint, policy_file
from hugwbc.learned.recipe.ancestry import KEY
from hugwbc.learned.recipe.recipe_reader import shipped_recipes
from hugwbc.learned.recipe.recipe_records import KINDS


def test_the_actions_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as info:
        main(["recipe", "--help"])
    assert info.value.code == 0
    text = capsys.readouterr().out
    assert all(f"  {action} " in text for action in ("run", "status", "plan", "diff", "verify"))
    assert main(["recipe", "cook", "h1"]) == 2
    assert "unknown action of recipe 'cook'" in capsys.readouterr().err


def test_a_plan_is_a_table_and_json(tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recipe", "plan", "h1", "--json", str(tmp_path / "plan.json")]) == 0
    text = capsys.readouterr().out
    assert "core-hours" in text and "gaits" in text and "in all" in text
    plan = json.loads((tmp_path / "plan.json").read_text())
    assert plan["core_hours"] == pytest.approx(sum(stage["cpu_seconds"] for stage in plan["stages"]) / 3600.0)
    assert plan["core_hours"] < 16.0
    gaits = next(stage for stage in plan["stages"] if stage["stage"] == "gaits")
    assert gaits["steps"] == 36e6 and gaits["most_steps"] == 108e6


def test_a_plan_finds_every_mistake(tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(
        "stages:\n  a: {kind: train, settings: {ppo.bta: 1, steps: -3}}\n"
        "  b: {kind: evaluate, inputs: {policy: c}, tables: [{protocol: single}]}\n"
    )
    assert main(["recipe", "plan", str(path)]) == 2
    text = capsys.readouterr().err
    assert "unknown setting 'ppo.bta'. Did you mean 'ppo.beta'?" in text and "mine.yaml:2:" in text
    path.write_text(path.read_text().replace("ppo.bta", "ppo.beta"))
    assert main(["recipe", "plan", str(path)]) == 2
    text = capsys.readouterr().err
    for part in ("steps = -3", "unknown stage 'c'", "unknown protocol 'single'. Did you mean 'single-command'?"):
        assert part in text


def test_recipes_are_compared(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recipe", "diff", "h1", "without-symmetry"]) == 0
    text = capsys.readouterr().out
    assert "gaits: ppo.symmetry" in text and "network" in text and "none" in text
    assert main(["recipe", "diff", "h1", "h1"]) == 0
    assert "the recipes do the same" in capsys.readouterr().out


def test_the_shipped_policy_is_verified(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recipe", "verify", "h1"]) == 0
    text = capsys.readouterr().out
    assert all(stage in text for stage in ("starts", "gaits", "precision", "calibrated", "figures", "policy"))


def test_a_policy_without_ancestry_is_not_verified(tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]) -> None:
    tensors, metadata = checkpoint.load_file(policy_file(), "policy")
    del metadata["training"][KEY]
    checkpoint.save_file(tmp_path / "policy.safetensors", tensors, "policy", metadata)
    assert main(["recipe", "verify", str(tmp_path)]) == 1
    assert "has no ancestry" in capsys.readouterr().out


def test_a_folder_without_a_run_is_refused(tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recipe", "status", str(tmp_path)]) == 2
    assert "holds no run of a recipe" in capsys.readouterr().err
    assert main(["recipe", "run", "h1", "--workers", "0", "--out", str(tmp_path)]) == 2
    assert "--workers 0; give 1 or more" in capsys.readouterr().err
    assert main(["recipe", "run", "h1", "--profile", "smok", "--out", str(tmp_path)]) == 2
    assert "Did you mean 'smoke'?" in capsys.readouterr().err


def test_a_recipe_does_not_run_under_torchrun(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WORLD_SIZE", "2")
    assert main(["recipe", "run", "h1", "--out", str(tmp_path / "run")]) == 2
    assert "runs in one process" in capsys.readouterr().err and not (tmp_path / "run").exists()


@pytest.mark.slow
def test_the_smoke_profile_runs_every_stage(tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "run"
    command = [sys.executable, "-m", "hugwbc.cli", "recipe", "run", "h1", "--profile", "smoke", "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert main(["recipe", "verify", str(out), "--json", str(tmp_path / "chain.json")]) == 0
    records = json.loads((tmp_path / "chain.json").read_text())["records"]
    assert {record["kind"] for record in records} == set(KINDS) - {"distil"}
    assert sum(record["spent"]["cpu_seconds"] for record in records) < 180.0
    assert main(["recipe", "verify", str(out / "stages" / "policy")]) == 0
    assert "the chain is whole" in capsys.readouterr().out
    assert main(["recipe", "status", str(out)]) == 0
    assert "finished" in capsys.readouterr().out
    evaluated = ["evaluate", "single-command", "--policy", str(out / "stages" / "policy"), "--episodes", "8"]
    assert main([*evaluated, "--duration", "1.5", "--results", "None"]) == 0


def test_every_shipped_recipe_has_a_line_in_the_guide() -> None:
    root = pathlib.Path(__file__).parents[2]
    text = (root / "docs" / "how-to" / "make-a-policy-again.md").read_text()
    assert all(f"`{name}`" in text for name in shipped_recipes())
    assert all(f"| `{kind}` |" in text for kind in KINDS)

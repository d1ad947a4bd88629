"""A recipe: read, run, killed, resumed; and what its files say of how they were made."""

import dataclasses
import json
import math
import pathlib
import shutil
import types
from typing import Any

import numpy as np
import pytest

from hugwbc.cli import main, train as cli_train
from hugwbc.errors import HugwbcError, RecipeError
from hugwbc.files import digest
from hugwbc.learned.config import CalibrationConfig
from hugwbc.learned.distributed import Stop, StoppedError
from hugwbc.learned.policy import checkpoint, load_policy, save_policy
from hugwbc.learned.recipe.ancestry import KEY, KINDS, verify
from hugwbc.learned.recipe.calibration import Arena, calibrate
from hugwbc.learned.recipe.recipe import load_recipe
from hugwbc.learned.recipe.run import RECORD, _finish, _Work, run_recipe
from hugwbc.learned.rl.trainer import CHECKPOINT_NAME, Trainer

RECIPE = """
about: A walk.
seed: 2001
stages:
  walk:
    train:
      steps: 256
      evaluation_steps: 128
      evaluation_robots: 2
      evaluation_seconds: 0.1
      save_interval: 1
      threads: 1
      env: {count: 8}
      ppo: {horizon: 8, minibatches: 1, epochs: 1}
      schedules: {ppo.std_limit: {shape: geometric, points: {0: 0.5, 256: 0.2}}}
  more:
    train:
      start_from: walk
      steps: 64
      evaluation_steps: 0
      threads: 1
      env: {count: 8}
      ppo: {horizon: 8, minibatches: 1, epochs: 1}
  calibrated:
    calibrate: {policy: more, knots: 2, rounds: 1, gaits: [walking], commands: [v_x]}
"""


def executed(policy, commands, config):
    """Walk at 0.9 of what is asked for."""
    asked = load_policy(policy).contract.feed_forward.get("walking", {}).get("v_x")
    asked = dict(map(tuple, asked or []))
    return [{"v_x": 0.9 * asked.get(one["v_x"], one["v_x"])} for one in commands]


in_arena = Arena(executed, lambda policy, config: (0.0, 0.0, 0.0))


@pytest.fixture
def recipe(tmp_path: pathlib.Path) -> pathlib.Path:
    path = tmp_path / "walk.yaml"
    path.write_text(RECIPE)
    return path


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> pathlib.Path:
    """The folder of a run of the recipe."""
    folder = tmp_path_factory.mktemp("finished")
    (folder / "walk.yaml").write_text(RECIPE)
    assert run_recipe(load_recipe(folder / "walk.yaml"), folder / "a", in_arena)
    return folder / "a"


@pytest.fixture
def made(finished, tmp_path: pathlib.Path) -> pathlib.Path:
    """A copy of it in the test's own folder, as `a`."""
    return shutil.copytree(finished, tmp_path / "a")


def tensors(path: pathlib.Path, kind: str) -> dict[str, Any]:
    return checkpoint.load_file(path, kind)[0]


def test_a_killed_run_goes_on_and_its_files_say_how_they_were_made(recipe, made, tmp_path, monkeypatch, capsys) -> None:
    iterate, count = Trainer.iterate, 0

    def killed(trainer: Trainer) -> dict[str, float]:
        nonlocal count
        count += 1
        if count == 3:
            raise KeyboardInterrupt
        return iterate(trainer)

    monkeypatch.setattr(Trainer, "iterate", killed)
    with pytest.raises(KeyboardInterrupt):
        run_recipe(load_recipe(recipe), tmp_path / "b", in_arena)
    assert (tmp_path / "b" / "walk" / CHECKPOINT_NAME).exists() and not (tmp_path / "b" / "walk" / RECORD).exists()
    (tmp_path / "b").rename(tmp_path / "elsewhere")  # on another machine
    assert run_recipe(load_recipe(recipe), tmp_path / "elsewhere", in_arena)
    for stage, name, kind in (("more", "snapshot", "checkpoint"), ("calibrated", "policy", "policy")):
        one, other = (tensors(tmp_path / run / stage / f"{name}.safetensors", kind) for run in ("a", "elsewhere"))
        assert all(bool((one[key] == other[key]).all()) for key in one)
    assert not list((tmp_path / "a").glob("*/checkpoint*")), "what only an unfinished stage needs is removed"
    records, problems = verify(tmp_path / "a")
    assert problems == [] and [one.stage for one in records] == ["walk", "more", "calibrated"]
    assert [one.steps + one.discarded_steps for one in records] == [256.0, 64.0, 0.0]
    assert records[1].parents["start_from"].digest == records[0].outputs["snapshot.safetensors"]
    assert all(one.core_seconds > 0.0 and one.commits for one in records)
    assert load_policy(tmp_path / "a").training[KEY]["recipe"] == RECIPE
    assert load_policy(tmp_path / "a").contract.feed_forward
    assert main(["check", "--policy", str(tmp_path / "a")]) == 0
    assert "the chain is whole" in capsys.readouterr().out
    own = RECIPE[RECIPE.index("  more:") : RECIPE.index("  calibrated:")].replace(
        "walk", str(tmp_path / "a/snapshot.safetensors")
    )
    recipe.write_text("about: Further.\nseed: 2002\nstages:\n" + own.replace("more", "further"))
    assert run_recipe(load_recipe(recipe), tmp_path / "further", in_arena)
    records, problems = verify(tmp_path / "further")
    assert problems == [] and [one.stage for one in records] == ["walk", "more", "further"]


def test_the_calibration_keeps_the_best_value_at_each_knot(made, tmp_path) -> None:
    """Walks of .9 of what is asked for, which fall from 1.5 m/s on and once at 0.7, and jumps that all fall."""
    seen = []

    def executed(policy, commands, config):
        if commands[0]["gait"] == "jumping":
            return [{"v_x": math.nan} for _ in commands]
        asked = dict(map(tuple, load_policy(policy).contract.feed_forward["walking"]["v_x"]))
        seen.append(list(asked.values()))
        falls = [v >= 1.5 or (len(seen) == 1 and command == 0.7) for command, v in asked.items()]
        return [
            {"v_x": math.nan if fell else 0.9 * asked[one["v_x"]]} for one, fell in zip(commands, falls, strict=True)
        ]

    gaits = ("walking", "jumping")
    config = CalibrationConfig(policy=made, gaits=gaits, commands=("v_x",), knots=5, rounds=6)
    figures = calibrate(
        config, tmp_path, Arena(executed, lambda policy, config: (0.06, -0.03, 0.1)), lambda number, error: None
    )
    contract = load_policy(tmp_path / "policy.safetensors").contract
    curves = contract.feed_forward
    assert contract.stop == (0.06, -0.03, 0.1)
    knots, asked = np.array(curves["walking"]["v_x"]).T
    assert knots.tolist() == [-0.6, 0.05, 0.7, 1.35, 2.0] and asked[0] == -0.6, "within the range"
    assert asked[1:3] == pytest.approx(knots[1:3] / 0.9, abs=0.01), "one fall below what it can is no limit"
    assert 1.2 < asked[3] == asked[4] < 0.85 * 1.5, "nothing is asked for with which another robot may fall"
    assert curves["jumping"]["v_x"] == [[knot, knot] for knot in knots], "nothing is known of what never stays up"
    assert figures["walking/v_x/calibrated"] < figures["walking/v_x/uncalibrated"]
    assert figures["jumping/v_x/calibrated"] is None


def test_what_is_not_calibrated_keeps_its_curves(made, tmp_path) -> None:
    config = CalibrationConfig(
        policy=made / "policy.safetensors", commands=("v_x",), gaits=("walking",), knots=2, rounds=1
    )
    controller = load_policy(config.policy)
    walking = controller.contract.feed_forward["walking"]
    curves = {"standing": {"h": [[-0.2, -0.25], [0.0, 0.0]]}, "walking": walking | {"l": [[0.1, 0.15], [0.3, 0.4]]}}
    contract = dataclasses.replace(controller.contract, feed_forward=curves)
    save_policy(made / "policy.safetensors", controller.actor, contract, controller.training)
    seen = []

    def watched(policy, commands, config):
        seen.append(load_policy(policy).contract.feed_forward)
        return executed(policy, commands, config)

    calibrate(config, tmp_path, Arena(watched, in_arena.stop), lambda number, error: None)
    for found in (*seen, load_policy(tmp_path / "policy.safetensors").contract.feed_forward):
        assert found["standing"] == curves["standing"] and found["walking"]["l"] == curves["walking"]["l"]
        assert len(found["walking"]["v_x"]) == 2


def test_a_stop_that_moves_the_robot_far_is_written_as_far_as_a_contract_may_say(made) -> None:
    far = Arena(executed, lambda policy, config: (0.4, -0.2, -0.7))
    settings = CalibrationConfig(
        policy=made / "more" / "policy.safetensors", knots=2, rounds=1, gaits=("walking",), commands=("v_x",)
    )
    calibrate(settings, made, far, lambda number, error: None)
    assert load_policy(made / "policy.safetensors").contract.stop == (0.3, -0.2, -0.5)


def test_a_policy_that_was_changed_does_not_pass(made, capsys) -> None:
    path = made / "policy.safetensors"
    (made / "snapshot.safetensors").write_bytes((made / "walk/snapshot.safetensors").read_bytes())
    assert verify(path)[1] == [], "the snapshot of an ancestor belongs to it"
    values, metadata = checkpoint.load_file(path, "policy")
    metadata["training"][KEY]["stages"][1]["parents"]["start_from"]["digest"] = "0" * 32
    checkpoint.save_file(path, values, "policy", metadata)
    assert verify(path)[1] == ["more: stage walk did not write its start_from"]
    assert main(["check", "--policy", str(path)]) == 1 and "PROBLEM" in capsys.readouterr().out
    del metadata["training"][KEY]
    checkpoint.save_file(path, values, "policy", metadata)
    assert "has no ancestry" in verify(path)[1][0]


def test_another_recipe_in_the_same_folder_is_refused(recipe, tmp_path, monkeypatch) -> None:
    run = Trainer.run

    def stopped(trainer: Trainer, report: Any) -> None:
        if trainer.config.out.name == "more":
            raise StoppedError
        run(trainer, report)

    monkeypatch.setattr(Trainer, "run", stopped)
    assert not run_recipe(load_recipe(recipe), tmp_path / "a", in_arena)
    for before, after, stage in (("steps: 64", "steps: 96", "more"), ("seed: 2001", "seed: 2002", "walk")):
        recipe.write_text(RECIPE.replace(before, after))
        with pytest.raises(RecipeError, match=f"recipe has changed since stage {stage} began"):
            run_recipe(load_recipe(recipe), tmp_path / "a", in_arena)
    assert (tmp_path / "a/recipe.yaml").read_text() == RECIPE
    assert json.loads((tmp_path / "a" / "walk" / RECORD).read_text())["stage"] == "walk"


def test_only_what_differs_from_the_defaults_tells_recipes_apart(recipe, tmp_path) -> None:
    """A new setting with a default must not keep a run from going on, nor another machine."""
    recipe.write_text(
        "seed: 2001\nstages: {walk: {train: {steps: 64, threads: 3, device: cpu, save_interval: 7, "
        "env: {robot: h1, count: 8, extra: {alive: 4}}}}}\n"
    )
    work = _Work(load_recipe(recipe), "walk", tmp_path, in_arena, Stop(), lambda *_: None, lambda line: None)
    given = {"train": {"steps": 64.0, "env": {"count": 8}}, "seed": 2001}
    assert work.digest == digest(json.dumps(given, sort_keys=True))
    changed = cli_train._changed(load_recipe(recipe), ["--threads", "2"])
    other = _Work(changed, "walk", tmp_path, in_arena, Stop(), lambda *_: None, lambda line: None)
    assert other.digest == work.digest, "an option of the session"


def test_only_the_first_process_gives_out_the_best_policy(recipe, tmp_path, monkeypatch) -> None:
    """The others of a resumed run have its figures from the checkpoint, and would write over files with a record."""
    trainer = types.SimpleNamespace(remark="", run=lambda report: None, best={"steps": 64.0}, begin={"steps": 0.0})
    trainer.steps = trainer.run_steps = 256.0
    monkeypatch.setattr("hugwbc.learned.recipe.run.Trainer", lambda config: trainer)
    loaded = load_recipe(recipe)
    work = _Work(loaded, "walk", tmp_path, in_arena, Stop(), lambda *_: None, lambda line: None)
    assert work._train(loaded.stages["walk"].train, None) == (64.0, 192.0, {"steps": 64.0})


def test_the_folder_of_a_run_gets_the_snapshot_that_led_to_its_policy(recipe, tmp_path) -> None:
    recipe.write_text(RECIPE.replace("policy: more", "policy: walk"))
    for stage, names in {"walk": KINDS, "more": KINDS, "calibrated": ["policy.safetensors"]}.items():
        (tmp_path / stage).mkdir()
        for name in names:
            (tmp_path / stage / name).write_text(stage)
    _finish(load_recipe(recipe), tmp_path)
    assert [(tmp_path / name).read_text() for name in KINDS] == ["calibrated", "walk"]


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ("start_from: walk", "start_from: wlak", r":\d+:7: unknown earlier stage .* in start_from 'wlak'.*'walk'"),
        ("policy: more", "policy: snapshot", "stage that writes policy.safetensors, in policy 'snapshot'"),
        ("{policy: more,", "{policy: calibrated,", "unknown earlier stage .* in policy 'calibrated'"),
        ("steps: 256", "steps: 0", "greater than 0"),
        ("horizon: 8", "horizom: 8", r":\d+:\d+: .*PPOConfig field 'horizom'. Did you mean 'horizon'"),
        ("ppo.std_limit", "ppo.std_limits", "std_limit"),
        ("seed: 2001", "seed: 7", "2000"),
        ("steps: 256", "steps: 256\n      seed: 2005", r":8:7: seed is not for a stage.* leave it out"),
        ("steps: 64", "steps: 64\n      hours: 2", "hours is not for a stage.* the same command continues"),
        ("calibrate: {", "train: {", "CalibrationConfig|TrainConfig"),
        ("about: A walk.", "measure: 3", "unknown Recipe field 'measure'"),
    ],
)
def test_a_mistake_is_refused_with_its_line(recipe, before: str, after: str, said: str) -> None:
    recipe.write_text(RECIPE.replace(before, after))
    with pytest.raises(HugwbcError, match=said):
        load_recipe(recipe)


def test_a_stage_that_takes_itself_is_refused_even_if_there_is_a_file_of_its_name(recipe, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "more").touch()
    recipe.write_text(RECIPE.replace("start_from: walk", "start_from: more"))
    with pytest.raises(HugwbcError, match="unknown earlier stage"):
        load_recipe(recipe)


def test_a_folder_in_place_of_its_file_is_refused_before_the_stages_run(recipe, tmp_path):
    (tmp_path / "mine").mkdir()
    for old, file in (("policy: more", "policy.safetensors"), ("start_from: walk", "snapshot.safetensors")):
        recipe.write_text(RECIPE.replace(old, f"{old.partition(':')[0]}: {tmp_path}/mine"))
        with pytest.raises(HugwbcError, match=rf"is the folder .*mine; give the file in it, .*mine/{file}"):
            load_recipe(recipe)


@pytest.mark.parametrize("robot", ["h1", "g1"])
def test_the_shipped_recipes_are_one_training_and_a_calibration(robot: str) -> None:
    stages = load_recipe(robot).stages
    one = stages["one"].train
    assert one is not None and list(stages) == ["one", "calibrated"]
    early, late = one.at(1e6), one.at(one.steps)
    assert early.env.command.hopping_fraction == 0.0 < late.env.command.hopping_fraction
    assert early.ppo.horizon < late.ppo.horizon and late.ppo.std_limit < early.ppo.std_limit
    smoke = load_recipe(robot, smoke=True).stages["one"].train
    assert smoke is not None and smoke.at(smoke.steps).env.rewards == late.env.rewards
    assert main(["check", "--policy", robot]) == 0


def test_options_change_a_recipe_of_one_training(tmp_path, monkeypatch, capsys) -> None:
    """A recipe file serves a laptop and a GPU; what was changed stands in the run's recipe. Seeds are the recipe's."""
    runs = []
    monkeypatch.setattr("hugwbc.learned.recipe.run.run_recipe", lambda recipe, *_, **__: runs.append(recipe) or True)
    text = "about: A walk.\nseed: 2001\nstages: {walk: {train: {steps: 64, env: {count: 8}}}}\n"
    (tmp_path / "walk.yaml").write_text(text)
    words = ["train", "--recipe", str(tmp_path / "walk.yaml"), "--out", str(tmp_path / "run"), "--workers", "16"]
    assert main([*words, "--env.count", "16", "--env.robot=g1", "--seed", "2007"]) == 0
    changed = runs[0].stages["walk"].train
    assert (changed.env.count, changed.env.robot, changed.steps, runs[0].seed) == (16, "g1", 64, 2007)
    assert runs[0].source.startswith("# hugwbc train --env.count 16 --env.robot=g1 --seed 2007\n" + text[:5])
    assert main(words) == 0 and runs[1] == load_recipe(tmp_path / "walk.yaml")
    assert main(["train", "--recipe", "g1", "--env.count", "16"]) == 0
    stages = load_recipe("g1").stages
    assert runs[2].stages["one"].train.env.count == 16 and runs[2].stages["calibrated"] == stages["calibrated"]
    (tmp_path / "two.yaml").write_text(text.replace("8}}}}", "8}}}, run: {train: {start_from: walk}}}"))
    assert main(["train", "--recipe", str(tmp_path / "two.yaml"), "--env.count", "16"]) == 2
    assert "--env.count changes recipes with one stage that trains; two has walk, run" in capsys.readouterr().err
    scheduled = text.replace("steps: 64,", "steps: 64, schedules: {ppo.std_limit: {points: {0: 0.5, 64: 0.2}}},")
    (tmp_path / "scheduled.yaml").write_text(scheduled)
    assert main(["train", "--recipe", str(tmp_path / "scheduled.yaml"), "--ppo.std-limit", "0.3"]) == 2
    assert "ppo.std_limit follows a schedule" in capsys.readouterr().err
    assert main([*words, "--seed", "2000"]) == 0 and runs[-1].seed == 2000, "the default of a run without a recipe"
    for words_of_a_run in (["--resume"], ["--hours", "2"]):
        assert main([*words, *words_of_a_run]) == 2
        assert "the same command continues" in capsys.readouterr().err
    assert main([*words, "--config=apart.py"]) == 2
    assert "--recipe and --config are both given" in capsys.readouterr().err

import dataclasses
import errno
import json
import os
import pathlib
import signal
from collections.abc import Callable
from typing import Any

import pytest
import torch

from hugwbc.errors import RecipeError
from hugwbc.learned.policy import checkpoint, load_policy
from hugwbc.learned.recipe.ancestry import ancestry_of, read_record
from hugwbc.learned.recipe.ledger import only_process, read_sessions
from hugwbc.learned.recipe.recipe_records import Recipe
from hugwbc.learned.recipe.recipe_run import RunOptions, run_recipe
from hugwbc.learned.recipe.run_folder import RunFolder

STAGES = ["labels", "gaits", "merged", "calibrated", "figures", "policy"]


def run(recipe: Recipe, out: pathlib.Path, services: Any, **options: Any) -> bool:
    return run_recipe(recipe, RunOptions(out, **options), services)


def weights(out: pathlib.Path, stage: str, file: str = "snapshot.safetensors") -> dict[str, torch.Tensor]:
    kind = "policy" if file.startswith("policy") else "checkpoint"
    return checkpoint.load_file(RunFolder(out).stage(stage) / file, kind)[0]


def until(recipe: Recipe, stage: str) -> Recipe:
    """The recipe without the stages that come later."""
    names = [one.name for one in recipe.stages]
    return dataclasses.replace(recipe, stages=recipe.stages[: names.index(stage) + 1])


def assert_equal_weights(a: pathlib.Path, b: pathlib.Path, *stages: str) -> None:
    for stage in stages or ("labels", "gaits", "merged"):
        first, second = weights(a, stage), weights(b, stage)
        assert first.keys() == second.keys()
        for name, tensor in first.items():
            assert torch.equal(tensor, second[name]), f"{stage}: {name}"


def test_a_recipe_runs_from_labels_to_a_policy_with_its_ancestry(
    tmp_path: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any
) -> None:
    recipe, lines = make_recipe(), []
    fractions: list[float] = []
    finished = run_recipe(
        recipe, RunOptions(tmp_path / "run"), services, progress=lambda f, r: fractions.append(f), say=lines.append
    )
    assert finished
    assert fractions == sorted(fractions) and fractions[-1] == pytest.approx(1.0)
    records = RunFolder(tmp_path / "run").records()
    assert list(records) == STAGES
    assert records["labels"].labels == 640 and records["merged"].labels == 800
    assert records["gaits"].spent.steps == 192
    assert records["gaits"].steps + sum(one.steps for one in records["gaits"].discarded) == 192
    # The exported policy says by itself how it was made.
    exported = tmp_path / "run" / "stages" / "policy" / "policy.safetensors"
    chain = ancestry_of(exported)
    assert [record.stage for record in chain] == STAGES
    assert chain[1].parents == {"labels": records["labels"].digest}
    assert chain[-1].run_spent.steps == 192 and chain[-1].run_spent.labels == 1440
    assert chain[-1].run_spent.cpu_seconds > 0.0
    assert load_policy(exported).training["ancestry"]["records"]
    # Evaluations are at the report seed, and their figures are in the record.
    figures = json.loads((tmp_path / "run" / "stages" / "figures" / "figures.json").read_text())
    assert figures["seed"] == 1000 and "rows" not in figures["tables"][0]["result"]
    assert records["figures"].figures["single-command walking/E_vx_low"] == 0.03
    assert records["figures"].spent.episodes == 12
    # What only an unfinished run needs is gone.
    left = {path.name for path in (tmp_path / "run").rglob("*.safetensors")}
    assert left <= {"policy.safetensors", "snapshot.safetensors", "starts.safetensors", "labels.safetensors"}
    # A second run finds everything done.
    tables = len(services.tables)
    assert run(recipe, tmp_path / "run", services) and len(services.tables) == tables


class Killed(BaseException):
    """Stands for SIGKILL: nothing may catch it and write."""


@pytest.mark.slow
def test_killed_anywhere_and_resumed_it_makes_the_same_weights(
    tmp_path: pathlib.Path,
    finished: pathlib.Path,
    make_recipe: Callable[..., Recipe],
    services: Any,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    recipe = make_recipe()
    # Kill at every single write, one after the other: before it, and then go on.
    from hugwbc import files

    whole, kills = files.write_whole, 0

    def replace_everywhere(function: Callable) -> None:
        import sys

        for module in list(sys.modules.values()):
            if getattr(module, "write_whole", None) in (whole, dying) and module.__name__.startswith("hugwbc"):
                monkeypatch.setattr(module, "write_whole", function)

    countdown = 0

    def dying(path: pathlib.Path, content: bytes | str) -> None:
        nonlocal countdown
        countdown -= 1
        if countdown == 0:
            raise Killed
        whole(path, content)

    replace_everywhere(dying)
    monkeypatch.setattr("hugwbc.learned.recipe.recipe_run._end", lambda session, how: None)
    for attempt in range(200):
        countdown = 3 + attempt  # each session lives longer than the one before, so that the run ends
        try:
            assert run(recipe, tmp_path / "killed", services)
            break
        except Killed:
            kills += 1
    assert kills >= 8
    assert_equal_weights(finished, tmp_path / "killed")
    a, b = (RunFolder(folder).records() for folder in (finished, tmp_path / "killed"))
    for name in STAGES:
        assert a[name].outputs == b[name].outputs
        assert a[name].figures == b[name].figures
        assert (a[name].steps, a[name].labels) == (b[name].steps, b[name].labels)
    # What was repeated is counted, as discarded.
    assert b["gaits"].spent.steps >= 192 and b["labels"].spent.labels > 640
    assert any("interruption" in one.reason for one in b["labels"].discarded)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_with_everything_written(
    tmp_path: pathlib.Path, finished: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any, number: int
) -> None:
    recipe = until(make_recipe(), "gaits")
    before = signal.getsignal(number)

    def stop_in_training(line: str) -> None:
        if line.startswith("gaits: 64"):
            os.kill(os.getpid(), number)

    out = tmp_path / "run"
    assert not run_recipe(recipe, RunOptions(out), services, say=stop_in_training)
    assert signal.getsignal(number) == before
    (session,) = read_sessions(out)
    assert session.ended is not None and session.ended.endswith("stopped")
    assert read_record(RunFolder(out).stage("labels")) is not None
    assert read_record(RunFolder(out).stage("gaits")) is None
    shares: list[tuple[float, float]] = []
    assert run_recipe(recipe, RunOptions(out), services, progress=lambda *both: shares.append(both))
    # What the first session did counts as read, so that the time left is that of the rest.
    assert all(0.0 < read <= done for done, read in shares)
    assert_equal_weights(finished, out, "labels", "gaits")
    assert len(read_sessions(out)) == 2


def test_a_changed_recipe_is_refused_until_it_is_said_what_to_do(
    finished: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any, tiny: str
) -> None:
    out = finished
    changed = make_recipe(tiny, ("[0.5, 0.1]", "[0.5, 0.2]"))
    with pytest.raises(RecipeError, match=r"stages gaits, .* differ, of which gaits, .*--redo changed"):
        run(changed, out, services)
    labels = (out / "stages" / "labels" / "record.json").read_bytes()
    assert run(changed, out, services, redo=("changed",))
    assert (out / "stages" / "labels" / "record.json").read_bytes() == labels
    record = RunFolder(out).records()["gaits"]
    # Both trainings are paid for, one of them led to the policy.
    assert record.spent.steps == 384
    assert sum(one.steps for one in record.discarded) == 384 - record.steps
    assert sorted(path.name for path in (out / "abandoned").iterdir()) == [f"{name}~1" for name in sorted(STAGES[1:])]


def test_texts_and_recorded_speeds_are_no_change(
    finished: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any, tiny: str
) -> None:
    out = finished
    assert run(make_recipe(tiny, ("about: A policy of no use", "rates: {train: 9}\nabout: B")), out, services)
    assert not (out / "abandoned").exists()


def test_stages_that_are_begun_again_take_their_children_with_them(
    finished: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any
) -> None:
    recipe, out = make_recipe(), finished
    assert run(recipe, out, services, redo=("calibrated",))
    assert sorted(path.name for path in (out / "abandoned").iterdir()) == ["calibrated~1", "figures~1", "policy~1"]
    with pytest.raises(RecipeError, match=r"no such stage\. Valid: labels"):
        run(recipe, out, services, redo=("gates",))


@pytest.mark.parametrize("damage", ["missing", "changed"])
def test_a_parent_that_is_missing_or_changed_is_an_error_that_names_it(
    tmp_path: pathlib.Path, finished: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any, damage: str
) -> None:
    recipe, out = make_recipe(), finished
    path = out / "stages" / "gaits" / "snapshot.safetensors"
    if damage == "missing":
        path.unlink()
    else:
        tensors, metadata = checkpoint.load_file(path, "checkpoint")
        tensors["network.log_std"] += 1e-3
        checkpoint.save_file(path, tensors, "checkpoint", metadata)
    (out / "stages" / "merged").rename(tmp_path / "merged")
    with pytest.raises(RecipeError, match=r"merged cannot begin.*snapshot.*--redo gaits"):
        run(recipe, out, services)


def test_a_missing_record_of_a_parent_is_an_error_that_names_it(
    finished: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any
) -> None:
    recipe, out = make_recipe(), finished
    folder = RunFolder(out)
    (folder.stage("policy") / "record.json").unlink()
    (folder.stage("figures") / "record.json").write_text("{}")
    with pytest.raises(RecipeError, match=r"record\.json is damaged .*--redo figures"):
        run(recipe, out, services)


def test_a_full_disk_is_an_error_and_nothing_is_lost(
    tmp_path: pathlib.Path,
    finished: pathlib.Path,
    make_recipe: Callable[..., Recipe],
    services: Any,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    recipe, out = until(make_recipe(), "labels"), tmp_path / "run"
    save = checkpoint.save_file

    def full(path: pathlib.Path, *rest: Any) -> None:
        if path.name == "leg.safetensors" and (out / "stages" / "labels" / "leg.safetensors").exists():
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        save(path, *rest)

    monkeypatch.setattr(checkpoint, "save_file", full)
    with pytest.raises(RecipeError, match=r"No space left on device.*make room.*run the same again"):
        run(recipe, out, services)
    monkeypatch.undo()
    session = read_sessions(out)[0]
    assert session.ended is not None and "No space left" in session.ended
    assert run(recipe, out, services)
    assert_equal_weights(finished, out, "labels")


def test_two_processes_do_not_work_on_one_run(
    tmp_path: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any
) -> None:
    with only_process(tmp_path / "run"), pytest.raises(RecipeError, match="another process is working on"):
        run(make_recipe(), tmp_path / "run", services)


def test_a_folder_with_other_files_is_refused(
    tmp_path: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any
) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("")
    with pytest.raises(RecipeError, match="holds other files and no run"):
        run(make_recipe(), tmp_path / "mine", services)


def test_a_profile_is_another_run(
    tmp_path: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any, tiny: str
) -> None:
    half = make_recipe(tiny, profile="half")
    assert half.stage("gaits").work == 96 and half.digest != make_recipe().digest
    out = tmp_path / "run"
    (out).mkdir()
    RunFolder(out).prepare(half, ())
    with pytest.raises(RecipeError, match="has changed"):
        run(make_recipe(), out, services)


def test_another_default_of_the_program_is_a_change(
    finished: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any
) -> None:
    path = finished / "recipe.json"
    content = json.loads(path.read_text())
    content["stages"]["gaits"][1] = "another default"
    path.write_text(json.dumps(content))
    with pytest.raises(RecipeError, match=r"or a default of hugwbc, has changed.*stages gaits differ"):
        run(make_recipe(), finished, services)

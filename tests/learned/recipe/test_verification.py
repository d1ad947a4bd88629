import json
import pathlib
import shutil
from collections.abc import Callable

import pytest

from hugwbc.errors import UnknownNameError
from hugwbc.learned.policy import checkpoint
from hugwbc.learned.recipe import verification
from hugwbc.learned.recipe.ancestry import KEY
from hugwbc.learned.recipe.recipe_records import Recipe
from hugwbc.learned.recipe.verification import verify


@pytest.fixture
def shipped(finished: pathlib.Path, tmp_path: pathlib.Path) -> pathlib.Path:
    """The folder that the last stage exported, somewhere else."""
    shutil.copytree(finished / "stages" / "policy", tmp_path / "shipped")
    return tmp_path / "shipped"


@pytest.mark.parametrize("what", ["folder", "file"])
def test_a_policy_of_a_recipe_is_verified_by_itself(shipped: pathlib.Path, what: str) -> None:
    verdict = verify(shipped if what == "folder" else shipped / "policy.safetensors")
    assert verdict.problems == []
    assert [record.stage for record in verdict.records][-1] == "policy"
    assert any("the recipe 'tiny' is not here to compare with" in one for one in verdict.remarks)


def test_a_policy_without_ancestry_is_said_to_have_none(shipped: pathlib.Path) -> None:
    path = shipped / "policy.safetensors"
    tensors, metadata = checkpoint.load_file(path, "policy")
    del metadata["training"][KEY]
    checkpoint.save_file(path, tensors, "policy", metadata)
    verdict = verify(path)
    assert verdict.records == () and "has no ancestry: it was not made by a recipe" in verdict.problems[0]


def test_changed_weights_are_found(shipped: pathlib.Path) -> None:
    path = shipped / "policy.safetensors"
    tensors, metadata = checkpoint.load_file(path, "policy")
    tensors["policy.0.bias"] += 1e-6
    checkpoint.save_file(path, tensors, "policy", metadata)
    assert any("its tensors were changed" in one for one in verify(shipped).problems)


def test_a_changed_file_beside_the_policy_is_found(shipped: pathlib.Path) -> None:
    (shipped / "figures.json").write_text("{}")
    assert any("figures.json is not the file that stage policy wrote" in one for one in verify(shipped).problems)


def test_a_changed_record_of_an_ancestor_is_found(shipped: pathlib.Path) -> None:
    path = shipped / "policy.safetensors"
    tensors, metadata = checkpoint.load_file(path, "policy")
    metadata["training"]["ancestry"]["records"][0]["spent"]["cpu_seconds"] = 0.0
    checkpoint.save_file(path, tensors, "policy", metadata)
    problems = verify(shipped).problems
    assert any("gaits: the record of its parent labels is not the one" in one for one in problems)


def test_the_chain_of_another_policy_is_found(shipped: pathlib.Path) -> None:
    chain = json.loads((shipped / "ancestry.json").read_text())
    chain["records"].pop()
    (shipped / "ancestry.json").write_text(json.dumps(chain))
    assert any("belongs to another policy" in one for one in verify(shipped).problems)


def test_a_recipe_that_says_something_else_today_is_found(
    shipped: pathlib.Path, make_recipe: Callable[..., Recipe], tiny: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    same, other = make_recipe(tiny), make_recipe(tiny, ("[0.5, 0.1]", "[0.5, 0.2]"))
    monkeypatch.setattr(verification, "load_recipe", lambda name, profile: same)
    assert verify(shipped).problems == []
    monkeypatch.setattr(verification, "load_recipe", lambda name, profile: other)
    problems = verify(shipped).problems
    assert problems[0] == "gaits: the recipe 'tiny' says something else today" and len(problems) == 5


def test_a_whole_run_is_verified_with_all_its_files(finished: pathlib.Path) -> None:
    assert verify(finished).problems == []
    path = finished / "stages" / "labels" / "starts.safetensors"
    path.unlink(missing_ok=True)
    snapshot = finished / "stages" / "labels" / "snapshot.safetensors"
    snapshot.write_bytes(snapshot.read_bytes()[:-1])
    assert any("snapshot.safetensors" in one for one in verify(finished).problems)


def test_an_unfinished_run_says_what_is_missing(finished: pathlib.Path) -> None:
    shutil.rmtree(finished / "stages" / "policy")
    verdict = verify(finished)
    assert verdict.problems == [] and "not finished: policy" in verdict.remarks


def test_nothing_of_that_name() -> None:
    with pytest.raises(UnknownNameError, match="unknown policy 'h7'"):
        verify("h7")

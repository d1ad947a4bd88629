import dataclasses
import json
import pathlib

import pytest
import torch

from hugwbc.errors import PolicyFileError, RecipeError
from hugwbc.learned.policy import checkpoint
from hugwbc.learned.recipe.ancestry import (
    Record,
    ancestry_of,
    chain_problems,
    content_digest,
    file_kind,
    file_problems,
    lineage,
    read_record,
    seal,
)
from hugwbc.learned.recipe.run_folder import RunFolder


@pytest.fixture
def records(finished: pathlib.Path) -> list[Record]:
    return list(RunFolder(finished).records().values())


def test_a_record_survives_its_file(records: list[Record]) -> None:
    for record in records:
        read = Record.read(json.loads(json.dumps(record.as_dict())))
        assert read.as_dict() == record.as_dict() and read.digest == record.digest


def test_a_record_names_everything_that_made_its_files(records: list[Record]) -> None:
    gaits = records[1]
    assert gaits.kind == "train" and gaits.recipe == "tiny" and gaits.seeds == (2001,)
    assert gaits.settings["ppo.horizon"] == 4 and gaits.settings["ppo.gamma"] > 0.0  # defaults included
    assert gaits.plan["schedules"]["ppo.beta"]["values"] == [0.5, 0.1]
    assert set(gaits.outputs) == {"policy.safetensors", "snapshot.safetensors"}
    assert gaits.inputs == {
        "start_from": records[0].outputs["snapshot.safetensors"],
        "ppo.labels": records[0].outputs["labels.safetensors"],
    }
    assert gaits.figures["evaluation/falls"] >= 0.0
    assert gaits.commits and {"python", "torch", "mujoco"} <= set(gaits.versions)


def test_every_artefact_carries_its_whole_ancestry(finished: pathlib.Path) -> None:
    folder = RunFolder(finished)
    expected = {"labels": 1, "gaits": 2, "merged": 3, "calibrated": 4, "policy": 6}
    for stage, count in expected.items():
        for path in folder.stage(stage).glob("*.safetensors"):
            chain = ancestry_of(path)
            assert len(chain) == count and chain[-1].stage == stage, path
            assert chain_problems(chain) == []


def test_sealing_leaves_tensors_and_digest_as_they_are(finished: pathlib.Path, records: list[Record]) -> None:
    path = RunFolder(finished).stage("gaits") / "snapshot.safetensors"
    before, digest = checkpoint.load_file(path, "checkpoint")[0], content_digest(path)
    seal(path, records[:1])
    after, metadata = checkpoint.load_file(path, "checkpoint")
    assert all(torch.equal(before[name], after[name]) for name in before)
    assert content_digest(path) == digest and len(metadata["ancestry"]["records"]) == 1


def test_a_digest_follows_the_tensors(finished: pathlib.Path) -> None:
    path = RunFolder(finished).stage("gaits") / "snapshot.safetensors"
    digest = content_digest(path)
    tensors, metadata = checkpoint.load_file(path, "checkpoint")
    checkpoint.save_file(path, tensors, "checkpoint", metadata | {"note": "other words"})
    assert content_digest(path) == digest
    name = next(iter(tensors))
    tensors[name] = tensors[name] + 1.0
    checkpoint.save_file(path, tensors, "checkpoint", metadata)
    assert content_digest(path) != digest
    assert "is not the file that gaits wrote" in file_problems(path.parent, {path.name: digest}, "gaits")[0]


def test_missing_and_damaged_files_are_problems(tmp_path: pathlib.Path, finished: pathlib.Path) -> None:
    path = RunFolder(finished).stage("gaits") / "policy.safetensors"
    path.write_bytes(path.read_bytes()[:500])
    found = file_problems(path.parent, {"policy.safetensors": "0", "snapshot.safetensors": "0", "no.json": "0"}, "x")
    assert len(found) == 3 and "No such file" in found[2]
    (tmp_path / "foreign.safetensors").write_bytes(b"\x02\0\0\0\0\0\0\0{}")
    with pytest.raises(PolicyFileError, match="not written by hugwbc"):
        file_kind(tmp_path / "foreign.safetensors")


def test_a_changed_parent_breaks_the_chain(records: list[Record]) -> None:
    labels, gaits = records[:2]
    assert chain_problems([labels, gaits]) == []
    poorer = dataclasses.replace(labels, labels=1.0)
    assert chain_problems([poorer, gaits]) == [
        "gaits: the record of its parent labels is not the one that it was made from"
    ]
    assert chain_problems([gaits])[0] == "gaits: the record of its parent labels is missing"
    other = dataclasses.replace(gaits, inputs={"start_from": "0" * 32})
    assert chain_problems([labels, other]) == ["gaits: its input start_from was written by none of its parents"]


def test_a_lineage_leaves_out_what_is_no_ancestor(records: list[Record]) -> None:
    by_stage = {record.stage: record for record in records}
    assert [record.stage for record in lineage(by_stage["gaits"], by_stage)] == ["labels", "gaits"]


@pytest.mark.parametrize("damage", ["{", "[]", "{}"])
def test_a_damaged_record_is_refused(finished: pathlib.Path, damage: str) -> None:
    place = RunFolder(finished).stage("gaits")
    (place / "record.json").write_text(damage)
    with pytest.raises(RecipeError, match=r"record\.json is damaged .*--redo gaits"):
        read_record(place)


@pytest.mark.parametrize("damage", ["format", "field", "type"])
def test_a_damaged_ancestry_is_refused(finished: pathlib.Path, damage: str) -> None:
    path = RunFolder(finished).stage("gaits") / "policy.safetensors"
    tensors, metadata = checkpoint.load_file(path, "policy")
    chain = metadata["training"]["ancestry"]
    if damage == "format":
        chain["format"] = "hugwbc ancestry 9"
    elif damage == "field":
        del chain["records"][0]["spent"]
    else:
        chain["records"][0]["discarded"] = [{"cause": 1}]
    checkpoint.save_file(path, tensors, "policy", metadata)
    with pytest.raises(RecipeError, match=r"the ancestry in .* is damaged"):
        ancestry_of(path)

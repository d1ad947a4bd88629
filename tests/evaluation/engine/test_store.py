import json
import logging
import os

import pytest

from hugwbc.errors import ResultFileError
from hugwbc.evaluation.engine import ResultStore, store
from hugwbc.evaluation.engine.store import VERSION, EpisodeFile

IDENTITY = {"seed": 0, "controller": {"controller": "qp"}}
ROWS = {"a": {"error": 0.1 + 0.2, "fell": False}, "b": {"error": None, "fell": True}}


@pytest.fixture
def path(tmp_path):
    """A file with two rows."""
    file = EpisodeFile(tmp_path / "cell.jsonl", IDENTITY)
    for key, row in ROWS.items():
        file.add(key, row)
    return file.path


def _rows(file: EpisodeFile) -> dict:
    return {key: file[key] for key in ROWS if key in file}


def test_rows_come_back_to_the_last_bit(path):
    file = EpisodeFile(path, IDENTITY)
    assert _rows(file) == ROWS and len(file) == 2 and file.damaged == 0
    assert sorted(p.name for p in path.parent.iterdir()) == ["cell.jsonl"]


def test_a_line_that_was_cut_off_is_left_out_and_the_next_one_is_not(path, caplog):
    whole = path.read_bytes()
    path.write_bytes(whole[:-20])  # as a power cut in the middle of the last write leaves it
    with caplog.at_level(logging.WARNING):
        file = EpisodeFile(path, IDENTITY)
    assert _rows(file) == {"a": ROWS["a"]} and "1 damaged line(s)" in caplog.text
    file.add("b", ROWS["b"])
    again = EpisodeFile(path, IDENTITY)
    assert _rows(again) == ROWS and again.damaged == 1
    assert path.read_bytes().startswith(whole[:-20]), "nothing is overwritten"


def test_a_changed_number_is_noticed(path):
    text = path.read_text()
    path.write_text(text.replace("0.30000000000000004", "0.10000000000000004"))
    file = EpisodeFile(path, IDENTITY)
    assert "a" not in file and "b" in file and file.damaged == 1


@pytest.mark.parametrize(
    ("head", "message"),
    [
        ("hello", "is not a file of evaluated episodes"),
        ("", "is not a file of evaluated episodes"),
        ('{"format": "something else"}', "is not a file of evaluated episodes"),
        (json.dumps({"format": "hugwbc episodes", "version": VERSION + 1}), f"has format version {VERSION + 1}"),
        (json.dumps({"format": "hugwbc episodes", "version": VERSION, "identity": {}}), "another cell than its name"),
    ],
)
def test_foreign_files_are_refused_and_left_as_they_are(path, head, message):
    lines = path.read_text().split("\n")
    path.write_text("\n".join([head, *lines[1:]]))
    before = path.read_bytes()
    with pytest.raises(ResultFileError, match=message):
        EpisodeFile(path, IDENTITY)
    assert path.read_bytes() == before


def test_a_fresh_store_keeps_the_earlier_file_under_another_name(tmp_path, caplog):
    ResultStore(tmp_path).cell("walk", IDENTITY).add("a", 1)
    fresh = ResultStore(tmp_path, fresh=True)
    with caplog.at_level(logging.WARNING):
        cell = fresh.cell("walk", IDENTITY)
    assert len(cell) == 0 and "the earlier results are kept as" in caplog.text
    cell.add("a", 2)
    assert fresh.cell("walk", IDENTITY) is cell, "set aside once"
    assert ResultStore(tmp_path).cell("walk", IDENTITY)["a"] == 2
    (old,) = tmp_path.glob("*.1.old")
    assert EpisodeFile(old, IDENTITY)["a"] == 1
    assert ResultStore(tmp_path).cell("walk", {"seed": 1}).path != cell.path


def test_a_folder_that_cannot_be_written_is_an_error_with_a_remedy(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ResultFileError, match="choose another folder"):
        ResultStore(tmp_path / "file").cell("walk", IDENTITY).add("a", 1)


def test_a_line_that_a_full_disk_cuts_short_costs_no_other(tmp_path, monkeypatch):
    path, identity = tmp_path / "cell.jsonl", {"controller": "x"}
    file = EpisodeFile(path, identity)
    file.add("a", 1)
    write = os.write
    monkeypatch.setattr(store.os, "write", lambda handle, data: write(handle, data[: len(data) // 2]))
    with pytest.raises(ResultFileError, match="cannot write"):
        file.add("b", 2)
    monkeypatch.undo()
    file.add("c", 3)
    again = EpisodeFile(path, identity)
    assert again.damaged == 1 and again["a"] == 1 and again["c"] == 3 and "b" not in again

"""Rows of the outside benchmark belong to the code, the policy and the scripts that made them."""

import json

import pytest


@pytest.fixture
def tool(load_tool, monkeypatch):
    tool = load_tool("humanoidbench")
    monkeypatch.setattr(
        tool, "play", lambda *key: dict(zip(("task", "controller", "seed"), key, strict=True)) | {"return": 1, "bar": 0}
    )
    return tool


def test_rows_of_other_code_are_played_again_and_not_mixed(tool, tmp_path, monkeypatch, capsys) -> None:
    out = tmp_path / "rows.jsonl"

    def play(seeds: int) -> int:
        words = ["humanoidbench", "--tasks", "walk", "--seeds", str(seeds), "--out", str(out)]
        monkeypatch.setattr("sys.argv", words)
        tool.main()
        return len(out.read_text().splitlines())

    assert play(3) == play(3) == 3 and json.loads(out.read_text().splitlines()[0])["script"]
    monkeypatch.setattr(tool, "source_commit", lambda **which: "another")
    assert play(2) == 5
    capsys.readouterr()
    tool.table(out)
    assert "| walk (0) | 1; 2 of 2 |  |" in capsys.readouterr().out
    with out.open("a") as file:  # another task of the code before
        file.write(json.dumps(json.loads(out.read_text().splitlines()[0]) | {"task": "run"}) + "\n")
        file.write(out.read_text().splitlines()[4] + "\n")
    tool.table(out)
    assert "| run (0) |" not in capsys.readouterr().out

"""Deployments in real time: which runs are kept."""

import re
import types

import pytest


def test_a_run_of_another_length_or_of_other_code_is_not_taken_for_this_one(load_tool, tmp_path, monkeypatch) -> None:
    tool, started = load_tool("deployments"), []

    def popen(words, **options):
        started.append(words)
        options["stdout"].write("said")
        return types.SimpleNamespace(wait=lambda timeout: 0, returncode=0, kill=lambda: None)

    monkeypatch.setattr(tool.subprocess, "Popen", popen)
    monkeypatch.setattr(tool, "versions", dict)
    monkeypatch.setattr(tool, "source_commit", lambda **which: "one")
    for _ in range(2):
        assert tool.deploy("hold", "stand", "clean", 60.0, tmp_path) == ("said", "said") and len(started) == 2
    tool.deploy("hold", "stand", "clean", 300.0, tmp_path)
    monkeypatch.setattr(tool, "source_commit", lambda **which: "another")
    tool.deploy("hold", "stand", "clean", 60.0, tmp_path)
    assert len(started) == 6
    monkeypatch.setattr(tool, "__file__", __file__)
    tool.deploy("hold", "stand", "clean", 60.0, tmp_path)
    assert len(started) == 8, "an edit of the tool"


@pytest.mark.parametrize(
    ("robot", "deployment", "words"),
    [(2, 1, "why"), (0, 2, "why"), (0, -9, "why"), (0, 1, "Traceback (most recent call last):")],
)
def test_a_run_that_did_not_start_or_crashed_is_no_measurement(
    load_tool, tmp_path, monkeypatch, robot, deployment, words
) -> None:
    tool = load_tool("deployments")

    def popen(line, **options):
        code = robot if "simulate-robot" in line else deployment
        options["stdout"].write("why" if "simulate-robot" in line else words)
        return types.SimpleNamespace(wait=lambda timeout: code, returncode=code, kill=lambda: None)

    monkeypatch.setattr(tool.subprocess, "Popen", popen)
    monkeypatch.setattr(tool, "versions", dict)
    monkeypatch.setattr(tool, "source_commit", lambda **which: "one")
    with pytest.raises(SystemExit, match=rf"hold-stand-clean-\w+ did not run:\nwhy\n{re.escape(words)}"):
        tool.deploy("hold", "stand", "clean", 60.0, tmp_path)
    assert not list(tmp_path.iterdir())

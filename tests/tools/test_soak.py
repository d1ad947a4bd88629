"""The program behind `make soak`."""

import importlib.util
import pathlib

import pytest

from hugwbc import Gait

PATH = pathlib.Path(__file__).parents[2] / "tools" / "soak.py"


@pytest.fixture
def soak():
    spec = importlib.util.spec_from_file_location("soak", PATH)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_line_for_each_kind_of_state_and_for_each_gait(soak, capsys, monkeypatch):
    monkeypatch.setattr(soak, "EPISODE_S", 0.1)
    soak.strange_states(3, seed=1)
    soak.long_run("hold", minutes=0.004, seed=1)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[:2]] == ["absurd", "hard"]
    assert [line.split(":")[0] for line in lines[2:]] == [f"hold, {gait.label}" for gait in Gait]
    assert all("15 ticks" in line and "memory +" in line for line in lines[2:])

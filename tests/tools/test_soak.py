"""The program behind `make soak`."""

import sys

import pytest

from hugwbc import Gait
from hugwbc.runtime import load_controller


@pytest.fixture(scope="module")
def soak(load_tool):
    return load_tool("soak")


def test_a_line_for_each_kind_of_state_and_for_each_gait(soak, capsys, monkeypatch):
    monkeypatch.setattr(soak, "EPISODE_S", 0.1)
    soak.strange_states(3, seed=1)
    growth = soak.long_run("hold", minutes=0.004, seed=1)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[:2]] == ["absurd", "hard"]
    assert lines[0].endswith("kept from it 3")
    assert [line.split(":")[0] for line in lines[2:]] == [f"hold, {gait.label}" for gait in Gait]
    assert all("15 ticks" in line and "memory " in line for line in lines[2:])
    assert abs(growth) < 1.0


def test_ticks_are_those_of_the_controller(soak, capsys, monkeypatch):
    monkeypatch.setattr(soak, "EPISODE_S", 0.1)
    monkeypatch.setattr(soak, "Gait", [Gait.STANDING])
    soak.long_run("qp", minutes=0.1 / 60.0, seed=1)
    assert "25 ticks" in capsys.readouterr().out, "of 4 ms"


def test_a_robot_that_keeps_memory_fails(soak, monkeypatch):
    kept = iter(range(100, 200, 10))
    monkeypatch.setattr(soak, "memory", lambda: next(kept))
    monkeypatch.setattr(soak, "EPISODE_S", 0.1)
    monkeypatch.setattr(soak, "strange_states", lambda ticks, seed: None)
    monkeypatch.setattr(soak, "Gait", [Gait.STANDING])
    monkeypatch.setattr(soak, "load_controller", lambda name: load_controller("hold"))
    monkeypatch.setattr(sys, "argv", ["soak.py", "--minutes", "0.003"])
    with pytest.raises(SystemExit, match=r"the memory grew by 10\.0%"):
        soak.main()

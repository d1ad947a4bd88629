"""The program behind `make soak`."""

import pytest

from hugwbc import Gait


@pytest.fixture(scope="module")
def soak(load_tool):
    return load_tool("soak")


def test_a_line_for_each_kind_of_state_and_for_each_gait(soak, capsys, monkeypatch):
    monkeypatch.setattr(soak, "EPISODE_S", 0.1)
    soak.strange_states(3, seed=1)
    soak.long_run("hold", minutes=0.004, seed=1)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[:2]] == ["absurd", "hard"]
    assert [line.split(":")[0] for line in lines[2:]] == [f"hold, {gait.label}" for gait in Gait]
    assert all("15 ticks" in line and "memory +" in line for line in lines[2:])

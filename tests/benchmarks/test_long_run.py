"""Memory over a long run."""

import pytest

from hugwbc import Gait
from hugwbc.benchmarks import long_run
from hugwbc.benchmarks.long_run import main


def test_a_line_for_each_gait_says_how_memory_grew(capsys, monkeypatch):
    monkeypatch.setattr(long_run, "EPISODE", 0.1)
    assert main(["--controllers", "hold", "--minutes", "0.004"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == [f"hold, {gait.label}" for gait in Gait]
    assert all("15 ticks" in line and "memory +" in line for line in lines)


def test_memory_that_is_kept_is_seen(monkeypatch):
    kept = []
    monkeypatch.setattr(long_run, "EPISODE", 0.1)
    rollout = long_run.rollout

    def leaking(*args, **settings):
        kept.append(bytearray(200_000_000))
        kept[-1][::4096] = bytes([1]) * len(kept[-1][::4096])
        return rollout(*args, **settings)

    monkeypatch.setattr(long_run, "rollout", leaking)
    assert long_run.run("hold", Gait.STANDING, 0.004, 1).growth > 0.1


def test_what_makes_no_sense_is_refused(capsys):
    for words in (["--minutes", "0"], ["--minutes", "nan"], ["--controllers", "nobody"]):
        with pytest.raises(SystemExit):
            main(words)
        assert "error" in capsys.readouterr().err

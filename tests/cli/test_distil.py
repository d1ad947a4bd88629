import pathlib
import signal
from collections.abc import Callable

import pytest

from hugwbc.cli import INTERRUPTED, main
from hugwbc.learned.imitation import Distiller
from hugwbc.learned.policy import load_policy

SNAPSHOT = "models/h1/policies/h1/snapshot.safetensors"


def test_a_policy_is_made_from_policies(tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["distil", "--out", str(tmp_path / "d"), "--samples", "20", "--env.count", "2", "--updates", "1"]
    teachers = [word for gait in ("--standing", "--walking", "--jumping") for word in (gait, SNAPSHOT)]
    assert main([*words, "--start-from", SNAPSHOT, *teachers]) == 0
    assert "20 labels" in capsys.readouterr().out
    assert load_policy(tmp_path / "d").training["distillation"]["labels"] == 20


def test_a_gait_without_a_teacher_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["distil", "--start-from", SNAPSHOT, "--standing", SNAPSHOT]) == 2
    assert "walking is 0.40 of the commands and has no teacher" in capsys.readouterr().err


def test_a_missing_start_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    teachers = [word for gait in ("--standing", "--walking", "--jumping") for word in (gait, SNAPSHOT)]
    assert main(["distil", *teachers]) == 2
    assert "start_from" in capsys.readouterr().err


def test_a_signal_keeps_what_was_learnt(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str], signal_while_fitting: Callable[[type, int], None]
) -> None:
    signal_while_fitting(Distiller, signal.SIGTERM)
    words = ["distil", "--out", str(tmp_path / "d"), "--samples", "200", "--env.count", "2", "--updates", "1"]
    teachers = [word for gait in ("--standing", "--walking", "--jumping") for word in (gait, SNAPSHOT)]
    assert main([*words, "--start-from", SNAPSHOT, *teachers]) == INTERRUPTED
    assert "stopped after 20 of 200 labels" in capsys.readouterr().out
    assert load_policy(tmp_path / "d").training["distillation"]["labels"] == 20

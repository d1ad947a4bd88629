import pathlib
import signal
from collections.abc import Callable

import pytest

from hugwbc.cli import INTERRUPTED, main
from hugwbc.learned.imitation import Imitator
from hugwbc.learned.policy import load_policy


def test_a_policy_is_made_from_the_qp(tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["imitate", "--out", str(tmp_path / "start"), "--samples", "80", "--env.count", "2", "--updates", "1"]
    assert main(words) == 0
    assert "80 labels" in capsys.readouterr().out
    assert load_policy(tmp_path / "start").training["steps"] == 80


def test_a_bad_setting_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["imitate", "--samples", "-1"]) == 2
    assert "samples" in capsys.readouterr().err


def test_ctrl_c_keeps_what_was_learnt(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str], signal_while_fitting: Callable[[type, int], None]
) -> None:
    signal_while_fitting(Imitator, signal.SIGINT)
    words = ["imitate", "--out", str(tmp_path / "start"), "--samples", "800", "--env.count", "2", "--updates", "1"]
    assert main(words) == INTERRUPTED
    assert "stopped after 80 of 800 labels" in capsys.readouterr().out
    assert load_policy(tmp_path / "start").training["steps"] == 80

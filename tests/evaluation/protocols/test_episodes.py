import dataclasses
import subprocess
import sys
import time

import pytest

from hugwbc import Gait
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.protocols.episodes import (
    CountedResult,
    GaitSettings,
    ProtocolResult,
)
from hugwbc.runtime.controllers import ControllerSpec

FACTORY = ControllerSpec("hold").build


@dataclasses.dataclass(frozen=True)
class Fallen:
    """Whether an episode ended in a fall."""

    fell: bool


@dataclasses.dataclass(frozen=True, kw_only=True)
class Counted(CountedResult[Fallen]):
    """A result with a field of its own."""

    own: int


def test_a_result_says_what_its_settings_were_and_counts_falls():
    config = GaitSettings(
        Gait.HOPPING_LEFT, True, seed=3, duration=5.0, settle=2.0, conditions=Conditions(sensing="robot")
    )
    rows = [Fallen(True), Fallen(False), Fallen(True)]
    assert Counted.of(FACTORY, config, rows, own=7) == Counted(
        **{"controller": "hold", "gait": "hopping", "seed": 3, "duration": 5.0, "settle": 2.0},
        **{"conditions": Conditions(sensing="robot"), "rows": tuple(rows), "episodes": 3, "falls": 2, "own": 7},
    )
    assert ProtocolResult.of(FACTORY, config, [1, 2]).rows == (1, 2)


@pytest.mark.slow
def test_a_killed_process_loses_only_what_was_under_way(tmp_path):
    words = ["evaluate", "small-velocities", "--controller", "qp", "--episodes", "8", "--duration", "2"]

    def start(folder: str) -> subprocess.Popen:
        places = ["--results", str(tmp_path / folder), "--json", str(tmp_path / f"{folder}.json")]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        return subprocess.Popen([sys.executable, "-m", "hugwbc.cli", *words, *places], **quiet)

    def lines() -> list[str]:
        return [line for path in (tmp_path / "cut").glob("*.jsonl") for line in path.read_text().splitlines()]

    assert start("whole").wait() == 0
    process = start("cut")
    while len(lines()) < 4 and process.poll() is None:
        time.sleep(0.05)
    process.kill()
    process.wait()
    kept = lines()
    assert 4 <= len(kept) < 9, "a head and some of the eight episodes"
    assert start("cut").wait() == 0
    assert lines()[: len(kept)] == kept and len(lines()) == 9
    assert (tmp_path / "cut.json").read_bytes() == (tmp_path / "whole.json").read_bytes()

"""Each example runs, headless and short, and its printed figures are right."""

import os
import pathlib
import re
import subprocess
import sys

import pytest

EXAMPLES = pathlib.Path(__file__).parents[1] / "examples"


def run(name, *arguments):
    result = subprocess.run(
        [sys.executable, str(EXAMPLES / name), *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        check=False,
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


def number(pattern, text):
    match = re.search(pattern, text)
    assert match, text
    return float(match.group(1))


def test_hold_and_reach():
    out = run("01_hold_and_reach.py", "--duration", "2")
    assert number(r"left hand: ([\d.]+) cm from its target, which is within reach", out) < 1.0
    # 0.9 m ahead and 0.24 m below the shoulder: 0.93 m away from an arm of 0.61 m.
    assert number(r"right hand: ([\d.]+) cm from its target, which is out of reach", out) == pytest.approx(32, abs=3)
    assert "standing" in out


def test_walk_with_qp():
    out = run("02_walk_with_qp.py", "--duration", "5")
    assert number(r"walked ([\d.]+) m/s", out) == pytest.approx(0.5, abs=0.1)
    assert "walking" in out


def test_reach_while_walking():
    out = run("03_reach_while_walking.py", "--duration", "3.5")
    assert number(r"mean hand error ([\d.]+) mm", out) < 15
    assert number(r"walked ([\d.]+) m", out) > 0.3
    assert "walking" in out


def test_examples_are_short_and_numbered():
    files = sorted(EXAMPLES.glob("*.py"))
    assert len(files) >= 3
    for number_, path in enumerate(files, 1):
        assert path.name.startswith(f"{number_:02d}_")
        assert len(path.read_text().splitlines()) <= 80


def test_a_bad_command_is_refused_before_the_robot_moves():
    result = subprocess.run(
        [sys.executable, str(EXAMPLES / "02_walk_with_qp.py"), "--v-x", "9"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode != 0
    assert "command v_x = 9 m/s is out of range" in result.stderr

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


def test_walk_with_a_cup():
    out = run("04_walk_with_a_cup.py", "--duration", "4")
    assert number(r"cup ([\d.]+) cm from its place on average", out) < 2.0
    assert number(r"walked ([\d.]+) m", out) > 0.3


def test_pick_from_the_floor():
    out = run("05_pick_from_the_floor.py", "--duration", "3", "--height", "0.7")
    assert number(r"arms alone: ([\d.]+) cm left, commanded h 0.00 m", out) > 10
    assert number(r"whole body: ([\d.]+) cm left", out) < 5
    assert number(r"whole body.*commanded h -([\d.]+) m", out) > 0.1
    assert out.count("standing") == 2


def test_carry_a_box():
    out = run("06_carry_a_box.py", "--controller", "learned", "--duration", "5.5")
    assert number(r"([\d]+) looks at the box", out) > 50
    assert number(r"hands ([\d.]+) cm apart", out) == pytest.approx(32, abs=8)


def test_compare_controllers(tmp_path):
    hands = "{left: {hold: [0.35, 0.25, 0.2]}, right: mirror}"
    (tmp_path / "reach.yaml").write_text(f"segments: [{{label: reach, duration: 1.5, hands: {hands}}}]")
    out = run("07_compare_controllers.py", "--script", str(tmp_path / "reach.yaml"))
    assert "learned: did not fall in 1.5 s" in out
    assert "qp: did not fall in 1.5 s" in out
    assert out.count("cm from their targets") == 2


def test_replay_a_motion():
    out = run("08_replay_a_motion.py", "--duration", "2")
    assert number(r"arm joints ([\d.]+) rad from their targets", out) < 0.05
    assert "standing" in out


def test_drive_live():
    pytest.importorskip("viser")
    out = run("09_drive_live.py", "--duration", "0.5")
    assert re.search(r"drive at http://127\.0\.0\.1:\d+", out)
    assert "0.5 s, standing" in out


def test_write_a_controller():
    out = run("10_write_a_controller.py", "--h", "-0.1", "--duration", "1")
    assert number(r"came to -([\d.]+) m", out) > 0.05
    assert "it does not balance" in out


def test_examples_are_short_and_numbered():
    files = sorted(EXAMPLES.glob("*.py"))
    assert len(files) == 10
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

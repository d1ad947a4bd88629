"""Each example runs, headless and short, its printed figures are right, and it leaves a replay."""

import json
import pathlib
import re
import runpy
import sys
import time

import nbclient
import nbformat
import pytest

from hugwbc.commands import COMMAND_NAMES, command_ranges
from hugwbc.gait import Gait
from hugwbc.robot import load_robot
from hugwbc.viz.live import LivePage

EXAMPLES = pathlib.Path(__file__).parents[1] / "examples"


@pytest.fixture
def start(tmp_path, monkeypatch, capsys):
    """The function that runs an example in an empty folder, in this process, and returns what it printed."""
    monkeypatch.chdir(tmp_path)

    def start(name, *arguments):
        monkeypatch.setattr(sys, "argv", [name, *arguments])
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        return capsys.readouterr().out

    return start


@pytest.fixture
def run(tmp_path, start):
    """`start` of an example that leaves a replay."""

    def run(name, *arguments):
        out = start(name, *arguments)
        replay = (tmp_path / "out" / f"{name[:2]}.html").read_text(encoding="utf-8")
        assert 'id="meshcat-pane"' in replay and "set_animation" in replay
        return out

    return run


def number(pattern, text):
    match = re.search(pattern, text)
    assert match, text
    return float(match.group(1))


def test_hold_and_reach(run):
    out = run("01_hold_and_reach.py", "--duration", "2")
    assert number(r"left hand: ([\d.]+) cm from its target, which is within reach", out) < 1.0
    # 0.9 m ahead and 0.24 m below the shoulder: 0.93 m away from an arm of 0.61 m.
    assert number(r"right hand: ([\d.]+) cm from its target, which is out of reach", out) == pytest.approx(32, abs=3)
    assert "stayed up for 2.0 s" in out


def test_walk_with_qp(run):
    out = run("02_walk_with_qp.py", "--duration", "5")
    assert number(r"walked ([\d.]+) m/s", out) == pytest.approx(0.5, abs=0.1)
    assert number(r"took (\d+) steps", out) > 10
    assert "stayed up for 5.0 s" in out


def test_reach_while_walking(run):
    out = run("03_reach_while_walking.py", "--duration", "3.5")
    assert number(r"mean hand error ([\d.]+) mm", out) < 15
    assert number(r"walked ([\d.]+) m", out) > 0.3
    assert "stayed up for 3.5 s" in out


@pytest.mark.slow
def test_walk_with_a_cup(run):
    out = run("04_walk_with_a_cup.py", "--duration", "12")
    assert number(r"The cup rose by ([\d.]+) cm", out) > 3
    assert number(r"moved by ([\d.]+) m", out) > 0.3
    assert number(r"tilted by ([\d.]+) degrees", out) < 45
    assert "fetching the cup: done" in out


@pytest.mark.slow
def test_pick_from_the_floor(run):
    out = run("05_pick_from_the_floor.py", "--duration", "5")
    alone, helped = out.split("whole body:")
    assert "arms alone: not done: reach: timeout of 4 s: the right hand is" in alone and "tolerance" in alone
    assert number(r"lifted by ([\d.]+) cm", alone) < 1
    assert number(r"lifted by ([\d.]+) cm", helped) > 20
    assert number(r"lowest h -([\d.]+) m", helped) > 0.1


def test_carry_a_box(run):
    out = run("06_carry_a_box.py", "--controller", "learned", "--duration", "1.5")
    assert 24 <= number(r"a box of ([\d.]+) cm", out) <= 32
    assert number(r"lifted by ([\d.]+) cm", out) < 1, "the robot is still on its way"
    assert "stayed up for 1.5 s; the task is not done: no hand touched the box" in out


@pytest.mark.slow
def test_a_box_is_really_carried(run):
    out = run("06_carry_a_box.py")
    assert number(r"lifted by ([\d.]+) cm", out) > 5
    assert number(r"brought ([\d.]+) m away", out) > 1
    assert "the task is done" in out


def test_compare_controllers(run, tmp_path):
    hands = "{left: {hold: [0.35, 0.25, 0.2]}, right: mirror}"
    (tmp_path / "reach.yaml").write_text(f"segments: [{{label: reach, duration: 1.5, hands: {hands}}}]")
    out = run("07_compare_controllers.py", "--script", str(tmp_path / "reach.yaml"))
    assert "learned: stayed up for 1.5 s" in out
    assert "qp: stayed up for 1.5 s" in out
    assert out.count("cm from their targets") == 2


def test_replay_a_motion(run):
    out = run("08_replay_a_motion.py", "--duration", "2")
    assert number(r"arm joints ([\d.]+) rad from their targets", out) < 0.05
    assert "stayed up for 2.0 s" in out


def test_drive_live(start, monkeypatch):
    speeds, show = [], LivePage.show

    def slow(page, simulation, **told):
        time.sleep(0.1)  # a picture shows 0.04 s
        speeds.append(told.get("speed", 1.0))
        show(page, simulation, **told)

    monkeypatch.setattr(LivePage, "show", slow)
    out = start("09_drive_live.py", "--duration", "0.5")
    assert 0.4 < speeds[-1] < 0.9, "the page tells how slow it is"
    assert re.search(r"drive at http://127\.0\.0\.1:\d+", out)
    assert "qp: 0.5 s simulated, 0 falls" in out


@pytest.mark.parametrize(("h", "w", "push"), [(-0.15, 0.8, 60.0), (0.0, -0.5, -60.0)])
def test_write_a_controller(run, h, w, push):
    out = run("10_write_a_controller.py", "--h", str(h), "--w", str(w), "--push", str(push), "--duration", "5")
    assert number(r"came to (-[\d.]+) m", out) == pytest.approx(h, abs=0.03)
    assert number(r"came to -[\d.]+ m and (-?[\d.]+) rad", out) == pytest.approx(w, abs=0.02)
    assert "stayed up for 5.0 s" in out


def test_in_your_own_simulator(start):
    out = start("13_in_your_own_simulator.py", "--duration", "12")
    assert "found h1 under 'lab/': 59.3 kg, beside lamp" in out
    assert number(r"The left hand is ([\d.]+) cm from the lamp", out) < 3
    assert "The behaviour is done" in out


@pytest.mark.slow
def test_the_notebook_shows_a_trace_plots_and_replays(tmp_path):
    notebook = nbformat.read(EXAMPLES / "tour.ipynb", as_version=4)
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    shown = [output.get("data", {}) for output in outputs]
    assert sum("image/png" in data for data in shown) == 1
    assert sum("<iframe" in data.get("text/html", "") for data in shown) == 2
    (traces,) = [data["text/plain"] for data in shown if data.get("text/plain", "").startswith("[Trace(")]
    assert traces.count("stayed up") == 2
    printed = "".join(output.text for output in outputs if output.output_type == "stream" and output.name == "stdout")
    assert "stayed up" in printed and number(r"the hand is ([\d.]+) cm", printed) < 3


def test_the_notebook_comes_without_outputs():
    cells = json.loads((EXAMPLES / "tour.ipynb").read_text(encoding="utf-8"))["cells"]
    assert not any(cell.get("outputs") or cell.get("execution_count") for cell in cells)


def test_onnx_only(start, exported_h1):
    words = ("--policy", str(exported_h1), "--model", str(load_robot().xml_path), "--v-x", "0.5", "--duration", "4")
    out = start("11_onnx_only.py", *words)
    assert 1.5 < number(r"walked ([\d.]+) m in 4.0 s and stayed up", out) < 2.5
    assert "hugwbc" not in re.findall(
        r"^\s*(?:import|from) (\w+)", (EXAMPLES / "11_onnx_only.py").read_text(), re.MULTILINE
    )


def test_the_network_alone_reads_no_higher_swing_than_commands_are():
    example = runpy.run_path(str(EXAMPLES / "11_onnx_only.py"))
    highest = command_ranges(Gait.WALKING, load_robot())["l"].finishing[1]
    contract = {"command": [{"term": "command", "scale": 1.0}]}
    for swing, read in ((0.2, 0.2), (highest + 0.3, highest)):
        row = example["command_row"](contract, example["NEUTRAL"] | {"l": swing}, 0.0)
        assert row[0, COMMAND_NAMES.index("l")] == pytest.approx(read)
    assert tuple(example["NEUTRAL"]) == COMMAND_NAMES


@pytest.mark.slow
def test_a_task_of_your_own(run):
    out = run("12_a_task_of_your_own.py")
    assert number(r"y = ([\d.]+) m", out) == pytest.approx(0.55, abs=0.1)
    assert number(r"([\d.]+) m above the floor", out) == pytest.approx(1.0, abs=0.01)
    assert "the task is done" in out


def test_every_example_is_tested_and_short():
    here = pathlib.Path(__file__).read_text(encoding="utf-8")
    for path in EXAMPLES.glob("*.py"):
        assert re.search(rf'(run|start)\("{re.escape(path.name)}"', here), f"{path.name} has no test"
        assert len(path.read_text(encoding="utf-8").splitlines()) <= 115

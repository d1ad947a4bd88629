import csv
import json
import math
import re

import pytest

from hugwbc.cli import main


def test_compare_writes_summary_report_and_replay(tmp_path, capsys):
    out, path = tmp_path / "out", tmp_path / "compare.json"
    words = ["compare", "--script", "stand", "--controllers", "hold", "--seed", "0", "--no-video"]
    words += ["--sensing", "exact"]
    assert main([*words, "--out", str(out), "--json", str(path)]) == 0
    summary = json.loads(path.read_text())
    assert summary == json.loads((out / "summary.json").read_text())
    assert summary["script"] == "stand" and summary["seed"] == 0
    hold = summary["controllers"]["hold"]
    assert hold["fell"] is True and 0.5 < hold["survived_s"] < 5.0
    assert set(hold["errors"]) == {"v_x", "v_y", "omega", "h", "p", "w"}
    assert {"mean", "p95"} <= set(hold["hand_error_m"])
    assert hold["tick_ms"]["p50"] <= hold["tick_ms"]["p99"]
    assert hold["steps"] == math.ceil(hold["survived_s"] / 0.02 - 1e-6)
    text = capsys.readouterr().out
    assert "survived [s]" in text and "hold" in text
    report = (out / "report.html").read_text()
    assert (
        "error omega [rad/s]" in report and "hand error once there, mean [cm]" in report and "nothing random" in report
    )
    for page in ("report.html", "replay.html"):
        assert "hold (fell)" in (out / page).read_text()


def test_a_scene_that_varies_is_named_with_its_seed_and_older_files_are_told(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("hugwbc.sim.scenes.objects.HIGHEST", 0.0)  # [m], the world ends below all objects
    for name in ("compare.mp4", "table.tex", "notes.txt"):
        (tmp_path / name).touch()
    words = ["compare", "--script", "stand", "--controllers", "hold", "--scene", "workshop", "--seed", "7"]
    assert main([*words, "--sensing", "exact", "--no-video", "--out", str(tmp_path)]) == 0
    assert json.loads((tmp_path / "summary.json").read_text())["scene"] == "workshop"
    report = (tmp_path / "report.html").read_text()
    assert "in the scene workshop. Robot h1, exact sensors, drives real, ground firm, seed 7 (selection)." in report
    assert "Scene of hold: object " in report and "left the world at 0.00 s." in report
    left = f"left from an earlier run: {tmp_path / 'compare.mp4'}, {tmp_path / 'table.tex'}"
    lines = capsys.readouterr().out.splitlines()
    assert left in lines and any(re.fullmatch("scene of hold: object '.*' left the world at 0.00 s", x) for x in lines)


@pytest.mark.slow
def test_the_main_job(tmp_path):
    path = tmp_path / "out.json"
    words = ["compare", "--script", "loco_manipulation", "--seed", "0", "--no-video", "--out", str(tmp_path / "out")]
    assert main([*words, "--json", str(path)]) == 0
    controllers = json.loads(path.read_text())["controllers"]
    assert set(controllers) == {"learned", "qp"}
    for name, limit in (("learned", 0.08), ("qp", 0.04)):
        assert not controllers[name]["fell"] and controllers[name]["survived_s"] == 20.0
        assert controllers[name]["hand_error_m"]["mean"] < limit
        assert controllers[name]["safety"]["failures"] == 0


def test_compare_does_a_task_with_each_controller(tmp_path, capsys, standing_task):
    task, out = standing_task("Milestone('the robot did not stand', lambda record: 1.0)"), tmp_path / "out"
    words = [
        "compare",
        "--task",
        str(task),
        "--controllers",
        "learned",
        "--seed",
        "0",
        "--no-video",
        "--sensing",
        "exact",
    ]
    assert main([*words, "--out", str(out)]) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["task"] == "stand" and summary["controllers"]["learned"]["verdict"]["success"] is True
    assert "task done" in capsys.readouterr().out
    assert "hugwbc compare: stand" in (out / "report.html").read_text() and (out / "replay.html").exists()


def test_compare_takes_a_task_or_a_script(capsys):
    assert main(["compare", "--task", "push_cart", "--script", "walk"]) == 2
    assert "give one or the other" in capsys.readouterr().err


OWN = """
from hugwbc.runtime.controllers import HoldController


class Other(HoldController):
    name = "leaning"

    def act(self, state, command, upper_body):
        joints = super().act(state, command, upper_body)
        joints.q[self.robot.index("torso_joint")] += 0.1
        return joints


class Twin(HoldController):
    name = "leaning"
"""


def test_a_table_of_an_experiment_has_paired_differences_of_controllers_by_their_own_names(tmp_path, capsys):
    (tmp_path / "own.py").write_text(OWN)
    own, out = f"{tmp_path}/own.py", tmp_path / "out"
    words = ["compare", "--experiment", "single-command", "--controllers", "hold", f"{own}:Other", f"{own}:Twin"]
    words += ["--gait", "standing", "--episodes", "6", "--duration", "0.2", "--settle", "0.1", "--seed", "3"]
    assert main([*words, "--results", str(tmp_path / "rows"), "--out", str(out), "--timestep", "0.005"]) == 0
    text = capsys.readouterr().out
    title, _, first, second, *_ = text.splitlines()
    assert f"leaning ({own}:Other)" in title and f"leaning ({own}:Twin)" in title and "HugWBC, paper" in title
    assert first.startswith("E_h [m]") and second.startswith("  minus hold")
    assert "rest on 2 or more each; below 8" in text and "6 episodes, seed 3" in text
    with (out / "figures.csv").open() as file:
        rows = {(row["quantity"], row["controller"]): row for row in csv.DictReader(file)}
    waist = [rows["E_w", f"leaning ({own}:{name})"] for name in ("Other", "Twin")]
    assert [row["against"] for row in waist] == ["hold", "hold"] and [row["pairs"] for row in waist] == ["2", "2"]
    assert float(waist[0]["difference"]) != 0.0 == float(waist[1]["difference"])
    assert len(list((tmp_path / "rows").iterdir())) == 3
    assert "\\toprule" in (out / "table.tex").read_text() and (out / "figure.svg").exists()
    assert main(["evaluate", *words[2:3], "--controller", f"{own}:Twin", *words[7:], "--timestep", "0.005"]) == 0
    assert "leaning" in capsys.readouterr().out


def test_a_table_of_a_task_takes_the_options_of_the_experiment(tmp_path, capsys, standing_task):
    task = standing_task("Milestone('the robot did not stand', lambda record: 1.0)")
    words = ["compare", "--task", str(task), "--episodes", "2", "--controllers", "hold", "--sensing", "exact"]
    assert (
        main([*words, "--results", "None", "--out", str(tmp_path / "out"), "--json", str(tmp_path / "all.json")]) == 0
    )
    assert capsys.readouterr().out.startswith("stand ")
    (result,) = json.loads((tmp_path / "all.json").read_text())
    assert len(result["rows"]) == 2 and result["settings"]["conditions"]["sensing"] == "exact"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--episodes", "3"], "--episodes is for a task or an experiment"),
        (["--experiment"], "--experiment needs a name"),
        (["--experiment", "single"], "unknown experiment 'single'"),
        (["--experiment", "hands", "--controllers", "hold", "hold"], "give at least one, each once"),
    ],
)
def test_a_table_of_nothing_is_refused(words, message, capsys):
    assert main(["compare", *words]) == 2
    assert message in capsys.readouterr().err

import json

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
    assert {"mean", "p95", "left", "right"} <= set(hold["hand_error_m"])
    assert hold["tick_ms"]["p50"] <= hold["tick_ms"]["p99"]
    assert hold["steps"] == pytest.approx(hold["survived_s"] / 0.02 + 1)
    text = capsys.readouterr().out
    assert "survived [s]" in text and "hold" in text
    report = (out / "report.html").read_text()
    assert (
        "error omega [rad/s]" in report and "hand error once there, mean [cm]" in report and "nothing random" in report
    )
    for page in ("report.html", "replay.html"):
        assert "hold (fell)" in (out / page).read_text()


def test_an_output_folder_that_cannot_be_made_is_an_error(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    words = ["compare", "--script", "stand", "--controllers", "hold", "--no-video"]
    assert main([*words, "--out", str(tmp_path / "file" / "out")]) == 2
    assert "give a path that can be written" in capsys.readouterr().err


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

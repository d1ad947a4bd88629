import csv
import json
import pathlib

from hugwbc.learned.run_log import append_row, append_session


def test_rows_and_empty_cells(tmp_path: pathlib.Path) -> None:
    append_row(tmp_path, {"iteration": 1, "x": 0.123456789}, 1)
    append_row(tmp_path, {"iteration": 2, "x": float("nan")}, 2)
    rows = list(csv.DictReader((tmp_path / "metrics.csv").open()))
    assert rows == [{"iteration": "1", "x": "0.123457"}, {"iteration": "2", "x": ""}]


def test_other_columns_start_another_file(tmp_path: pathlib.Path) -> None:
    append_row(tmp_path, {"iteration": 1, "x": 1.0}, 1)
    append_row(tmp_path, {"iteration": 2, "y": 1.0}, 2)
    assert (tmp_path / "metrics-until-1.csv").read_text().splitlines() == ["iteration,x", "1,1"]
    assert (tmp_path / "metrics.csv").read_text().splitlines() == ["iteration,y", "2,1"]
    append_row(tmp_path, {"iteration": 2, "z": 1.0}, 2)  # another run in the same folder
    assert (tmp_path / "metrics-until-1-2.csv").read_text().splitlines() == ["iteration,y", "2,1"]
    assert (tmp_path / "metrics-until-1.csv").read_text().splitlines() == ["iteration,x", "1,1"]


def test_sessions_are_lines_of_json(tmp_path: pathlib.Path) -> None:
    for i in range(2):
        append_session(tmp_path / "run", {"start_iteration": i})
    lines = (tmp_path / "run" / "sessions.jsonl").read_text().splitlines()
    assert [json.loads(line)["start_iteration"] for line in lines] == [0, 1]

import csv
import pathlib

from hugwbc.learned.policy.records import append_row, begin_log


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


def test_a_resumed_run_logs_each_iteration_once(tmp_path: pathlib.Path) -> None:
    begin_log(tmp_path, 0, resumed=True)  # there is none yet
    for iteration in (1, 2, 3):
        append_row(tmp_path, {"iteration": iteration, "x": 0.5 * iteration}, iteration)
    with (tmp_path / "metrics.csv").open("a") as file:
        file.write("4")  # cut off while it was written
    begin_log(tmp_path, 2, resumed=True)
    append_row(tmp_path, {"iteration": 3, "x": 7.0}, 3)
    rows = list(csv.DictReader((tmp_path / "metrics.csv").open(newline="")))
    assert rows == [{"iteration": str(i), "x": x} for i, x in ((1, "0.5"), (2, "1"), (3, "7"))]


def test_the_log_of_another_run_is_kept_apart(tmp_path: pathlib.Path) -> None:
    for number in (1, 2):
        append_row(tmp_path, {"iteration": number, "x": 1.0}, number)
        begin_log(tmp_path, 0, resumed=False)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["metrics-before-2.csv", "metrics-before.csv"]

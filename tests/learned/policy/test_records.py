import csv
import pathlib
import shutil

import pytest

from hugwbc.errors import ConfigError
from hugwbc.learned.config import EnvConfig, TrainConfig
from hugwbc.learned.policy.records import append_row, begin_log, check_robot, settings_record
from hugwbc.robot_tables import table_file


def test_rows_and_empty_cells(tmp_path: pathlib.Path) -> None:
    append_row(tmp_path, {"iteration": 1, "x": 0.123456789})
    append_row(tmp_path, {"iteration": 2, "x": float("nan")})
    rows = list(csv.DictReader((tmp_path / "metrics.csv").open()))
    assert rows == [{"iteration": "1", "x": "0.123457"}, {"iteration": "2", "x": ""}]


def test_a_new_column_is_empty_in_earlier_rows_and_a_lost_one_in_later_ones(tmp_path: pathlib.Path) -> None:
    append_row(tmp_path, {"iteration": 1, "x": 1.0})
    append_row(tmp_path, {"iteration": 2, "y": 1.0})
    append_row(tmp_path, {"iteration": 3, "x": 2.0, "y": 3.0})
    with (tmp_path / "metrics.csv").open(newline="") as file:
        assert list(csv.reader(file)) == [["iteration", "x", "y"], ["1", "1", ""], ["2", "", "1"], ["3", "2", "3"]]
    assert [path.name for path in tmp_path.iterdir()] == ["metrics.csv"]


def test_a_resumed_run_logs_each_iteration_once(tmp_path: pathlib.Path) -> None:
    begin_log(tmp_path, 0, resumed=True)  # there is none yet
    for iteration in (1, 2, 3):
        append_row(tmp_path, {"iteration": iteration, "x": 0.5 * iteration})
    with (tmp_path / "metrics.csv").open("a") as file:
        file.write("4")  # cut off while it was written
    begin_log(tmp_path, 2, resumed=True)
    append_row(tmp_path, {"iteration": 3, "x": 7.0})
    rows = list(csv.DictReader((tmp_path / "metrics.csv").open(newline="")))
    assert rows == [{"iteration": str(i), "x": x} for i, x in ((1, "0.5"), (2, "1"), (3, "7"))]


def test_the_log_of_another_run_is_kept_apart(tmp_path: pathlib.Path) -> None:
    for number in (1, 2):
        append_row(tmp_path, {"iteration": number, "x": 1.0})
        begin_log(tmp_path, 0, resumed=False)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["metrics-before-2.csv", "metrics-before.csv"]


def test_a_network_for_a_robot_whose_table_has_gone_says_so() -> None:
    with pytest.raises(ConfigError, match=r"snapshot is for the robot /gone/mine\.yaml, whose table is not there"):
        check_robot("snapshot", "/gone/mine.yaml", "h1")


def test_a_record_says_the_same_of_a_robot_of_ones_own_in_another_folder(tmp_path: pathlib.Path) -> None:
    records = []
    for place in ("here", "there"):
        folder = tmp_path / place / "mine"
        shutil.copytree(table_file("g1").parent, folder, ignore=shutil.ignore_patterns("policies", "recipes"))
        (folder / "g1.yaml").rename(folder / "mine.yaml")
        records.append(settings_record(TrainConfig(out=tmp_path, env=EnvConfig(robot=str(folder)))))
    assert records[0] == records[1] and records[0]["env"]["robot"] == "mine/mine.yaml"

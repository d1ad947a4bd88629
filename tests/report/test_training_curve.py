import numpy as np
import pytest

from hugwbc.errors import ConfigError
from hugwbc.report.training_curve import read_training, smoothed


def test_columns_with_empty_cells(tmp_path):
    path = tmp_path / "training.csv"
    path.write_text("steps,reward\n10,0.5\n20,\n")
    record = read_training(path)
    np.testing.assert_array_equal(record["steps"], [10, 20])
    np.testing.assert_array_equal(record["reward"], [0.5, np.nan])


def test_other_files_are_refused(tmp_path):
    path = tmp_path / "training.csv"
    for text, message in (
        ("a,b\n1,2\n", "no column 'steps'"),
        ("", "is not a training record"),
        ("steps,r\n1,x\n", "is not a training record"),
        ("steps,r\n1,2,3\n", "is not a training record"),
    ):
        path.write_text(text)
        with pytest.raises(ConfigError, match=message):
            read_training(path)


def test_running_mean_leaves_out_what_is_not_known():
    np.testing.assert_allclose(smoothed(np.array([1.0, np.nan, 3.0, 5.0]), 3), [1.0, 2.0, 4.0, 4.0])

import pytest

from hugwbc.errors import HugwbcError
from hugwbc.scripts.recorded_path import Recorded, read_path


def test_a_recorded_path_is_read_from_csv(tmp_path):
    file = tmp_path / "path.csv"
    file.write_text("t,x,y,z\n0,0.3,0.2,0.1\n2,0.5,0.2,0.3\n")
    path = read_path(str(file))
    assert path == read_path(file)
    assert path.at(-1.0) == pytest.approx([0.3, 0.2, 0.1])
    assert path.at(1.0) == pytest.approx([0.4, 0.2, 0.2])
    assert path.at(9.0) == pytest.approx([0.5, 0.2, 0.3])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ":1: the header is missing"),
        ("a,b\n", ":1: the header is a,b; write t,x,y,z"),
        ("t,x,y,z\n0,0,0,0\n1,2,3\n", r":3: '1,2,3' is not four numbers"),
        ("t,x,y,z\n0,0,0,0\n0,0,0,0\n", "times do not rise"),
        ("t,x,y,z\n0,0,0,0\n1,0,0,nan\n", r"points.1.2 is nan"),
        ("t,x,y,z\n", "recorded path has 0 times"),
        ("t,x,y,z\n0,0,0,0\n\n1,2,3\n", r":4: '1,2,3' is not four numbers"),
    ],
)
def test_bad_recordings_are_refused(tmp_path, text, message):
    (tmp_path / "path.csv").write_text(text)
    with pytest.raises(HugwbcError, match=message):
        read_path(tmp_path / "path.csv")
    with pytest.raises(HugwbcError, match="cannot read the hand path"):
        read_path(tmp_path / "missing.csv")


def test_a_spreadsheets_mark_and_empty_lines_are_read_over(tmp_path):
    file = tmp_path / "path.csv"
    file.write_bytes(b"\xef\xbb\xbft,x,y,z\r\n0,0.3,0.2,0.1\r\n\r\n2,0.5,0.2,0.3\r\n\r\n")
    assert read_path(file) == Recorded((0.0, 2.0), ((0.3, 0.2, 0.1), (0.5, 0.2, 0.3)))


def test_points_of_unequal_length_are_refused():
    with pytest.raises(HugwbcError, match="points"):
        Recorded((0.0, 1.0), ((0.0, 0.0, 0.0), (1.0, 2.0)))  # type: ignore[arg-type]
    with pytest.raises(HugwbcError, match="2 times and 1 points"):
        Recorded((0.0, 1.0), ((0.0, 0.0, 0.0),))

import math

import numpy as np
import pytest

from hugwbc.errors import HugwbcError
from hugwbc.scripts import HandMotion
from hugwbc.scripts.hand_paths import Circle, Grid, HandPath, Hold, Line, Recorded, Swing, Wander, read_path

A, B, C = (0.3, 0.2, 0.1), (0.3, 0.2, 0.3), (0.5, 0.2, 0.3)


def test_swing_by_hand():
    swing = Swing(centre=(0.3, 0.2, 0.1), amplitude=(0.1, 0.0, 0.05), phase=(0.0, 0.0, 0.25), period=2.0)
    assert swing.at(0.0) == pytest.approx([0.3, 0.2, 0.15])
    assert swing.at(0.5) == pytest.approx([0.4, 0.2, 0.1])
    assert swing.mirrored().at(0.5) == pytest.approx([0.4, -0.2, 0.1])


def test_a_line_dwells_at_its_points_and_stays_at_the_last():
    line = Line((A, B, C), leg_time=2.0, dwell=1.0)
    for t, point in ((-1.0, A), (0.0, A), (1.0, A), (3.0, B), (4.0, B), (6.0, C), (60.0, C)):
        assert line.at(t) == pytest.approx(point)
    assert line.at(2.0) == pytest.approx([0.3, 0.2, 0.2])


def test_a_repeated_line_goes_back_the_way_it_came():
    line = Line((A, B, C), leg_time=1.0, repeat=True)
    for t, point in ((0.0, A), (1.0, B), (2.0, C), (3.0, B), (4.0, A), (5.0, B)):
        assert line.at(t) == pytest.approx(point)


def test_a_grid_visits_each_point_once_going_to_a_neighbour():
    grid = Grid(centre=(0.3, 0.0, 0.2), size=(0.2, 0.4, 0.6), count=(2, 3, 3), leg_time=1.0, dwell=0.5)
    points = np.array(grid.points)
    assert len(np.unique(points.round(9), axis=0)) == len(points) == 18
    assert points.min(axis=0) == pytest.approx([0.2, -0.2, -0.1])
    assert points.max(axis=0) == pytest.approx([0.4, 0.2, 0.5])
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() == pytest.approx(0.3), "never further than one spacing"
    assert grid.at(1.7) == pytest.approx(points[1])


@pytest.mark.parametrize(("axis", "start"), [("x", [0, 0.1, 0]), ("y", [0, 0, 0.1]), ("z", [0.1, 0, 0])])
def test_a_circle_turns_counter_clockwise_about_its_axis(axis, start):
    circle = Circle(centre=A, radius=0.1, axis=axis, period=4.0)
    arm = np.array([circle.at(t) - A for t in (0.0, 1.0, 2.0)])
    assert arm[0] == pytest.approx(start)
    assert np.cross(arm[0], arm[1]) == pytest.approx(0.01 * np.eye(3)["xyz".index(axis)])
    assert arm[2] == pytest.approx(-arm[0])


def test_wandering_is_the_same_for_a_seed_and_stays_in_its_box():
    wander = Wander(centre=A, size=(0.2, 0.1, 0.4), leg_time=0.5, seed=3)
    times = np.arange(0.0, 20.0, 0.01)
    points = np.array([wander.at(t) for t in times])
    assert np.all(np.abs(points - A) <= [0.1, 0.05, 0.2])
    assert np.ptp(points, axis=0) == pytest.approx([0.2, 0.1, 0.4], rel=0.2)
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() < 0.5 / 0.5 * 1.875 * 0.01, "no jumps"
    assert Wander(centre=A, size=(0.2, 0.1, 0.4), leg_time=0.5, seed=3).at(7.3) == pytest.approx(wander.at(7.3))
    assert not np.allclose(Wander(centre=A, size=(0.2, 0.1, 0.4), leg_time=0.5, seed=4).at(7.3), wander.at(7.3))


COUNTS = ((1, 1, 1), (2, 2), (math.inf, 1, 1), (math.nan, 2, 2), (1.5, 2, 2), (1000, 1000, 1000))


@pytest.mark.parametrize("count", COUNTS)
def test_a_grid_has_two_points_or_more_and_an_end(count):
    with pytest.raises(HugwbcError, match="count"):
        Grid(centre=A, size=A, count=count)


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
        ("t,x,y,z\n0,0,0,0\n1,2,3\n", r":3: 3 numbers for 4 columns"),
        ("t,x,y,z\n0,0,0,0\n0,0,0,0\n", "times do not rise"),
        (
            "t,x,y,z\n0,0,0,0\n1,0,0,nan\n",
            "1 of 2 samples are not finite, the first at t = 1 s; fill the gap, or delete",
        ),
        (
            "t,x,y,z\n0.01,0,0,0\n0.01,0,0,0.1\n0.02,0,0,0.2\n",
            "1 times do not rise, the first from 0.01 to 0.01 s; .* with enough decimals",
        ),
        ("t,x,y,z\n0.02,0,0,0\n0.01,0,0,0\n", r"from 0\.02 to 0\.01 s; sort the samples"),
        ("t,x,y,z\n", "recorded path has 0 times"),
        ("t,x,y,z\n0,0,0,0\n\n1,2,3\n", r":4: 3 numbers for 4 columns"),
    ],
)
def test_bad_recordings_are_refused(tmp_path, text, message):
    (tmp_path / "path.csv").write_text(text)
    with pytest.raises(HugwbcError, match=message):
        read_path(tmp_path / "path.csv")
    with pytest.raises(HugwbcError, match=r"cannot read .*missing\.csv"):
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


TIME = np.arange(0.0, 4.0, 0.02)  # a hand that swings by 8 cm, every 2 s
SWING = np.stack([0.3 + 0.08 * np.sin(np.pi * TIME), 0.2 + 0.0 * TIME, 0.15 + 0.0 * TIME], axis=1)


def recorded(time=TIME, points=SWING) -> Recorded:
    return Recorded(tuple(time), tuple(map(tuple, points)))


@pytest.mark.parametrize("start", [1764208000.0, 2.5, -1.0])
def test_a_path_starts_with_its_first_sample_on_any_clock(start, caplog):
    path = HandMotion(recorded(start + TIME), None)
    for t in (0.0, 0.5, 1.5, 9.0):
        assert path.at(t).left == pytest.approx(recorded().at(t), abs=1e-6)
    assert len(caplog.messages) == 1 and "it is played from there" in caplog.text


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "milli"), (1e6, "micro"), (1e9, "nano")])
def test_times_in_other_units_are_told(factor, unit):
    with pytest.raises(HugwbcError, match=f"times look like {unit}seconds; give seconds"):
        HandMotion(recorded(factor * (1764208000.0 + TIME)), None)


def after(t: float, points: np.ndarray) -> np.ndarray:
    return np.where(TIME[:, None] > t, points, SWING)


@pytest.mark.parametrize(
    ("points", "frame", "message"),
    [
        (1e3 * SWING, "pelvis", r"100% of its samples beyond 1\.5 m, the first at 0\.00 s; give metres: divide millim"),
        (1e3 * SWING, "world", r"goes up to 150\.0 m above or below the floor"),
        (after(2.0, 1e2 * SWING), "heading", r"50% of its samples beyond 1\.5 m, the first at 2\.0. s"),
        (after(2.0, 1e2 * SWING - np.array([0, 0, 14])), "world", r"jumps by .* at 2\.000 s.*same unit"),
        (after(2.0, SWING + np.array([0.3, 0.0, 0.0])), "pelvis", r"jumps by 0\.305 m within 0\.02 s at 2\.000 s"),
    ],
)
def test_all_points_of_a_path_are_checked(points, frame, message):
    with pytest.raises(HugwbcError, match=message):
        HandMotion(None, recorded(points=points), frame)


class Flight(HandPath):
    def at(self, t):
        return np.array([0.3, 0.2, 0.1 if t < 30.0 else math.nan])


@pytest.mark.parametrize(
    ("path", "message"),
    [
        (Line(((0.3, 0.2, 0.1), (40.0, 20.0, 10.0))), r"goes up to 45\.8 m .*with 50%"),
        (Line(((0.3, 0.2, 0.1), (0.4, 0.2, 0.1)), leg_time=1000.0), "look like milliseconds"),
        (Circle((0.3, 0.2, 0.1), 10.0).mirrored(), r"goes up to 10\.\d m from the pelvis"),
        (Circle((0.3, 0.2, 0.1), 0.1, period=0.05), "faster than 5 m/s"),
        (Circle((0.3, 0.2, 0.1), 0.04, period=0.001), "faster than 5 m/s"),
        (Swing((0.3, 0.2, 0.1), (0.0, 0.3, 0.0), period=0.2), "faster than 5 m/s"),
        (Wander((0.3, 0.2, 0.1), (0.3, 0.3, 0.3), leg_time=0.01), "faster than 5 m/s"),
        (Hold((300.0, 200.0, 100.0)), "divide millimetres by 1000"),
        (Flight(), "goes up to nan m"),
    ],
)
def test_paths_made_in_python_are_checked_likewise(path, message):
    with pytest.raises(HugwbcError, match=message):
        HandMotion(path, None)


@pytest.mark.parametrize("path", [Line((A, C), leg_time=0.01, dwell=1.0), Grid(A, (0.1, 0.1, 0.1), leg_time=0.001)])
def test_a_pause_does_not_hide_a_jump(path):
    with pytest.raises(HugwbcError, match=r"jumps by .* within 0\.0"):
        HandMotion(left=path)
    assert HandMotion(left=Line((A, C), leg_time=0.1, dwell=1.0))


def test_rounded_stamps_and_bursts_are_no_jumps():
    rng = np.random.default_rng(0)
    time = np.round(np.cumsum(rng.choice([0.001, 0.029, 0.03], len(TIME))), 3)
    assert HandMotion(recorded(time, SWING + rng.normal(0.0, 0.002, SWING.shape)), None).left is not None

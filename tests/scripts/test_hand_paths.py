import math

import numpy as np
import pytest

from hugwbc.errors import HugwbcError
from hugwbc.scripts.hand_paths import Circle, Grid, Hold, Line, Swing, Wander

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


@pytest.mark.parametrize(
    ("path", "fields", "word"),
    [
        (Swing, {"centre": (0.3, math.nan, 0.1)}, r"centre\.1 is nan"),
        (Swing, {"centre": A, "amplitude": (0.1, 0.1)}, "amplitude"),
        (Swing, {"centre": A, "period": 0.0}, "period is 0"),
        (Line, {"points": (A,)}, "points .* at least 2"),
        (Line, {"points": (A, (0.0, 0.0, math.inf))}, r"points\.1\.2"),
        (Line, {"points": (A, B), "dwell": -1.0}, "dwell is -1"),
        (Grid, {"centre": A, "size": A, "leg_time": 0.0}, "leg_time"),
        *((Grid, {"centre": A, "size": A, "count": count}, "count") for count in
          ((1, 1, 1), (2, 2), (math.inf, 1, 1), (math.nan, 2, 2), (1.5, 2, 2), (1000, 1000, 1000))),
        (Circle, {"centre": A, "radius": -1.0}, "radius is -1"),
        (Circle, {"centre": A, "radius": 0.1, "axis": "w"}, "axis 'w'"),
        (Wander, {"centre": A, "size": A, "seed": 0.5}, "seed"),
        (Hold, {"point": (0.0, 1.0)}, "point"),
    ],
)  # fmt: skip
def test_bad_paths_are_refused(path, fields, word):
    with pytest.raises(HugwbcError, match=word):
        path(**fields)

"""Marks as geoms of MuJoCo, against the marks themselves."""

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from hugwbc.viz.marks import FORCE_SCALE
from hugwbc.viz.overlays import LAYERS
from hugwbc.viz.video_marks import GEOM_NUMBERS, mark_geoms

RED = (0xD1 / 255, 0x38 / 255, 0x4B / 255)
TYPE, SIZE, POSITION, TURN, RGB = 0, slice(1, 4), slice(4, 7), slice(7, 16), slice(16, 19)


def geoms_of(run: object, sample: int, *layers: str) -> np.ndarray:
    (rows,) = mark_geoms(run, np.array([sample]), "#3b7dd8", 0.5, layers)  # type: ignore[arg-type]
    return rows


def test_hand_targets_are_balls_where_the_targets_are(make_run: Callable) -> None:
    run = make_run()
    rows = geoms_of(run, -1, "hands")
    balls = rows[(rows[:, TYPE] == int(mujoco.mjtGeom.mjGEOM_SPHERE)) & (rows[:, 19] == 0.75)]
    assert balls[:, POSITION] == pytest.approx(run.hand_target_world[-1] + [0.0, 0.5, 0.0])
    rows = geoms_of(run, 0, "hands")
    assert not np.any(rows[:, 19] == 0.75), "no targets yet"


def test_a_force_is_an_arrow_from_its_point_along_it_a_millimetre_for_a_newton(make_run: Callable) -> None:
    run = make_run()
    rows = geoms_of(run, 10, "forces")
    assert rows[:, TYPE].tolist() == [int(mujoco.mjtGeom.mjGEOM_ARROW)]
    (foot,) = np.flatnonzero(run.foot_contact[10])
    assert rows[0, POSITION] == pytest.approx(run.pressure_centre[10, foot] + [0.0, 0.5, 0.0])
    tip = rows[0, SIZE][2] * rows[0, TURN].reshape(3, 3)[:, 2]
    assert tip == pytest.approx(FORCE_SCALE * run.foot_force[10, foot])
    assert rows[0, RGB] == pytest.approx(RED)


def test_the_plumb_line_is_a_cylinder_from_the_ground_to_the_centre_of_mass(make_run: Callable) -> None:
    rows = geoms_of(make_run(), 10, "balance")
    (centre,) = rows[rows[:, TYPE] == int(mujoco.mjtGeom.mjGEOM_SPHERE)]
    rods = rows[rows[:, TYPE] == int(mujoco.mjtGeom.mjGEOM_CYLINDER)]
    plumb = rods[np.argmax(rods[:, 2])]
    assert np.abs(plumb[TURN].reshape(3, 3)[2, 2]) == pytest.approx(1.0)
    assert plumb[POSITION] + [0.0, 0.0, plumb[2]] == pytest.approx(centre[POSITION])


def test_footprints_stay_from_the_touch_down_on(make_run: Callable) -> None:
    run = make_run(seconds=2.0)
    planned = np.isfinite(run.foothold).all(axis=2).sum(axis=1)
    touch_downs = np.sort(np.concatenate(run.touch_downs))
    assert touch_downs.tolist() == [0.5, 1.0, 1.5]
    for sample in (0, 24, 25, 49, 50, 74, 75, 99):
        prints = len(geoms_of(run, sample, "steps")) - planned[sample]
        assert prints == np.count_nonzero(touch_downs <= run.time[sample])


def test_every_layer_has_geoms_of_its_own_and_none_gives_none(make_run: Callable) -> None:
    run = make_run()
    counts = [len(geoms_of(run, -1, layer)) for layer in LAYERS]
    assert min(counts) > 0
    assert len(geoms_of(run, -1, *LAYERS)) == sum(counts)
    assert geoms_of(run, -1).shape == (0, GEOM_NUMBERS)
    for row in geoms_of(run, -1, *LAYERS):
        turn = row[TURN].reshape(3, 3)
        assert turn.T @ turn == pytest.approx(np.eye(3), abs=1e-9)
        assert np.linalg.det(turn) == pytest.approx(1.0)

"""Video, or the reason why there is none; marks as geoms of MuJoCo, against the marks themselves."""

import dataclasses
import os
import pathlib
from collections.abc import Callable

import imageio.v2 as imageio
import mujoco
import numpy as np
import pytest

from hugwbc.sim.scenes import Scene, Tray
from hugwbc.viz import video
from hugwbc.viz.framing import Chapter
from hugwbc.viz.marks import FORCE_SCALE, LAYERS
from hugwbc.viz.video import GEOM_NUMBERS, mark_geoms

RED = (0xD1 / 255, 0x38 / 255, 0x4B / 255)
TYPE, SIZE, POSITION, TURN, RGB = 0, slice(1, 4), slice(4, 7), slice(7, 16), slice(16, 19)


def test_a_video_has_the_frames_of_the_longest_run(make_run: Callable, tmp_path: pathlib.Path) -> None:
    path, progress = tmp_path / "runs.mp4", []
    reason = video.write_video(path, [make_run(seconds=0.2), make_run(seconds=0.1)], on_progress=progress.append)
    assert reason is None, reason
    with imageio.get_reader(path) as reader:
        frames = list(reader.iter_data())
    assert len(frames) == 5 and frames[0].shape == (720, 1280, 3)
    assert np.ptp(frames[0]) > 100
    assert progress[-1] == 1.0


def test_names_clock_and_segment_are_written_into_the_picture(make_run: Callable) -> None:
    runs = [make_run(seconds=2.0), make_run(name="learned", seconds=1.0, fell=True)]
    texts = video.captions(runs, [Chapter(0.0, "stand"), Chapter(1.2, "walk")])
    assert texts[0] == {"names": [("qp", "#2f7fd6"), ("learned", "#e0702a")], "clock": "0.0 s", "chapter": "stand"}
    assert texts[24]["names"][1][0] == "learned" and texts[25]["names"][1][0] == "learned (fell)"
    assert [text["chapter"] for text in texts].index("walk") == 30 and texts[30]["clock"] == "1.2 s"
    blank = np.full((720, 1280, 3), 128, dtype=np.uint8)
    picture = video.write_captions(blank, texts[30])
    changed = np.any(picture != blank, axis=2)
    corners = [changed[:120, :400], changed[:120, 1000:], changed[640:, 400:880]]
    assert all(corner.sum() > 200 for corner in corners)
    assert changed.sum() == sum(corner.sum() for corner in corners), "and nothing elsewhere"
    assert np.any(np.all(picture == (0x2F, 0x7F, 0xD6), axis=2)), "in the robot's colour"


def test_video_without_opengl_gives_a_reason(make_run, tmp_path, monkeypatch):
    monkeypatch.setattr(video, "renderer_environment", lambda: {"MUJOCO_GL": "nonsense"})
    reason = video.write_video(tmp_path / "runs.mp4", [make_run(seconds=0.1)])
    assert reason is not None
    assert reason.startswith("no video: ") and "nonsense" in reason and "libegl1" in reason
    assert not (tmp_path / "runs.mp4").exists()


def test_a_renderer_that_dies_in_the_middle_leaves_the_old_video(make_run, tmp_path, monkeypatch):
    path, renderer = tmp_path / "runs.mp4", tmp_path / "renderer"
    path.write_bytes(b"the video of an earlier run")
    renderer.write_text('#!/bin/sh\nfor last; do :; done\necho half > "$last"\necho out of memory >&2\nexit 1\n')
    renderer.chmod(0o755)
    monkeypatch.setattr(video.sys, "executable", str(renderer))
    reason = video.write_video(path, [make_run(seconds=0.1)])
    assert reason is not None and reason.startswith("no video: out of memory")
    assert path.read_bytes() == b"the video of an earlier run"


def test_no_renderer_goes_on_after_an_error_of_the_caller(make_run, tmp_path, monkeypatch):
    renderer, number = tmp_path / "renderer", tmp_path / "number"
    renderer.write_text(f"#!/bin/sh\necho $$ > {number}\nwhile echo 1; do sleep 0.05; done\n")
    renderer.chmod(0o755)
    monkeypatch.setattr(video.sys, "executable", str(renderer))

    def stop(part: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        video.write_video(tmp_path / "runs.mp4", [make_run(seconds=0.1)], on_progress=stop)
    with pytest.raises(ProcessLookupError):
        os.kill(int(number.read_text()), 0)


def geoms_of(run: object, sample: int, *layers: str) -> np.ndarray:
    (rows,) = mark_geoms(run, np.array([sample]), "#3b7dd8", 0.5, layers)  # type: ignore[arg-type]
    return rows


def test_a_force_is_an_arrow_from_its_point_along_it_a_millimetre_for_a_newton(make_run: Callable) -> None:
    run = make_run()
    rows = geoms_of(run, 10, "forces")
    assert rows[:, TYPE].tolist() == [int(mujoco.mjtGeom.mjGEOM_ARROW)]
    (foot,) = np.flatnonzero(run.foot_contact[10])
    assert rows[0, POSITION] == pytest.approx(run.pressure_centre[10, foot] + [0.0, 0.5, 0.0])
    tip = rows[0, SIZE][2] * rows[0, TURN].reshape(3, 3)[:, 2]
    assert tip == pytest.approx(FORCE_SCALE * run.foot_force[10, foot])
    assert rows[0, RGB] == pytest.approx(RED)


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


def test_the_shapes_of_objects_are_where_the_record_says(make_run: Callable) -> None:
    run = make_run(seconds=0.2)
    scene = Scene((Tray(name="tray", position=(1.0, 0.0)),))
    poses = np.tile(
        [[1.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0], [1.0, 0.1, 0.7, np.sqrt(0.5), np.sqrt(0.5), 0, 0]], (10, 1, 1)
    )
    among = dataclasses.replace(run, scene=scene, object_pose=poses, hand_force=np.zeros((10, 2, 3)))
    names, placed = video._object_poses([run, among], [np.array([0, 5]), np.array([0, 5])])
    assert names == ["1_around/tray", "1_around/tray/cup"]
    np.testing.assert_allclose(placed[1, 1, :3], [1.0, 0.85, 0.7])  # in the second lane
    model = video._stage([run, among])
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    video._place(model, data, np.array([model.body(name).id for name in names]), placed[1])
    cup = int(model.body("1_around/tray/cup").geomadr[0])
    np.testing.assert_allclose(data.geom_xpos[cup], [1.0, 0.85, 0.7])
    np.testing.assert_allclose(data.geom_xmat[cup].reshape(3, 3)[:, 2], [0.0, -1.0, 0.0], atol=1e-9)  # it lies
    assert model.joint("0_left_knee_joint").qposadr[0] < model.joint("1_right_elbow_joint").qposadr[0] < 52

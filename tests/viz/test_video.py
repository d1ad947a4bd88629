"""Video, or the reason why there is none."""

import pathlib
from collections.abc import Callable

import imageio.v2 as imageio
import numpy as np
import pytest

from hugwbc.errors import UnknownNameError
from hugwbc.viz import video


def test_video_is_written_or_says_why_not(make_run: Callable, tmp_path: pathlib.Path) -> None:
    path, progress = tmp_path / "runs.mp4", []
    reason = video.write_video(path, [make_run(seconds=0.2), make_run(seconds=0.1)], on_progress=progress.append)
    if reason is None:
        with imageio.get_reader(path) as reader:
            frames = list(reader.iter_data())
        assert frames[0].shape == (448, 800, 3)
        assert len(frames) == 5
        assert np.ptp(frames[0]) > 100
        assert progress[-1] == 1.0
    else:
        assert reason.startswith("no video: ")
        assert "\n" not in reason


def test_an_unknown_layer_is_refused_before_anything_is_drawn(make_run: Callable, tmp_path: pathlib.Path) -> None:
    with pytest.raises(UnknownNameError, match="unknown layer 'force'"):
        video.write_video(tmp_path / "runs.mp4", [make_run(seconds=0.1)], hide=["force"])
    assert not (tmp_path / "runs.mp4").exists()


def test_video_without_opengl_gives_a_reason(
    make_run: Callable, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(video, "_environment", lambda: {"MUJOCO_GL": "nonsense"})
    reason = video.write_video(tmp_path / "runs.mp4", [make_run(seconds=0.1)])
    assert reason is not None
    assert reason.startswith("no video: ") and "nonsense" in reason and "libegl1" in reason
    assert not (tmp_path / "runs.mp4").exists()


def test_a_renderer_that_dies_in_the_middle_leaves_the_old_video(
    make_run: Callable, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, renderer = tmp_path / "runs.mp4", tmp_path / "renderer"
    path.write_bytes(b"the video of an earlier run")
    renderer.write_text('#!/bin/sh\nfor last; do :; done\necho half > "$last"\necho out of memory >&2\nexit 1\n')
    renderer.chmod(0o755)
    monkeypatch.setattr(video.sys, "executable", str(renderer))
    reason = video.write_video(path, [make_run(seconds=0.1)])
    assert reason is not None and reason.startswith("no video: out of memory")
    assert path.read_bytes() == b"the video of an earlier run"


def test_a_video_that_cannot_be_put_where_it_should_be_has_a_reason(
    make_run: Callable, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    renderer = tmp_path / "renderer"
    renderer.write_text('#!/bin/sh\nfor last; do :; done\necho all > "$last"\n')
    renderer.chmod(0o755)
    monkeypatch.setattr(video.sys, "executable", str(renderer))
    assert video.write_video(tmp_path / "runs.mp4", [make_run(seconds=0.1)]) is None
    assert (tmp_path / "runs.mp4").read_text() == "all\n"
    reason = video.write_video(renderer / "runs.mp4", [make_run(seconds=0.1)])
    assert reason is not None and "cannot write" in reason

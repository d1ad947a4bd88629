"""A record that was saved is the same record when it is loaded, and other files are refused."""

import dataclasses

import numpy as np
import pytest

from hugwbc.errors import ConfigError
from hugwbc.runtime import SafetyReport, Trace, read_trace, trace, write_trace
from hugwbc.runtime.trace import scene_text
from hugwbc.settings_file import parse
from hugwbc.sim.scenes import Box, Scene, Table, load_scene


def test_a_saved_record_comes_back_whole(make_run, tmp_path):
    scene = Scene((Table(name="desk", position=(2.0, 0.0)), Box(name="parcel", on="desk", size=(0.2, 0.2, 0.2))))
    run = make_run(seconds=2.0, fell=True)
    run = dataclasses.replace(
        run,
        scene=scene,
        object_pose=np.zeros((len(run.time), 2, 7)),
        hand_force=np.ones((len(run.time), 2, 3)),
        problems=("parcel left the world",),
        safety=SafetyReport(ticks=7, commands_guarded={"l": 3}, messages=("command l is high",)),
    )
    path = write_trace(tmp_path / "deep" / "run", run)
    assert path == tmp_path / "deep" / "run.npz"
    _assert_same(run, read_trace(path))


def _assert_same(run, loaded):
    for field in dataclasses.fields(Trace):
        before, after = getattr(run, field.name), getattr(loaded, field.name)
        if isinstance(before, np.ndarray):
            np.testing.assert_array_equal(before, after, err_msg=field.name)
            assert before.dtype == after.dtype
        elif isinstance(before, tuple) and len(before) == 2:
            for one, other in zip(before, after, strict=True):
                np.testing.assert_array_equal(one, other, err_msg=field.name)
        else:
            assert before == after, field.name


@pytest.mark.parametrize("name", ["parcel", "workshop"])
def test_the_text_of_a_scene_is_the_scene(name, tmp_path):
    scene = load_scene(name).draw(3)
    assert parse(Scene, scene_text(scene), tmp_path / "scene.yaml") == scene


def test_the_line_for_people_is_short(make_run):
    run = make_run(seconds=2.0)
    assert repr(run) == "Trace('qp', 100 samples, stayed up for 2.0 s, h1)"
    assert "knelt down" in repr(dataclasses.replace(run, safety=dataclasses.replace(run.safety, lowered=1)))
    assert "fell after 1.0 s" in repr(make_run(fell=True))


def test_other_files_are_refused(tmp_path, make_run, monkeypatch):
    with pytest.raises(ConfigError, match="give a file that write_trace wrote"):
        read_trace(tmp_path / "nothing.npz")
    (tmp_path / "text.npz").write_text("no archive")
    with pytest.raises(ConfigError, match="give a file that write_trace wrote"):
        read_trace(tmp_path / "text.npz")
    np.savez(tmp_path / "other.npz", positions=np.zeros(3))
    with pytest.raises(ConfigError, match="is not a recorded run"):
        read_trace(tmp_path / "other.npz")
    with monkeypatch.context() as older:
        older.setattr(trace, "_FORMAT", trace._FORMAT - 1)
        old = write_trace(tmp_path / "old.npz", make_run())
    with pytest.raises(ConfigError, match="was written by another version of hugwbc; run it again"):
        read_trace(old)
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="give a path that can be written"):
        write_trace(tmp_path / "file" / "run.npz", make_run())


def test_a_damaged_record_is_refused_or_read_as_it_was(tmp_path, make_run):
    run, rng, refused = make_run(seconds=1.0), np.random.default_rng(0), 0
    path = write_trace(tmp_path / "run.npz", run)
    whole = path.read_bytes()
    damaged = [bytearray(whole) for _ in range(200)]
    for content in damaged:
        content[rng.integers(len(content))] ^= 0xFF
    for content in (b"", whole[:100], whole[: len(whole) // 2], *damaged):
        path.write_bytes(content)
        try:
            loaded = read_trace(path)
        except ConfigError:
            refused += 1
        else:
            _assert_same(run, loaded)
    assert refused > 100

import dataclasses
import pathlib
import pickle
import re
import zipfile

import numpy as np
import pytest

from hugwbc.errors import ConfigError, HugwbcError
from hugwbc.robot import load_robot
from hugwbc.scripts import Segment
from hugwbc.scripts.motion import (
    LARGEST_MOTION,
    ArmMotion,
    arm_noise_range,
    generate_motions,
    load_motion,
    load_motions,
)

ROBOT = load_robot()

ARMS = load_robot().arm_names


def write(path: pathlib.Path, **changes: object) -> pathlib.Path:
    fields = {"fps": np.array(30.0), "joint_names": np.array(ARMS), "positions": np.zeros((4, 8))}
    np.savez(path, **{name: value for name, value in (fields | changes).items() if value is not None})
    return path


def test_noise_range_is_the_papers_mirrored_and_within_limits(robot) -> None:
    low, high = arm_noise_range(ROBOT)
    assert low.tolist() == pytest.approx([-2.6, -0.3, -1.2, -1.2, -2.6, -3.0, -4.3, -1.2])
    assert high.tolist() == pytest.approx([2.6, 3.0, 4.3, 2.5, 2.6, 0.3, 1.2, 2.5])
    assert (low >= robot.lower[robot.arms]).all() and (high <= robot.upper[robot.arms]).all()


def test_an_arm_whose_joint_turns_the_other_way_is_moved_as_far_to_each_side() -> None:
    g1, axes = load_robot("g1"), load_robot("g1").axes.copy()
    rolls = g1.pair("shoulder_roll")
    axes[rolls] *= -1.0
    lower, upper = g1.lower.copy(), g1.upper.copy()
    lower[rolls], upper[rolls] = -g1.upper[rolls], -g1.lower[rolls]
    low, high = arm_noise_range(dataclasses.replace(g1, axes=axes, lower=lower, upper=upper))
    before, after = arm_noise_range(g1)
    turned = np.isin(g1.arms, rolls)
    np.testing.assert_allclose(np.where(turned, -high, low), before)
    np.testing.assert_allclose(np.where(turned, -low, high), after)


def test_resampling_is_linear_in_time() -> None:
    motion = ArmMotion("m", 20.0, np.linspace(0.0, 1.0, 3)[:, None] * np.arange(8), ROBOT)  # 0.1 s
    fast = motion.resampled(50.0)
    assert fast.fps == 50.0 and fast.positions.shape == (6, 8)
    np.testing.assert_allclose(fast.positions, np.linspace(0.0, 1.0, 6)[:, None] * np.arange(8), atol=1e-12)
    # At 40 Hz from 30 Hz the last frame lies beyond the end: 4 frames are 0.1 s.
    uneven = ArmMotion("m", 30.0, np.array([0.0, 1.0, 4.0, 9.0])[:, None] * np.ones(8), ROBOT).resampled(40.0)
    np.testing.assert_allclose(uneven.positions[:, 0], [0.0, 0.75, 2.5, 5.25, 9.0], atol=1e-12)


def test_a_saved_motion_is_read_back(tmp_path: pathlib.Path) -> None:
    (motion,) = generate_motions(ROBOT, seed=3, count=1, duration=2.0)
    motion.save(tmp_path / "wave.npz")
    read = load_motion(tmp_path / "wave.npz", ROBOT)
    assert (read.name, read.fps) == ("wave", 50.0)
    np.testing.assert_array_equal(read.positions, motion.positions)


def test_joints_are_found_by_name_and_clamped_to_their_limits(tmp_path: pathlib.Path, robot, caplog) -> None:
    names = ("some_finger", *ARMS[::-1])
    path = write(tmp_path / "a.npz", joint_names=np.array(names), positions=np.tile(0.14 * np.arange(9.0), (2, 1)))
    expected = np.minimum(0.14 * np.arange(8, 0, -1), robot.upper[robot.arms])
    np.testing.assert_allclose(load_motion(path, ROBOT).positions, np.tile(expected, (2, 1)))
    told = r"100\.0% of the frames .* by up to 0\.08 rad \(right_shoulder_roll_joint\); they are clamped"
    assert re.search(told, caplog.text)


def test_joints_that_do_not_follow_a_motion_are_told(tmp_path: pathlib.Path, caplog: pytest.LogCaptureFixture) -> None:
    names = ("left_knee_joint", *ARMS, "torso_joint")
    for name in ("b", "a"):
        write(tmp_path / f"{name}.npz", joint_names=np.array(names), positions=np.zeros((4, 10)))
    motion = load_motion(tmp_path / "a.npz", ROBOT)
    assert motion.unused == motion.resampled(20.0).unused == ("left_knee_joint", "torso_joint")
    told = "only the arms follow a motion; not used: left_knee_joint, torso_joint"
    assert caplog.messages == [f"{tmp_path / 'a.npz'}: {told}"]
    caplog.clear()
    folder = load_motions(tmp_path, ROBOT)
    assert [(m.name, m.unused) for m in folder] == [("a", motion.unused), ("b", motion.unused)]
    assert caplog.messages == [f"{tmp_path}: {told}"], "one line for the folder"
    caplog.clear()
    assert load_motion(write(tmp_path / "arms.npz"), ROBOT).unused == () and not caplog.messages


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fps": None}, "fps"),
        ({"fps": np.array(0.0)}, "fps = 0.0; give one number from 0.1 to 10000"),
        ({"fps": np.array(30.0 + 1.0j)}, "give one number"),
        ({"fps": np.array(np.nan)}, "give one number"),
        ({"joint_names": np.array(ARMS[:-1]), "positions": np.zeros((4, 7))}, "right_elbow_joint"),
        ({"joint_names": np.array((*ARMS[:-1], ARMS[0]))}, "left_shoulder_pitch_joint more than once"),
        ({"positions": np.zeros((1, 8))}, "at least 2 frames"),
        ({"positions": np.zeros((4, 7))}, "at least 2 frames"),
        ({"positions": np.full((4, 8), np.nan)}, "not finite"),
        ({"positions": np.zeros((4, 8), dtype=complex)}, "complex128; valid: at least 2 frames"),
        ({"positions": np.array([[object()] * 8] * 4)}, "pickled"),
    ],
)
def test_bad_files_are_refused(changes: dict, message: str, tmp_path: pathlib.Path) -> None:
    with pytest.raises(ConfigError, match=message):
        load_motion(write(tmp_path / "bad.npz", **changes), ROBOT)


def test_missing_and_foreign_files_are_refused(tmp_path: pathlib.Path) -> None:
    (tmp_path / "text.npz").write_text("no motion")
    for name, reason in (("none", "No such file"), ("text", r"it is not an \.npz archive$")):
        with pytest.raises(ConfigError, match=reason):
            load_motion(tmp_path / f"{name}.npz", ROBOT)
    (tmp_path / "empty").mkdir()
    with pytest.raises(ConfigError, match="holds no motion files"):
        load_motions(tmp_path / "empty", ROBOT)


def test_generated_motions_follow_their_seed_and_move_like_arms(robot) -> None:
    motions, same, other = (generate_motions(ROBOT, seed, count=4, duration=10.0) for seed in (1, 1, 2))
    for a, b, c in zip(motions, same, other, strict=True):
        assert a.duration == pytest.approx(10.0)
        np.testing.assert_array_equal(a.positions, b.positions)
        assert not np.array_equal(a.positions, c.positions)
        assert (a.positions >= robot.lower[robot.arms]).all() and (a.positions <= robot.upper[robot.arms]).all()
        np.testing.assert_allclose(a.positions[0], robot.nominal[robot.arms])
        speed = np.abs(np.diff(a.positions, axis=0)) * a.fps
        # The fastest minimum-jerk movement through 60 % of the widest range in 0.4 s has a peak of 1.875 d / T.
        assert 0.5 < speed.max() < 1.875 * 0.6 * 5.5 / 0.4


def table(path: pathlib.Path, *lines: str) -> pathlib.Path:
    """Write a motion as a table of three frames at 20 Hz, unless other lines are given."""
    names = load_robot().arm_names
    rows = [[0.05 * frame, *(0.1 * frame * np.ones(8)), 0.3] for frame in range(3)]
    whole = [",".join(["t", *names, "torso_joint"]), *(",".join(f"{value:.3f}" for value in row) for row in rows)]
    path.write_text("\n".join(lines or whole) + "\n")
    return path


def test_a_table_with_joint_names_is_a_motion(tmp_path: pathlib.Path, robot) -> None:
    motion = load_motion(table(tmp_path / "wave.csv"), ROBOT)
    assert (motion.name, motion.fps, motion.unused) == ("wave", pytest.approx(20.0), ("torso_joint",))
    expected = np.clip(0.1 * np.arange(3)[:, None] * np.ones(8), robot.lower[robot.arms], robot.upper[robot.arms])
    np.testing.assert_allclose(motion.positions, expected)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (("x,y", "1,2"), r":1: no column is named t"),
        (("t,a", "0,0", "0.1,b"), r":3: could not convert string to float: 'b'"),
        (("t,a", "0,0", "0.1"), r":3: 1 numbers for 2 columns"),
        (("t,a", "0,0"), "has 1 frames"),
        (("t,a", "0,0", "0,0", "0,0"), "do not rise, the first from 0 to 0 s; sort"),
        (("t,a", "0,0", "0.1,0", "0.4,0"), "do not rise in equal steps"),
        (("t,a", "0,0", "nan,0", "0.4,0"), "do not rise, the first from 0 to nan s"),
        (("t,a", "0,0", "0.1,0"), "lacks the joints left_shoulder_pitch_joint"),
    ],
)
def test_bad_tables_are_refused(lines: tuple[str, ...], message: str, tmp_path: pathlib.Path) -> None:
    with pytest.raises(ConfigError, match=message):
        load_motion(table(tmp_path / "bad.csv", *lines), ROBOT)


def test_other_kinds_of_files_are_refused(tmp_path: pathlib.Path) -> None:
    with pytest.raises(ConfigError, match=r"'\.fbx' is not a motion file type; valid for arms"):
        load_motion(tmp_path / "dance.fbx", ROBOT)


def member(path: pathlib.Path, name: str, content: bytes) -> pathlib.Path:
    with zipfile.ZipFile(write(path), "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, content)
    return path


def test_archives_made_to_harm_are_refused(tmp_path: pathlib.Path) -> None:
    bomb = member(tmp_path / "bomb.npz", "x.npy", bytes(LARGEST_MOTION + 1))
    assert bomb.stat().st_size < 100_000
    shape = b"{'descr': '<f8', 'fortran_order': False, 'shape': (%d,)}\n" % 2**70
    huge = member(tmp_path / "huge.npz", "x.npy", b"\x93NUMPY\x01\x00" + len(shape).to_bytes(2, "little") + shape)
    pickled = member(tmp_path / "pickled.npz", "x.pkl", pickle.dumps({}))
    for path, message in ((bomb, "unpacks to"), (huge, "cannot read"), (pickled, "'x.pkl' is not a NumPy array")):
        with pytest.raises(ConfigError, match=message):
            load_motion(path, ROBOT)


def test_a_thousand_other_joints_make_one_short_line(tmp_path: pathlib.Path, caplog: pytest.LogCaptureFixture) -> None:
    names = [*ARMS, *(f"joint_{index}" for index in range(1000))]
    load_motion(write(tmp_path / "m.npz", joint_names=np.array(names), positions=np.zeros((4, len(names)))), ROBOT)
    (record,) = caplog.records
    assert "joint_0" in record.message and "and 980 more" in record.message and len(record.message) < 500


def waving(fps: float = 50.0, seconds: float = 4.0) -> ArmMotion:
    """Both elbows swing between 0.2 and 1.4 rad, every 2 s."""
    t = np.arange(0.0, seconds, 1.0 / fps)
    bent = 0.8 - 0.6 * np.cos(np.pi * t)
    return ArmMotion("wave", fps, bent[:, None] * [name.endswith("elbow_joint") for name in ARMS], ROBOT)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (np.rad2deg, r"angles up to 80\.2, more than a full turn in radians; if they are degrees"),
        (lambda q: q - 2.0, r"100\.0% of the frames are beyond joint limits, by up to 1\.66 rad \(left_shoulder_roll"),
        (lambda q: q - 1.2 * (np.arange(len(q))[:, None] > 80), r"jumps by 1\.\d+ rad within 0\.02 s at 1\.600 s"),
    ],
)
def test_other_units_and_jumps_are_refused_wherever_a_motion_enters(change, message, tmp_path: pathlib.Path) -> None:
    wrong = dataclasses.replace(waving(), positions=change(waving().positions))
    wrong.save(tmp_path / "wave.npz")
    for enter in (
        lambda: load_motion(tmp_path / "wave.npz", ROBOT),
        lambda: load_motions(tmp_path, ROBOT),
        lambda: Segment("wave", 4.0, motion=wrong),
    ):
        with pytest.raises(HugwbcError, match=message):
            enter()


def as_table(path: pathlib.Path, motion: ArmMotion, times: np.ndarray) -> pathlib.Path:
    rows = [",".join(f"{value:.6f}" for value in (t, *q)) for t, q in zip(times, motion.positions, strict=True)]
    return table(path, ",".join(["t", *ARMS]), *rows)


def test_a_motion_without_frames_is_refused() -> None:
    with pytest.raises(HugwbcError, match=r"not one frame or more of 8 arm joints, but of shape \(0, 8\)"):
        Segment("wave", 1.0, motion=ArmMotion("none", 50.0, np.zeros((0, 8)), ROBOT))


def test_a_table_may_have_any_clock_but_is_in_seconds(tmp_path: pathlib.Path) -> None:
    motion = waving(fps=125.0)
    times = np.arange(len(motion.positions)) / motion.fps
    assert load_motion(as_table(tmp_path / "unix.csv", motion, 1764208000.0 + times), ROBOT).fps == pytest.approx(125.0)
    with pytest.raises(ConfigError, match="8 s between samples: its times look like milliseconds; give seconds"):
        load_motion(as_table(tmp_path / "ms.csv", motion, 1e3 * times), ROBOT)
    with pytest.raises(ConfigError, match=r"20 s between its times; give t in seconds \(divide"):
        load_motion(as_table(tmp_path / "slow.csv", motion, 20.0 * np.arange(len(times))), ROBOT)
    with pytest.raises(ConfigError, match=r"from 0\.02 to 0\.02 s; .* with enough decimals"):
        load_motion(as_table(tmp_path / "rounded.csv", motion, np.round(times, 2)), ROBOT)


def test_tables_of_a_folder_train_too(tmp_path: pathlib.Path) -> None:
    as_table(tmp_path / "wave.csv", waving(), np.arange(200) / 50.0)
    assert [motion.name for motion in load_motions(tmp_path, ROBOT)] == ["wave"]

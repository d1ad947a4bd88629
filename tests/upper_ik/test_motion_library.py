import numpy as np
import pytest

from hugwbc.cli import main
from hugwbc.errors import ConfigError
from hugwbc.scripts.motion import load_motions
from hugwbc.upper_ik.motion_library import make_library


def test_clips_differ_repeat_for_a_seed_and_keep_the_joint_limits(robot):
    clips = list(make_library(seed=1, count=3, duration=2.0))
    again = list(make_library(seed=1, count=3, duration=2.0))
    for clip, same in zip(clips, again, strict=True):
        assert clip.duration == pytest.approx(2.0) and clip.fps == 50.0
        np.testing.assert_array_equal(clip.positions, same.positions)
        assert np.all((clip.positions >= robot.lower[robot.arms]) & (clip.positions <= robot.upper[robot.arms]))
        speed = np.abs(np.diff(clip.positions, axis=0)) * 50.0
        assert np.all(speed <= 0.5 * robot.velocity_limit[robot.arms] + 1e-9)
        assert np.ptp(clip.positions, axis=0).max() > 0.1, "it moves"
    assert not np.allclose(clips[0].positions, clips[1].positions)
    with pytest.raises(ConfigError, match="count 0"):
        make_library(seed=0, count=0)


def test_the_command_writes_motion_files(tmp_path, capsys):
    assert main(["motions", "--out", str(tmp_path / "m"), "--count", "2", "--duration", "0.5", "--seed", "3"]) == 0
    assert [motion.name for motion in load_motions(tmp_path / "m")] == ["hands-3-00", "hands-3-01"]
    assert "wrote 2 motions" in capsys.readouterr().out

import numpy as np
import pytest

from hugwbc.errors import ConfigError
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

"""Lanes, and frames from samples."""

from collections.abc import Callable

import numpy as np
import pytest

from hugwbc.viz.framing import camera_path, frame_samples, lanes


def test_lanes_are_centred_and_the_first_is_leftmost_seen_from_ahead() -> None:
    # Seen from ahead, the viewer's left is the robots' right, -y.
    np.testing.assert_allclose(lanes(1), [0.0])
    np.testing.assert_allclose(lanes(2), [-0.75, 0.75])


def test_frame_samples_hold_the_last_sample_of_a_run_that_ended_early() -> None:
    time = np.array([0.0, 0.02, 0.04, 0.06])
    np.testing.assert_array_equal(frame_samples(time, 25, 0.16), [0, 2, 3, 3, 3])
    np.testing.assert_array_equal(frame_samples(np.array([1.0]), 25, 1.0), [0])


def test_camera_follows_the_mean_of_the_robots_and_leaves_behind_one_that_has_fallen(make_run: Callable) -> None:
    # Both walk at 0.5 m/s in lanes at y = -0.75 and 0.75; the second falls after 4 of 10 s.
    path, distance = camera_path([make_run(seconds=10.0), make_run(seconds=4.0, fell=True)], 25, 9.98)
    assert path.shape == (250, 2)
    np.testing.assert_allclose(path[50], [1.0, 0.0], atol=0.02)
    np.testing.assert_allclose(path[200], [4.0, -0.75], atol=0.02)
    # From one to the other in the smoothing time of 1 s, not at once.
    assert np.abs(np.diff(path[:, 1])).max() < 0.04
    np.testing.assert_allclose(distance, 1.0, atol=0.02)


def test_camera_stands_back_when_robots_drift_apart(make_run: Callable) -> None:
    ahead, back = make_run(seconds=10.0), make_run(seconds=10.0)
    back.qpos[:, 0] *= -1
    path, distance = camera_path([ahead, back], 25, 9.98)
    # At 8 s they are at x = 4 and -4, y = -0.75 and 0.75: 4.07 m from the middle, where 1 m is well in the picture.
    np.testing.assert_allclose(path[200], [0.0, 0.0], atol=0.01)
    assert distance[200] == pytest.approx(np.hypot(4.0, 0.75), abs=0.02)
    assert distance[0] == pytest.approx(1.0, abs=0.01)

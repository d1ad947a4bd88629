"""Lanes, and frames from samples."""

import numpy as np

from hugwbc.viz.trace import frame_samples, lanes


def test_lanes_are_centred_and_the_first_is_leftmost_seen_from_ahead() -> None:
    # Seen from ahead, the viewer's left is the robots' right, -y.
    np.testing.assert_allclose(lanes(1), [0.0])
    np.testing.assert_allclose(lanes(2), [-0.75, 0.75])


def test_frame_samples_hold_the_last_sample_of_a_run_that_ended_early() -> None:
    time = np.array([0.0, 0.02, 0.04, 0.06])
    np.testing.assert_array_equal(frame_samples(time, 25, 0.16), [0, 2, 3, 3, 3])
    np.testing.assert_array_equal(frame_samples(np.array([1.0]), 25, 1.0), [0])

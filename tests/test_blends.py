import numpy as np
import pytest
import torch

from hugwbc.blends import minimum_jerk, smooth_rate, smooth_step


def test_smooth_step_is_minimum_jerk():
    assert [smooth_step(u) for u in (-1.0, 0.0, 0.5, 1.0, 2.0)] == [0.0, 0.0, 0.5, 1.0, 1.0]
    assert smooth_step(0.25) == pytest.approx(10 / 64 - 15 / 256 + 6 / 1024)
    assert [smooth_rate(u) for u in (-1.0, 0.0, 0.5, 1.0, 2.0)] == [0.0, 0.0, 1.875, 0.0, 0.0]


@pytest.mark.parametrize("array", [np.array, torch.tensor])
def test_minimum_jerk_covers_its_distance_with_the_rate_as_derivative(array):
    u = array(np.linspace(0.0, 1.0, 1001))
    blend = np.asarray(minimum_jerk(u, 2.0))
    rate = [2.0 * smooth_rate(value) for value in np.linspace(0.0, 1.0, 1001)]
    assert blend[[0, 500, 1000]] == pytest.approx([0.0, 1.0, 2.0])
    assert np.gradient(blend, 0.001) == pytest.approx(rate, abs=1e-3 * 12)

import numpy as np

from hugwbc.runtime.moment import gait_plan


class Plain:
    name, period = "plain", 0.02


class Planning(Plain):
    phase, footholds = 0.3, np.array([[0.1, 0.2], [np.nan, np.nan]])


def test_a_controller_may_show_its_gait_or_not():
    phase, footholds = gait_plan(Plain())
    assert np.isnan(phase) and footholds.shape == (2, 2) and np.isnan(footholds).all()
    phase, footholds = gait_plan(Planning())
    assert phase == 0.3
    np.testing.assert_array_equal(footholds, Planning.footholds)

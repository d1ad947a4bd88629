import numpy as np

from hugwbc.runtime.moment import PlanView


class Plain:
    name, period = "plain", 0.02

    def reset(self, state):
        pass

    def act(self, state, command, upper_body):
        raise NotImplementedError


class Planning(Plain):
    phase, footholds = 0.3, np.array([[0.1, 0.2], [np.nan, np.nan]])
    planned_acceleration = np.arange(19.0)


def test_a_controller_may_show_its_gait_or_not():
    plain = PlanView(Plain())
    assert np.isnan(plain.phase) and plain.footholds.shape == (2, 2) and np.isnan(plain.footholds).all()
    assert plain.acceleration is None
    plan = PlanView(Planning())
    assert plan.phase == 0.3
    np.testing.assert_array_equal(plan.footholds, Planning.footholds)
    np.testing.assert_array_equal(plan.acceleration, Planning.planned_acceleration)

from types import SimpleNamespace

import numpy as np

from hugwbc.robot import load_robot
from hugwbc.runtime.safety_report import SafetyLog
from hugwbc.runtime.snapshot import PlanView


def test_a_controller_may_show_its_gait_or_not():
    plain = PlanView(SimpleNamespace(name="plain", robot=load_robot(), controller=SimpleNamespace()), SafetyLog())
    assert np.isnan(plain.phase) and plain.footholds.shape == (2, 2) and np.isnan(plain.footholds).all()
    assert plain.acceleration is None
    footholds = np.array([[0.1, 0.2], [np.nan, np.nan]])
    planning = SimpleNamespace(phase=0.3, footholds=footholds, planned_acceleration=np.arange(19.0))
    plan = PlanView(SimpleNamespace(name="planning", robot=load_robot(), controller=planning), SafetyLog())
    assert plan.phase == 0.3 and plan.acceleration is planning.planned_acceleration
    np.testing.assert_array_equal(plan.footholds, footholds)

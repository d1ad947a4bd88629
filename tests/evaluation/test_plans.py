import numpy as np
import pytest

from hugwbc import Command, Gait, load_robot
from hugwbc.errors import ConfigError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.episode import Settings, simulate
from hugwbc.evaluation.plans import Knot, Plan, Schedule
from hugwbc.runtime.controllers import HoldController
from hugwbc.sim import Force

WALK = Command(gait=Gait.WALKING, v_x=1.0)
RAMP = Schedule((Knot(0.0, Command()), Knot(1.0, WALK, ramp=2.0), Knot(4.0, Command(w=0.5))))


def test_a_schedule_steps_and_ramps():
    wanted = {-1.0: 0.0, 0.999: 0.0, 1.0: 0.0, 1.5: 0.25, 3.0: 1.0, 3.9: 1.0, 4.0: 0.0, 9.0: 0.0}
    for t, v_x in wanted.items():
        assert RAMP.command_at(t).v_x == pytest.approx(v_x), t
    gaits = [RAMP.command_at(t).gait for t in (0.99, 1.0, 3.9, 4.0)]
    assert gaits == [Gait.STANDING, Gait.WALKING, Gait.WALKING, Gait.STANDING]
    assert RAMP.command_at(9.0) == Command(w=0.5)


@pytest.mark.parametrize(
    "knots",
    [
        (),
        (Knot(1.0, Command()),),
        (Knot(0.0, Command(), ramp=1.0),),
        (Knot(0.0, Command()), Knot(1.0, Command(), ramp=2.0), Knot(2.0, Command())),
        (Knot(0.0, Command()), Knot(2.0, Command()), Knot(1.0, Command())),
    ],
)
def test_bad_schedules_are_refused(knots):
    with pytest.raises(ConfigError, match=r"knot"):
        Schedule(knots)


def run(*plans: Plan, **settings):
    config = Settings(duration=0.3, settle=0.1, **settings)
    return [simulate(HoldController(load_robot()), config, plan) for plan in plans]


def test_the_forces_of_a_plan_push_the_robot():
    still, pushed = run(Plan(0), Plan(0, forces=(Force((300.0, 0.0, 0.0), 0.1, 0.1),)))
    np.testing.assert_array_equal(still.qpos[:6], pushed.qpos[:6])
    assert pushed.qpos[-1, 0] - still.qpos[-1, 0] > 0.01


def test_conditions_of_a_plan_come_before_those_of_the_settings():
    plans = (Plan(0), Plan(0, conditions=Conditions()))
    loaded, free = run(*plans, conditions=Conditions(payload=10.0))
    np.testing.assert_array_equal(free.qpos, run(plans[0])[0].qpos)
    assert not np.array_equal(loaded.qpos, free.qpos)


def test_the_draw_decides_and_not_the_place_in_the_list():
    plans = [Plan(draw) for draw in (3, 4, 3)]
    first, other, same = run(*plans, conditions=Conditions(terrain_roughness=0.02, intervention="noise"))
    np.testing.assert_array_equal(first.target, same.target)
    assert not np.array_equal(first.target, other.target)

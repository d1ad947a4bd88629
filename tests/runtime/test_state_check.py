"""Which states no controller is given."""

import numpy as np
import pytest

from hugwbc import load_robot, rotations
from hugwbc.runtime.state_check import StateCheck
from tests.conftest import make_state

ROBOT = load_robot()
CHECK = StateCheck(ROBOT)


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({"q": np.full(19, np.nan)}, "not finite"),
        ({"dq": np.full(19, 1e7)}, "not finite"),
        ({"orientation": np.zeros(4)}, "no orientation"),
        ({"orientation": np.array([0.9, 0.0, 0.0, 0.0])}, "no orientation"),
        ({"orientation": rotations.from_yaw_pitch_roll(0.0, 1.4, 0.0)}, "leans"),
        ({"angular_velocity": np.array([0.0, 16.0, 0.0])}, "turns"),
        ({"velocity": np.array([7.0, 0.0, 0.0])}, "pelvis moves"),
        ({"dq": np.full(19, 80.0)}, "joint moves"),
        ({"q": ROBOT.upper + 0.6}, "range"),
    ],
)
def test_what_no_balanced_robot_does_is_a_fault(values, why):
    assert why in CHECK.fault(make_state(**values))


def test_a_fast_walk_and_a_hard_landing_are_none():
    fast = {"velocity": np.array([3.0, 0.0, 0.5]), "angular_velocity": np.array([0.0, 5.0, 0.0])}
    assert CHECK.fault(make_state(pitch=0.8, dq=2.0 * ROBOT.velocity_limit, **fast)) == ""
    assert CHECK.fault(make_state(ROBOT.lower - 0.3)) == ""


def test_a_state_of_another_robots_joints_is_none():
    assert CHECK.fault(CHECK.admit(make_state(np.zeros(29), dq=np.zeros(29))))

import dataclasses

import numpy as np
import pytest

from hugwbc import load_robot, rotations
from hugwbc.mbc import feet
from hugwbc.mbc.dynamics import Dynamics

ROBOT = load_robot()


def _dynamics(state, yaw=0.0, **joints):
    """The state turned by a yaw, with some joints moved."""
    q = state.q.copy()
    for name, value in joints.items():
        q[ROBOT.index(f"{name}_joint")] += value
    dynamics = Dynamics()
    dynamics.update(
        dataclasses.replace(state, q=q, orientation=rotations.from_yaw_pitch_roll(yaw, 0.0, 0.0), velocity=np.zeros(3))
    )
    return dynamics


@pytest.mark.parametrize("foot", [0, 1])
def test_the_pivot_is_ahead_of_the_ankle_on_the_ground_and_tells_where_the_sole_is(standing_state, foot):
    side = ("left", "right")[foot]
    dynamics = _dynamics(standing_state, 0.7, **{f"{side}_hip_yaw": 0.2})
    sole = dynamics.frame(f"{side}_sole")
    forward = sole.rotation[:2, 0]  # the foot leans by 0.02 rad: a little shorter than 1
    pivot = feet.pivot(dynamics, foot, 0.03)
    ankle = dynamics.position(f"{side}_ankle_link")[:2]
    assert (pivot[:2] - ankle) @ forward == pytest.approx(0.03, abs=2e-3)
    assert pivot[2] == sole.position[2] == feet.sole_height(dynamics, foot)
    yaw = float(np.arctan2(forward[1], forward[0]))
    assert feet.sole_about(pivot[:2], yaw, 0.03) == pytest.approx(sole.position[:2], abs=1e-12)


def test_the_heading_of_the_feet_is_their_mean_also_where_angles_wrap(standing_state):
    dynamics = _dynamics(standing_state, 3.1, left_hip_yaw=0.3, right_hip_yaw=0.1)
    assert float(rotations.wrap_angle(feet.feet_yaw(dynamics) - 3.3)) == pytest.approx(0.0, abs=5e-3)


def test_a_foot_that_points_down_has_its_toe_lower_than_its_heel(standing_state):
    heel, toe = feet.end_heights(_dynamics(standing_state, left_ankle=0.2), 0)
    length = ROBOT.sole_x[1] - ROBOT.sole_x[0]
    assert heel - toe == pytest.approx(length * np.sin(0.2), abs=1e-3)


@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_a_lifted_sole_is_level_or_on_the_slope_until_the_shank_leans_too_far(standing_state, yaw):
    to_heading = rotations.rotation_z(-yaw)[:2, :2]
    upright = _dynamics(standing_state, yaw)
    assert feet.swing_pitch(upright, 0, to_heading) == 0.0
    assert feet.swing_pitch(upright, 0, to_heading, slope=-0.1) == -0.1
    # The shank leans by hip pitch and knee together, of which the ankle takes 0.8 rad: -0.4 + 0.8 + 0.6 - 0.8.
    leaning = _dynamics(standing_state, yaw, left_knee=0.6)
    assert feet.swing_pitch(leaning, 0, to_heading) == pytest.approx(0.2, abs=1e-3)

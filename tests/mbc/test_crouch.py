import dataclasses

import numpy as np
import pytest

from hugwbc.mbc.crouch import Crouch
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.footsteps import Pendulum, StepPlan
from hugwbc.mbc.params import ControllerParams

PARAMS = ControllerParams()


@pytest.fixture
def dynamics(standing_state):
    robot = Dynamics()
    robot.update(dataclasses.replace(standing_state, velocity=np.zeros(3)))
    return robot


def _settle(dynamics, foothold, seconds=2.0):
    """The depth after standing on the right ankle for a long time with the left foot to land somewhere at once."""
    crouch = Crouch(PARAMS)
    pivot = dynamics.position("right_ankle_link")[:2]
    pendulum = Pendulum(pivot=pivot, com=pivot, omega=3.2, dcm=pivot)
    step = StepPlan(pivot + np.array(foothold), pivot, (0.0, 0.0))
    height = float(dynamics.position("pelvis")[2] - dynamics.position("right_sole")[2])
    for _ in range(round(seconds / 0.002)):
        crouch.prepare(dynamics, pendulum, step, 0, 0.0, height)
        crouch.advance(0.002)
    return crouch


def test_an_ordinary_step_needs_no_crouch(dynamics):
    assert _settle(dynamics, [0.3, 0.25]).depth == 0.0


def test_the_pelvis_comes_down_until_the_leg_is_as_long_as_it_may_be(dynamics):
    crouch = _settle(dynamics, [0.5, 0.4])
    hip = dynamics.position("left_hip_pitch_link") - [0.0, 0.0, crouch.depth]
    ankle = np.array([0.5, 0.4, 0.0]) + dynamics.position("right_ankle_link")
    assert np.linalg.norm(hip - ankle) == pytest.approx(PARAMS.leg_length, abs=1e-3)
    assert 0.05 < crouch.depth < PARAMS.max_crouch


def test_it_goes_no_lower_than_its_bound_and_comes_up_again(dynamics):
    crouch = _settle(dynamics, [5.0, 0.0])
    assert crouch.depth == pytest.approx(PARAMS.max_crouch, abs=1e-3)
    depths = []
    for _ in range(2000):
        crouch.advance(0.002)
        depths.append(crouch.depth)
    assert depths[-1] == pytest.approx(0.0, abs=1e-4)
    assert -np.min(np.diff(depths)) / 0.002 <= PARAMS.rise_rate[0] + 1e-9

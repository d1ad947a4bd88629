import functools

import numpy as np
import pytest

from hugwbc.mbc.footsteps import Pendulum, plan_step
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.step_timing import time_step
from hugwbc.mbc.swing import SwingTrajectory

OMEGA, STEP_TIME = 3.2, 0.25
PARAMS = ControllerParams()


def _choose(dcm, remaining=0.2, *, foot=(0.0, 0.25), params=PARAMS):
    """What is decided when the left foot swings and the divergent component is at a place relative to the right one."""
    pendulum = Pendulum(pivot=np.zeros(2), com=np.zeros(2), omega=OMEGA, dcm=np.array(dcm))
    plan_at = functools.partial(plan_step, params, pendulum, np.zeros(2), 0.0, 0.0, 0.02, 0, STEP_TIME)
    swing = SwingTrajectory(params)
    swing.start(np.array([*foot, 0.1]))
    return time_step(params, plan_at, plan_at(remaining), swing, STEP_TIME, STEP_TIME - remaining, remaining)


def test_a_foothold_within_reach_keeps_time():
    remaining, step = _choose([0.0, 0.1])
    assert remaining == 0.2
    assert step.missed == (0.0, 0.0)


@pytest.mark.parametrize(("dcm", "foot"), [([0.0, -0.2], (0.0, 0.25)), ([0.0, 0.45], (0.0, 0.45))])
def test_the_foot_lands_sooner_when_the_robot_falls_past_either_foot(dcm, foot):
    """Past the stance foot, which the swing foot cannot cross, or further out than it reaches."""
    remaining, step = _choose(dcm, foot=foot)
    assert remaining < 0.2
    duration = STEP_TIME - 0.2 + remaining
    assert duration == pytest.approx(STEP_TIME / (1.0 + PARAMS.step_timing))
    on_time = abs(step.missed[1]) * np.exp(OMEGA * (0.2 - remaining))
    assert abs(step.missed[1]) < on_time


def test_a_foot_that_could_not_arrive_is_not_hurried():
    near, _ = _choose([0.0, -0.2], remaining=0.12, foot=(0.0, 0.1))
    far, _ = _choose([0.0, -0.2], remaining=0.12, foot=(0.0, 0.6))
    assert near < 0.12 <= far


def test_the_frequency_stays_within_its_share_for_any_state():
    rng = np.random.default_rng(0)
    for _ in range(200):
        remaining = rng.uniform(0.01, STEP_TIME)
        chosen, _ = _choose(rng.uniform(-1.0, 1.0, 2), remaining, foot=rng.uniform(-0.5, 0.5, 2))
        pace = STEP_TIME / (STEP_TIME - remaining + chosen)
        assert 1.0 - PARAMS.step_timing - 1e-9 <= pace <= 1.0 + PARAMS.step_timing + 1e-9
        assert chosen == remaining or min(chosen, remaining) >= 0.06


def test_what_was_decided_holds_until_the_foot_is_down():
    """The same state asked again at the time that was chosen gives the same time."""
    sooner, _ = _choose([0.0, -0.2])
    pendulum = Pendulum(pivot=np.zeros(2), com=np.zeros(2), omega=OMEGA, dcm=np.array([0.0, -0.2]))
    plan_at = functools.partial(plan_step, PARAMS, pendulum, np.zeros(2), 0.0, 0.0, 0.02, 0, STEP_TIME)
    swing = SwingTrajectory(PARAMS)
    swing.start(np.array([0.0, 0.25, 0.1]))
    again, _ = time_step(PARAMS, plan_at, plan_at(sooner), swing, STEP_TIME, STEP_TIME - 0.2, sooner)
    assert again == pytest.approx(sooner)

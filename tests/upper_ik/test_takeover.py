import math

import numpy as np
import pytest

from hugwbc.robot import load_robot
from hugwbc.upper_ik import Takeover
from hugwbc.upper_ik.takeover import Phase

DT = 0.02
ARMS = np.array([-0.5, 0.2, 0.1, 0.3, -0.4, -0.3, -0.1, 0.2])
LIMIT = np.array([9.0, 9.0, 20.0, 20.0] * 2)  # the maker's joint speeds [rad/s], from h1.yaml


def run(takeover, target, seconds, start=None, dt=DT):
    return [takeover.follow(target, np.zeros(8), dt, start) for _ in range(round(seconds / dt))]


@pytest.fixture
def takeover():
    return Takeover(load_robot())


def test_takeover_blends_from_the_start_to_the_target(takeover):
    bodies = run(takeover, ARMS, 0.5, start=np.full(8, 0.1))
    assert all(body.mask.all() for body in bodies)
    # Half of the blend time: half of the way.
    assert Takeover(load_robot()).follow(ARMS, np.zeros(8), 0.25, np.full(8, 0.1)).q == pytest.approx(0.05 + ARMS / 2)
    assert not np.any(np.abs(bodies[0].q - 0.1) > 0.001)
    assert takeover.settled
    assert bodies[-1].q == pytest.approx(ARMS)


def test_a_jump_of_the_target_becomes_a_ramp_within_the_limits(takeover):
    run(takeover, np.zeros(8), 0.5, start=np.zeros(8))
    bodies = [takeover.follow(np.full(8, 1.0), np.zeros(8), DT) for _ in range(40)]
    dq = np.array([np.zeros(8), *(body.dq for body in bodies)])
    assert np.abs(dq).max(axis=0)[:2] == pytest.approx(0.5 * LIMIT[:2]), "the slow joints get to half of their speed"
    assert np.all(np.abs(np.diff(dq, axis=0)) <= 100.0 * DT + 1e-9)
    assert bodies[-1].q == pytest.approx(np.ones(8))
    assert max(body.q.max() for body in bodies) < 1.0 + 1e-9, "no overshoot"


def test_hand_back_returns_before_the_mask_clears(takeover):
    own = np.full(8, 0.2)
    run(takeover, ARMS, 1.0, start=own)
    last, ticks = takeover.follow(ARMS, np.zeros(8), DT), 0
    while (body := takeover.release(own, DT)).indicator:
        assert np.all(np.abs(body.q - last.q) <= 0.5 * LIMIT * DT + 1e-12)
        last, ticks = body, ticks + 1
    assert ticks == 50
    assert last.q == pytest.approx(own)
    assert takeover.phase is Phase.RELEASED
    assert not takeover.release(own, DT).indicator


def test_targets_that_return_during_a_hand_back_are_taken_up_from_there(takeover):
    run(takeover, ARMS, 1.0, start=np.zeros(8))
    for _ in range(20):
        half_way = takeover.release(None, DT)
    body = takeover.follow(ARMS, np.zeros(8), DT)
    assert np.all(np.abs(body.q - half_way.q) < 0.01)
    assert takeover.phase is Phase.TAKEN


@pytest.mark.parametrize(("q", "dt"), [(np.full(8, math.nan), DT), (ARMS, 0.0), (ARMS, math.nan)])
def test_unusable_targets_hold_and_are_counted(takeover, q, dt):
    last = run(takeover, ARMS, 0.3, start=np.zeros(8))[-1]
    body = takeover.follow(q, np.zeros(8), dt)
    assert body.q == pytest.approx(last.q + body.dq * (DT if dt == DT else 0.0))
    assert np.all(np.abs(body.dq) <= np.maximum(np.abs(last.dq) - 100.0 * DT, 0.0) + 1e-9), "on its way to rest"
    assert takeover.held == 1


def test_a_takeover_after_a_reset_begins_where_the_first_one_did(robot):
    takeover, q = Takeover(robot), robot.nominal[robot.arms] + 0.3
    first = takeover.follow(q, np.zeros(8), 0.02).q
    for _ in range(50):
        takeover.follow(q, np.zeros(8), 0.02)
    takeover.reset()
    assert takeover.follow(q, np.zeros(8), 0.02).q == pytest.approx(first)


def test_velocity_and_acceleration_are_derivatives_for_targets_that_name_none(takeover):
    fine = 1e-3
    bodies = [takeover.follow(ARMS, np.zeros(8), fine, np.zeros(8)) for _ in range(500)]
    bodies += [takeover.release(np.zeros(8), fine) for _ in range(900)]
    q, dq, ddq = (np.array([getattr(body, name) for body in bodies]) for name in ("q", "dq", "ddq"))
    assert dq[1:] == pytest.approx(np.diff(q, axis=0) / fine, abs=0.02)
    assert ddq[1:] == pytest.approx(np.diff(dq, axis=0) / fine)
    assert np.abs(ddq).max() > 1.0


def test_the_acceleration_that_targets_name_is_blended_in():
    takeover, named = Takeover(load_robot()), np.linspace(-4.0, 4.0, 8)
    bodies = [takeover.follow(ARMS, np.zeros(8), DT, np.zeros(8), named) for _ in range(25)]
    shares = [body.ddq[0] / named[0] for body in bodies]
    assert 0.0 < shares[0] < 0.05 and shares[-1] == pytest.approx(1.0)
    assert np.all(np.diff(shares) > 0.0)
    braking = takeover.follow(np.full(8, math.nan), np.zeros(8), DT, None, named)
    assert braking.ddq == pytest.approx((braking.dq - bodies[-1].dq) / DT), "not what bad targets say"

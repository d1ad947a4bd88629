import math

import numpy as np
import pytest

from hugwbc.numeric import smooth_step
from hugwbc.robot import load_robot
from hugwbc.upper_ik import Takeover
from hugwbc.upper_ik.takeover import JointLimiter, Phase
from tests.upper_ik.conftest import ARMS, LIMIT

DT = 0.02


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
    share = [smooth_step(DT * (tick + 1) / 0.5) for tick in range(25)]
    assert [body.q for body in bodies] == pytest.approx(0.1 + np.outer(share, ARMS - 0.1), abs=1e-6)


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


def test_the_mask_stays_until_the_arms_are_where_the_controller_has_them(takeover):
    own = np.full(8, 0.2)
    run(takeover, ARMS, 1.0, start=own)
    for tick in range(100):
        if (body := takeover.release(own if tick < 49 else own - 1.0, DT)).indicator:
            last = body
    assert not body.indicator and np.all(np.abs(last.q - (own - 1.0)) <= 0.5 * LIMIT * DT + 1e-9)


def test_a_takeover_begins_where_the_controller_has_the_arms(robot):
    """Beyond the joint limits by what carries them; a start that is not a number is none."""
    reach = 0.9 * robot.torque_limit[robot.arms] / robot.kp[robot.arms]
    for start in (robot.lower[robot.arms] - reach, robot.upper[robot.arms] + reach):
        assert Takeover(robot).follow(ARMS, np.zeros(8), DT, start).q == pytest.approx(start, abs=0.01)
    unknown = Takeover(robot).follow(ARMS, np.zeros(8), DT, np.full(8, math.nan)).q
    assert unknown == pytest.approx(robot.nominal[robot.arms], abs=0.01)


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


LOWER, UPPER, SPEED, ACCELERATION = np.full(3, -1.0), np.full(3, 1.5), np.array([1.0, 2.0, 4.0]), 20.0


def limiter():
    return JointLimiter(LOWER, UPPER, SPEED, ACCELERATION)


@pytest.mark.parametrize("dt", [0.002, 0.02])
def test_a_goal_is_reached_without_overshoot_and_in_the_shortest_time(dt):
    joints = limiter()
    goal = np.array([1.2, 1.2, 1.2])
    path = np.array([joints.follow(goal, np.zeros(3), dt) for _ in range(round(2.0 / dt))])
    assert path[-1] == pytest.approx(goal, abs=1e-6)
    assert path.max() <= 1.2 + 1e-9
    # Accelerate, cruise, brake: distance / v + v / a while cruising; 2 sqrt(distance / a) without.
    shortest = [1.2 / 1.0 + 1.0 / 20.0, 1.2 / 2.0 + 2.0 / 20.0, 1.2 / 4.0 + 4.0 / 20.0]
    arrival = [float(np.argmax(path[:, joint] > 1.19)) * dt for joint in range(3)]
    assert arrival == pytest.approx(shortest, abs=0.1)


def test_a_moving_goal_is_followed_without_lag():
    joints, dt = limiter(), 0.02
    t = np.arange(0.0, 4.0, dt)
    goal = 0.3 * np.sin(2.0 * t)
    path = np.array(
        [joints.follow(np.full(3, g), np.full(3, 0.6 * np.cos(2.0 * s)), dt) for g, s in zip(goal, t, strict=True)]
    )
    assert path[20:] == pytest.approx(np.repeat(goal[20:, None], 3, axis=1), abs=1e-3)


def test_no_limit_is_ever_exceeded():
    rng = np.random.default_rng(0)
    joints, dt = limiter(), 0.02
    q, dq = joints.q, joints.dq
    for tick in range(5000):
        if tick % 7 == 0:
            goal, goal_dq = rng.uniform(-4.0, 4.0, 3), rng.uniform(-9.0, 9.0, 3)
        new = joints.stop(dt) if tick % 50 > 45 else joints.follow(goal, goal_dq, dt)
        assert np.all((new >= LOWER - 1e-12) & (new <= UPPER + 1e-12))
        assert np.all(np.abs(joints.dq) <= SPEED + 1e-12)
        assert np.all(np.abs(joints.dq - dq) <= ACCELERATION * dt + 1e-9)
        assert joints.dq == pytest.approx((new - q) / dt, abs=1e-9)
        q, dq = new, joints.dq


def test_a_start_outside_the_limits_comes_back():
    joints = limiter()
    joints.place(np.full(3, 2.0))
    path = [joints.follow(np.full(3, 3.0), np.zeros(3), 0.02) for _ in range(10)]
    assert np.max(path) == 2.0
    for _ in range(200):
        joints.follow(np.zeros(3), np.zeros(3), 0.02)
    assert joints.q == pytest.approx(np.zeros(3), abs=1e-6)

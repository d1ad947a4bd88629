import numpy as np
import pytest

from hugwbc.upper_ik.limiter import JointLimiter

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

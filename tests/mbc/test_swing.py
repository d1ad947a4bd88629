import numpy as np
import pytest

from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.swing import BRISKNESS, PEAK, SwingTrajectory, cubic_advance, quintic_advance


def test_quintic_is_the_minimum_jerk_rise_between_rests():
    for t in (0.1, 0.25, 0.4, 0.5):
        x, v, a = quintic_advance(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.5, t)
        u = t / 0.5
        assert x == pytest.approx(10 * u**3 - 15 * u**4 + 6 * u**5)
        assert v == pytest.approx((30 * u**2 - 60 * u**3 + 30 * u**4) / 0.5)
        assert a == pytest.approx((60 * u - 180 * u**2 + 120 * u**3) / 0.25, abs=1e-9)


def test_quintic_meets_any_boundary_conditions():
    rng = np.random.default_rng(0)
    for _ in range(4):
        start, end = rng.normal(size=(2, 3))
        duration = rng.uniform(0.1, 1.0)
        assert quintic_advance(*start, *end, duration, 10.0) == pytest.approx(end, abs=1e-8)
        assert quintic_advance(*start, *end, duration, 0.0) == pytest.approx(start)


def test_cubic_meets_its_boundary_conditions_with_half_more_than_the_mean_speed():
    rng = np.random.default_rng(0)
    for _ in range(4):
        start, end = rng.normal(size=(2, 2))
        duration = rng.uniform(0.1, 1.0)
        assert cubic_advance(*start, *end, duration, 10.0)[:2] == pytest.approx(end, abs=1e-8)
        assert cubic_advance(*start, *end, duration, 0.0)[:2] == pytest.approx(start)
    assert cubic_advance(0.0, 0.0, 1.0, 0.0, 0.5, 0.25) == pytest.approx((0.5, 1.5 / 0.5, 0.0))


@pytest.mark.parametrize("step_time", [0.143, 0.25, 0.333])
@pytest.mark.parametrize("apex", [0.1, 0.35])
def test_a_swing_rises_to_the_apex_and_ends_on_the_foothold(step_time, apex):
    params = ControllerParams()
    swing = SwingTrajectory(params)
    start, dt = np.array([1.0, 2.0, 0.3]), 0.001
    swing.start(start)
    heights, accelerations, elapsed = [], [], 0.0
    while elapsed < step_time - 1e-9:
        target = np.array([1.2, 2.1]) if elapsed < 0.3 * step_time else np.array([1.3, 2.0])  # it may move
        swing.advance(target, apex, 0.3, elapsed, step_time - elapsed, dt)
        heights.append(swing.position[2])
        accelerations.append(swing.acceleration.copy())
        elapsed += dt
    assert max(heights) - 0.3 == pytest.approx(apex, abs=0.004)
    assert np.argmax(heights) * dt == pytest.approx(step_time / 2, abs=0.012)
    assert swing.position[:2] == pytest.approx([1.3, 2.0], abs=1e-3)
    assert swing.position[2] == pytest.approx(0.3 + params.landing_height, abs=1e-3)
    assert swing.velocity[2] == pytest.approx(-params.landing_speed, abs=0.1)
    # Smooth but for the change of target: acceleration does not jump where the swing turns from rise to fall.
    jumps = np.abs(np.diff(np.array(accelerations)[:, 2]))
    assert jumps.max() < 0.15 * np.abs(np.array(accelerations)[:, 2]).max()


def _greatest_acceleration(briskness):
    """Along the ground, of a swing of 1 m in 0.5 s, per way and squared duration."""
    swing, dt, peak = SwingTrajectory(ControllerParams()), 0.001, 0.0
    swing.start(np.zeros(3))
    for tick in range(500):
        swing.advance(np.array([1.0, 0.0]), 0.1, 0.0, tick * dt, 0.5 - tick * dt, dt, briskness=briskness)
        if tick < 478:  # the last 20 ms are planned as if they were 20 ms
            peak = max(peak, abs(swing.acceleration[0]))
    assert swing.position[0] == pytest.approx(1.0, abs=2e-3)
    return peak * 0.25


def test_a_brisk_swing_needs_least_acceleration():
    assert _greatest_acceleration(BRISKNESS) == pytest.approx(PEAK, rel=0.01)
    assert _greatest_acceleration(0.0) == pytest.approx(10.0 / np.sqrt(3.0), rel=0.01)
    assert min(_greatest_acceleration(BRISKNESS - 0.5), _greatest_acceleration(BRISKNESS + 0.7)) > PEAK


def test_it_lands_where_the_ground_is_at_the_foothold():
    params, swing, dt = ControllerParams(), SwingTrajectory(ControllerParams()), 0.001
    swing.start(np.zeros(3))
    for tick in range(250):
        swing.advance(np.zeros(2), 0.15, 0.0, tick * dt, 0.25 - tick * dt, dt, landing=-0.03)
    assert swing.position[2] == pytest.approx(-0.03 + params.landing_height, abs=1e-3)


def test_a_foot_that_finds_no_ground_goes_on_down():
    params, swing, dt = ControllerParams(), SwingTrajectory(ControllerParams()), 0.001
    swing.start(np.zeros(3))
    for tick in range(100):
        swing.advance(np.zeros(2), 0.15, 0.0, 0.25, 0.0, dt, overdue=(tick + 1) * dt)
    assert swing.velocity[2] == pytest.approx(-params.search_speed, rel=0.1)
    assert swing.position[2] == pytest.approx(-params.search_speed * 0.1, abs=0.01)

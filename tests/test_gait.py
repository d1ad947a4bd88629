"""Gait phases, clocks, expected contact and swing profile against hand-computed values and independent solutions."""

import math

import numpy as np
import pytest
import torch

from hugwbc.errors import UnknownNameError
from hugwbc.gait import Gait, advance_phase, bounce, clock, expected_contact, foot_phases, swing_height
from hugwbc.numeric import smooth_rate, smooth_step


def test_labels_round_trip() -> None:
    assert [Gait.parse(gait.label) for gait in Gait] == list(Gait)
    assert Gait.parse("hopping_left") is Gait.HOPPING_LEFT


@pytest.mark.parametrize("label", ["wlaking", "", None])
def test_unknown_gait_names_the_valid_ones(label: str) -> None:
    with pytest.raises(UnknownNameError, match="standing, walking, jumping, hopping_left, hopping_right"):
        Gait.parse(label)


@pytest.mark.parametrize("gait", list(Gait))
def test_the_feet_of_the_mirrored_gait_change_places(gait: Gait) -> None:
    phase = np.arange(0.0, 1.0, 0.125)
    image = foot_phases((phase + gait.offset) % 1.0, np.full(8, gait.mirrored()))
    np.testing.assert_allclose(image, foot_phases(phase, np.full(8, gait))[:, ::-1], atol=1e-12)


def test_phase_advances_by_frequency_times_time_and_wraps() -> None:
    # 2 Hz for 0.02 s is 0.04 of a cycle; 0.99 + 0.04 wraps to 0.03.
    np.testing.assert_allclose(advance_phase(np.array([0.0, 0.5, 0.99]), 2.0, 0.02), [0.04, 0.54, 0.03], atol=1e-12)


@pytest.mark.parametrize(
    ("gait", "phase", "left", "right"),
    [
        (Gait.STANDING, 0.1, 0.25, 0.25),
        (Gait.WALKING, 0.1, 0.6, 0.1),
        (Gait.WALKING, 0.7, 0.2, 0.7),
        (Gait.JUMPING, 0.1, 0.1, 0.1),
        (Gait.HOPPING_LEFT, 0.1, 0.1, 0.75),
        (Gait.HOPPING_RIGHT, 0.1, 0.75, 0.1),
    ],
)
def test_foot_phases_of_each_gait(gait: Gait, phase: float, left: float, right: float) -> None:
    np.testing.assert_allclose(foot_phases(np.array(phase), np.array(gait)), [left, right], atol=1e-12)


def test_clock_is_plus_one_in_mid_stance_and_minus_one_in_mid_swing() -> None:
    np.testing.assert_allclose(clock(np.array([0.0, 0.25, 0.5, 0.75])), [0, 1, 0, -1], atol=1e-12)


@pytest.mark.parametrize(
    ("phase", "expected"),
    # C(0) = 1/2; sigma = 0.05, so 0.05 and 0.1 are one and two standard deviations into stance.
    [(0.0, 0.5), (0.05, 0.841344746), (0.1, 0.977249868), (0.25, 1.0), (0.5, 0.5), (0.55, 0.158655254), (0.75, 0.0)],
)
def test_expected_contact_values(phase: float, expected: float) -> None:
    assert float(expected_contact(np.array(phase))) == pytest.approx(expected, abs=1e-6)


def test_expected_contact_is_periodic() -> None:
    near = np.array([1e-9, 0.01, 0.04])
    # Just before the end of the cycle the next stance begins: the same as just before its start, by symmetry 1 - C.
    np.testing.assert_allclose(expected_contact(1.0 - near), 1.0 - expected_contact(near), atol=1e-9)
    assert float(expected_contact(np.array(1.0))) == pytest.approx(float(expected_contact(np.array(0.0))), abs=1e-9)


def _boundary_quintic(x0: float, y0: float, x1: float, y1: float) -> np.polynomial.Polynomial:
    """The quintic with values y0, y1 and zero first and second derivatives at x0, x1, from its 6 x 6 system."""
    rows = []
    for x in (x0, x1):
        rows.append([x**k for k in range(6)])
        rows.append([k * x ** (k - 1) if k >= 1 else 0.0 for k in range(6)])
        rows.append([k * (k - 1) * x ** (k - 2) if k >= 2 else 0.0 for k in range(6)])
    return np.polynomial.Polynomial(np.linalg.solve(np.array(rows), np.array([y0, 0, 0, y1, 0, 0])))


def test_swing_profile_solves_the_boundary_systems() -> None:
    rise, fall = _boundary_quintic(0.5, 0.0, 0.75, 0.15), _boundary_quintic(0.75, 0.15, 1.0, 0.0)
    up, down = np.linspace(0.5, 0.75, 51), np.linspace(0.75, 1.0, 51)
    np.testing.assert_allclose(swing_height(up, 0.15), rise(up), atol=1e-9)
    np.testing.assert_allclose(swing_height(down, 0.15), fall(down), atol=1e-9)


def test_torch_and_numpy_agree() -> None:
    rng = np.random.default_rng(0)
    phase, height = rng.uniform(0, 1, 500), rng.uniform(0.1, 0.35, 500)
    gait = rng.integers(0, len(Gait), 500)
    tensors = torch.from_numpy(phase), torch.from_numpy(gait), torch.from_numpy(height)
    feet, torch_feet = foot_phases(phase, gait), foot_phases(tensors[0], tensors[1])
    assert torch_feet.dtype == torch.float64
    np.testing.assert_allclose(torch_feet.numpy(), feet, atol=1e-12)
    np.testing.assert_allclose(clock(torch_feet).numpy(), clock(feet), atol=1e-12)
    np.testing.assert_allclose(expected_contact(torch_feet).numpy(), expected_contact(feet), atol=1e-12)
    np.testing.assert_allclose(
        swing_height(torch_feet, tensors[2][:, None]).numpy(), swing_height(feet, height[:, None]), atol=1e-12
    )


def test_the_rate_of_a_blend_is_its_derivative() -> None:
    assert [smooth_step(u) for u in (-1.0, 0.0, 0.5, 1.0, 2.0)] == [0.0, 0.0, 0.5, 1.0, 1.0]
    rate = [smooth_rate(u) for u in np.linspace(-0.5, 1.5, 1001)]
    blend = [smooth_step(u) for u in np.linspace(-0.5, 1.5, 1001)]
    assert np.gradient(blend, 0.002) == pytest.approx(rate, abs=0.012)


def test_a_bounce_is_a_free_fall_in_flight_and_its_mirror_image_in_stance() -> None:
    phase, step = np.arange(0.0, 1.0, 0.001), 0.001 / 2.0  # 2 Hz
    gait, frequency = np.full(1000, int(Gait.HOPPING_LEFT)), np.full(1000, 2.0)
    height, speed = bounce(phase, gait, frequency)
    acceleration = np.gradient(speed, step)
    np.testing.assert_allclose(np.gradient(height, step), speed, atol=6e-3)
    np.testing.assert_allclose(acceleration[1:499], 9.81)
    np.testing.assert_allclose(acceleration[501:999], -9.81)
    assert height.mean() == pytest.approx(0.0, abs=1e-12) and height[0] == height[500] == 0.0


def test_a_bounce_is_for_jumps_and_hops_alone_and_always_finite() -> None:
    gait, frequency = torch.tensor([0, 1, 2, 3, 4]), torch.tensor([0.0, 2.0, 0.0, math.inf, 2.0])
    height, speed = bounce(torch.full((5,), 0.75), gait, frequency)
    assert torch.isfinite(height).all() and torch.isfinite(speed).all()
    assert (height != 0.0).tolist() == [False, False, True, True, True]

"""Quaternion functions against Pinocchio and hand-computed turns."""

import math

import numpy as np
import pinocchio as pin
import pytest

from hugwbc import rotations


def _random_quaternions(count: int, seed: int = 0) -> np.ndarray:
    q = np.random.default_rng(seed).normal(size=(count, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def _pin(quaternion: np.ndarray) -> pin.Quaternion:
    return pin.Quaternion(*quaternion)  # this constructor takes w first


def test_rotate_and_its_inverse_agree_with_pinocchio() -> None:
    vectors = np.random.default_rng(1).normal(size=(100, 3))
    quaternions = _random_quaternions(100)
    expected = np.array([_pin(q).matrix() @ v for q, v in zip(quaternions, vectors, strict=True)])
    np.testing.assert_allclose(rotations.rotate(quaternions, vectors), expected, atol=1e-12)
    np.testing.assert_allclose(rotations.rotate_inverse(quaternions, expected), vectors, atol=1e-12)


def test_matrix_agrees_with_pinocchio() -> None:
    quaternions = _random_quaternions(50)
    expected = np.array([_pin(q).matrix() for q in quaternions])
    np.testing.assert_allclose(rotations.to_matrix(quaternions), expected, atol=1e-12)


def test_product_agrees_with_pinocchio() -> None:
    a, b = _random_quaternions(50, 2), _random_quaternions(50, 3)
    products = [(_pin(p) * _pin(q)).coeffs() for p, q in zip(a, b, strict=True)]  # (x, y, z, w)
    np.testing.assert_allclose(rotations.multiply(a, b), np.roll(products, 1, axis=1), atol=1e-12)


def test_yaw_pitch_roll_agree_with_pinocchio() -> None:
    rng = np.random.default_rng(4)
    for _ in range(50):
        yaw, roll = rng.uniform(-math.pi, math.pi, 2)
        pitch = rng.uniform(-1.5, 1.5)
        q = rotations.from_yaw_pitch_roll(yaw, pitch, roll)
        np.testing.assert_allclose(rotations.to_matrix(q), pin.rpy.rpyToMatrix(roll, pitch, yaw), atol=1e-12)
        measured = rotations.yaw_of(q), rotations.pitch_of(q), rotations.roll_of(q)
        np.testing.assert_allclose(measured, (yaw, pitch, roll), atol=1e-9)


def test_pitch_is_positive_forward_and_finite_when_straight_down() -> None:
    down = rotations.from_axis_angle(np.array([0.0, 1.0, 0.0]), math.pi / 2)
    np.testing.assert_allclose(rotations.rotate(down, np.array([1.0, 0, 0])), [0, 0, -1], atol=1e-12)
    assert rotations.pitch_of(down) == pytest.approx(math.pi / 2)
    # A quaternion a hair beyond unit length must not give NaN.
    assert np.isfinite(rotations.pitch_of(down * (1 + 1e-9)))


@pytest.mark.parametrize(
    ("angle", "expected"),
    [(0.0, 0.0), (math.pi, -math.pi), (-math.pi, -math.pi), (4.0, 4.0 - 2 * math.pi), (13, 13 - 4 * math.pi)],
)
def test_wrap_angle(angle: float, expected: float) -> None:
    assert rotations.wrap_angle(angle) == pytest.approx(expected)


def test_a_matrix_gives_its_quaternion_back() -> None:
    rng = np.random.default_rng(0)
    for quaternion in np.eye(4).tolist() + rng.normal(size=(50, 4)).tolist():
        unit = np.array(quaternion) / np.linalg.norm(quaternion)
        found = rotations.from_matrix(rotations.to_matrix(unit))
        assert abs(found @ unit) == pytest.approx(1.0, abs=1e-12)

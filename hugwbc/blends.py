"""The minimum-jerk blend: from one value to another with velocity and acceleration zero at both ends.

s(u) = 10 u^3 - 15 u^4 + 6 u^5 (Flash and Hogan, 1985). The functions take numbers, NumPy arrays or torch tensors.
"""

from typing import TypeVar

U = TypeVar("U")


def minimum_jerk(u: U, distance: U | float = 1.0) -> U:
    """Return `distance` times s(u).

    Args:
        u: the part of the time that has passed, from 0 to 1.
        distance: what the blend covers in all, broadcast with `u`.
    """
    return distance * u**3 * (10.0 - 15.0 * u + 6.0 * u**2)  # type: ignore[operator,return-value]


def smooth_step(u: float) -> float:
    """Return s(u), and 0 before u = 0 and 1 after u = 1."""
    return minimum_jerk(min(max(u, 0.0), 1.0))


def smooth_rate(u: float) -> float:
    """Return the derivative of `smooth_step`."""
    u = min(max(u, 0.0), 1.0)
    return 30.0 * (u * (1.0 - u)) ** 2

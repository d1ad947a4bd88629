"""What every task gives to the QP.

Tasks multiply by `dot`: on matrices as small as theirs it takes less than half the time of `@`.
"""

from typing import Literal, NamedTuple, Protocol

import numpy as np

from hugwbc.mbc.dynamics import Dynamics

_WORLD_ROWS = np.eye(5, 6)


def line_contact_rows(rotation: np.ndarray) -> np.ndarray:
    """What a foot with a line contact, and no ankle roll, is free in: shape (5, 6).

    Times a frame's velocity, x, y and z in the world, then the angular velocity about the foot's own y and z.

    Args:
        rotation: axes of the foot in the world, shape (3, 3).
    """
    rows = _WORLD_ROWS.copy()
    rows[3:, 3:] = rotation.T[1:]
    return rows


class TaskTerms(NamedTuple):
    """Rows of a least-squares cost: sum of weight * (jacobian dv/dt + drift - acceleration)^2.

    Attributes:
        jacobian: shape (k, nv).
        drift: rate of the task velocity at dv/dt = 0, shape (k,).
        acceleration: desired rate of the task velocity, shape (k,).
        weight: shape (k,).
        error: desired minus actual, in the task's unit, shape (k,).
    """

    jacobian: np.ndarray
    drift: np.ndarray
    acceleration: np.ndarray
    weight: np.ndarray
    error: np.ndarray


class Task(Protocol):
    """A quantity that the controller drives to a target.

    Attributes:
        name: for the diagnostics.
        unit: of the error.
        level: whether the error is one of position (its rate is minus jacobian v) or of velocity (its rate is minus
            jacobian dv/dt minus drift).
    """

    name: str
    unit: str
    level: Literal["position", "velocity"]

    def evaluate(self, dynamics: Dynamics) -> TaskTerms:
        """The rows at the dynamics' state."""
        ...

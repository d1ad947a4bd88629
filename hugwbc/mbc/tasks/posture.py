"""Joints that have a target of their own: waist and arms."""

from typing import Literal

import numpy as np

from hugwbc.kinematics import in_place
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.tasks.task import TaskTerms


class PostureTask:
    r"""Joint positions.

    .. math:: \ddot q^* = k_d (\mathrm{sat}(\dot q_d + \tfrac{k_p}{k_d} (q_d - q)) - \dot q)

    which is PD with a bound on the speed at which a gap is closed, so that a jump of the target stays harmless [rad].

    Attributes:
        target, rate: q_d [rad] and its velocity [rad/s], shape (k,).
        stiffness, damping: k_p [1/s^2], k_d [1/s], shape (k,).
        weight: shape (k,).
        speed: bound on the closing speed [rad/s].
    """

    unit = "rad"
    level: Literal["position", "velocity"] = "position"

    def __init__(self, name: str, joints: np.ndarray, speed: float) -> None:
        """A task on some joints, given as indices of the robot's joint vectors."""
        self.name = name
        self.target = np.zeros(joints.size)
        self.rate = np.zeros(joints.size)
        self.stiffness = np.ones(joints.size)
        self.damping = np.ones(joints.size)
        self.weight = np.ones(joints.size)
        self.speed = speed
        self._joints = joints
        self._in_q: slice | np.ndarray | None = None

    def evaluate(self, dynamics: Dynamics) -> TaskTerms:
        """One row per joint."""
        if self._in_q is None:
            columns = dynamics.columns[self._joints]
            self._in_q, self._in_v = in_place(columns + 1), in_place(columns)
            self._jacobian = np.eye(dynamics.nv)[columns]
            self._drift = np.zeros(self._joints.size)
        error = self.target - dynamics.q[self._in_q]
        wanted = self.rate + self.stiffness / self.damping * error
        closing = np.minimum(np.maximum(wanted, -self.speed), self.speed)
        acceleration = self.damping * (closing - dynamics.v[self._in_v])
        return TaskTerms(self._jacobian, self._drift, acceleration, self.weight, error)

"""Sagittal motion of the pelvis while walking."""

import math
from typing import Literal

import numpy as np

from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.tasks.task import TaskTerms


class PelvisTravelTask:
    r"""Pelvis along the heading as the linear inverted pendulum of the plan moves.

    .. math:: \ddot x^* = \omega^2 (c - p_{cop}) + k_d (\dot x_d - \dot x), \qquad k_d = 0 \text{ by default}

    with c the centre of mass along the heading [m]. The pelvis and not the centre of mass follows the pendulum: the
    velocity command is the pelvis's, and the lifted leg's mass would otherwise shake it to and fro. Across the heading
    a single line-shaped foot has no authority, hence there is no such row.

    Attributes:
        heading: direction of the row [rad].
        speed: commanded velocity along it, for the error only unless damped [m/s].
        feedforward: the pendulum's acceleration [m/s^2].
    """

    name = "pelvis travel"
    unit = "m/s"
    level: Literal["position", "velocity"] = "velocity"

    def __init__(self, params: ControllerParams) -> None:
        self.heading = 0.0
        self.speed = 0.0
        self.feedforward = 0.0
        self._damping = params.travel_damping
        self._weight = np.array([params.travel_weight])

    def evaluate(self, dynamics: Dynamics) -> TaskTerms:
        """One row, along the heading."""
        pelvis = dynamics.frame("pelvis")
        forward = np.array([[math.cos(self.heading), math.sin(self.heading)]])
        error = self.speed - float(forward[0].dot(pelvis.velocity[:2]))
        return TaskTerms(
            forward.dot(pelvis.jacobian[:2]),
            forward.dot(pelvis.drift[:2]),
            np.array([self.feedforward + self._damping * error]),
            self._weight,
            np.array([error]),
        )

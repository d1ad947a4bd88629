"""Estimate of unknown payloads from the forces on the hands."""

import math

import numpy as np

from hugwbc.controller import UpperBody
from hugwbc.numeric import changed
from hugwbc.robot import SIDES
from hugwbc.state import GRAVITY, RobotState

RATE = 3.0  # [1/s], bandwidth at which a payload is learned; the sway of a walk averages out
BAND = 1.5  # [N], part of a force that counts as friction: without it, joints that stick would make the hands hunt
HEAVIEST = 6.0  # [kg] to learn, a bound for a hand that is pulled down by something else


class PayloadObserver:
    """Learn the payload of each hand from the vertical force on it.

    The learned payload is fed forward by the servo, which takes the sag out of the arms as an integral term would: as
    long as a joint sticks, its spring's torque counts as load.

    A hand whose stiffness is wanted must give way, so nothing is learned for it. Nor is anything for a hand that
    presses up or down: where it meets nothing, the force that is missing would count as a payload, and the hand would
    float.

    Attributes:
        payload: mass in the left and the right hand [kg], shape (2,).
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget what the hands carry."""
        self.payload = np.zeros(len(SIDES))

    def complete(self, upper_body: UpperBody, state: RobotState, dt: float) -> UpperBody:
        """Return the arm targets with the learned payload, if none is told.

        Args:
            upper_body: targets of the arms.
            state: the robot now, which must be finite; without forces on the hands nothing is learned.
            dt: time since the last call [s].
        """
        told = upper_body.payload
        if not upper_body.indicator or upper_body.stiffness is not None:
            self.reset()
            return upper_body
        if told is not None:
            self.payload = np.minimum(told, HEAVIEST)  # what is no longer told is learned from here on
            return upper_body
        if state.hand_force is None:
            return upper_body
        weight = GRAVITY * self.payload
        excess = -(state.hand_force + upper_body.hand_force)[:, 2] - weight
        pressing = np.abs(upper_body.hand_force[:, 2]) > BAND
        beyond = np.where(pressing, 0.0, np.sign(excess) * np.maximum(np.abs(excess) - BAND, 0.0))
        weight = weight + (1.0 - math.exp(-RATE * dt)) * beyond
        self.payload = np.minimum(np.maximum(weight / GRAVITY, 0.0), HEAVIEST)
        return changed(upper_body, payload=self.payload.copy()) if np.count_nonzero(self.payload) else upper_body

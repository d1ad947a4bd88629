"""When an episode ends early."""

import torch

from hugwbc.gait import Gait
from hugwbc.learned.readings import Readings, feet_on_ground
from hugwbc.robot import Robot
from hugwbc.sim.simulation import FALL_HEIGHT, FALL_PITCH, FALL_ROLL


def fallen(readings: Readings, robot: Robot) -> torch.Tensor:
    """Large inclination or a low pelvis, shape (n,), bool.

    The paper also ends episodes at contacts of the trunk. The only thing that touches it before one of these limits is
    passed are the robot's own arms, moved by the intervention: no fall, and nothing that the policy can help.
    """
    tilted = (readings.pitch.abs() > FALL_PITCH) | (readings.roll.abs() > FALL_ROLL)
    return tilted | (readings.height + robot.nominal_height < FALL_HEIGHT)


def held_foot_down(readings: Readings, gait: torch.Tensor) -> torch.Tensor:
    """Whether a hopping robot's held foot touches the ground, shape (n,), bool; `gait` has values of `Gait`, (n,)."""
    left, right = feet_on_ground(readings.foot_force).unbind(1)
    return ((gait == Gait.HOPPING_LEFT) & right) | ((gait == Gait.HOPPING_RIGHT) & left)

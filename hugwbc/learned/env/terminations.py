"""When an episode ends early."""

import torch

from hugwbc.gait import Gait
from hugwbc.learned.env.readings import Readings, feet_on_ground
from hugwbc.robot import Robot
from hugwbc.sim.simulation import FALL_HEIGHT, FALL_PITCH, FALL_ROLL

LONGEST_TOUCH = 0.07  # [s], of the ground by the held foot of a hop


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


class HeldFootRule:
    """Ends the episodes of hopping robots whose held foot stays on the ground.

    A brush of the ground is forgiven: ending episodes at it made the policy give up its velocity to keep the foot high.
    A third of a second is too much: a jump on both feet is no longer on the ground than that.

    Attributes:
        due: time in the episode from which the foot has to be in the air [s], shape (n,).
        down: for how long it has been on the ground [s], shape (n,).
    """

    def __init__(self, count: int, grace: float, dt: float) -> None:
        """Set up for `count` robots, `grace` [s] for lifting the foot after a new command, and control period `dt`."""
        self._grace, self._dt = grace, dt
        self.due = torch.zeros(count)
        self.down = torch.zeros(count)

    def restart(self, robots: torch.Tensor, age: torch.Tensor, *, hopping: bool = False) -> None:
        """Note that some robots (indices, of whole ages `age` (k,)) have a new command, or start in mid-hop."""
        self.due[robots] = age * self._dt + (0.0 if hopping else self._grace)
        self.down[robots] = 0.0

    def broken(self, readings: Readings, gait: torch.Tensor, age: torch.Tensor) -> torch.Tensor:
        """Whether the episodes end, shape (n,), bool; to be asked once in a control step.

        Args:
            readings: after the step.
            gait: values of `Gait`, shape (n,).
            age: control steps since the episode's start, shape (n,).
        """
        self.down = torch.where(held_foot_down(readings, gait), self.down + self._dt, 0.0)
        return (self.down > LONGEST_TOUCH) & (age * self._dt >= self.due)

    def state_dict(self) -> dict[str, torch.Tensor]:
        """What a resumed run needs."""
        return {"due": self.due, "down": self.down}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore what `state_dict` gave."""
        self.due, self.down = state["due"].clone(), state["down"].clone()

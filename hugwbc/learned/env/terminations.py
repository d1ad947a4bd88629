"""Early ends of episodes: falls, and hops on both feet."""

import torch

from hugwbc.gait import held
from hugwbc.learned.env.readings import Readings, Transition, feet_on_ground
from hugwbc.robot import Robot
from hugwbc.sim.engine import FALL_HEIGHT, FALL_PITCH, FALL_ROLL

LONGEST_TOUCH = 0.07  # [s] for which feet may be on the ground where their gait forbids it


def fallen(readings: Readings, robot: Robot) -> torch.Tensor:
    """Return whether a robot is inclined too far or its pelvis too low, shape (n,), bool.

    The paper also ends episodes at contacts of the trunk. Before one of the limits here is passed, only the robot's
    own arms touch the trunk, moved by the intervention. That is not a fall, and the policy cannot avoid it.
    """
    tilted = (readings.pitch.abs() > FALL_PITCH) | (readings.roll.abs() > FALL_ROLL)
    return tilted | (readings.height + robot.nominal_height < FALL_HEIGHT * robot.nominal_height)


def held_foot_down(readings: Readings | Transition, gait: torch.Tensor) -> torch.Tensor:
    """Return whether the held foot of a hopping robot is on the ground, shape (n,), bool."""
    return (held(gait) & feet_on_ground(readings.foot_force)).any(1)


class FeetRule:
    """A rule that ends an episode when the feet violate their gait for too long.

    A brief touch is allowed: ending episodes at it made the policy give up its velocity to keep the foot high. A third
    of a second would be too long: a jump on both feet stays on the ground no longer than that.

    Attributes:
        due: time in the episode from which the rule holds [s], shape (n,).
        down: time for which the feet have done what is forbidden [s], shape (n,).
    """

    def __init__(self, count: int, grace: float, dt: float, device: torch.device | None = None) -> None:
        """Set up the rule, which holds from a time after a new command on: the grace [s]."""
        self._grace, self._dt = grace, dt
        self.due, self.down = torch.zeros(2, count, device=device)

    def restart(self, robots: torch.Tensor, age: torch.Tensor, *, in_motion: bool = False) -> None:
        """Note that robots have a new command.

        Args:
            robots: indices, shape (k,).
            age: control steps since the start of their episodes, shape (k,).
            in_motion: whether they start in the middle of the gait, and so get no time to find into it.
        """
        self.due[robots] = age * self._dt + (0.0 if in_motion else self._grace)
        self.down[robots] = 0.0

    def broken(self, forbidden: torch.Tensor, age: torch.Tensor) -> torch.Tensor:
        """Return which episodes end, shape (n,), bool; call it once per control step.

        Args:
            forbidden: whether the feet do what their gait forbids, shape (n,), bool.
            age: control steps since the start of each episode, shape (n,).
        """
        self.down = torch.where(forbidden, self.down + self._dt, 0.0)
        return (self.down > LONGEST_TOUCH) & (age * self._dt >= self.due)

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Return everything that a resumed run needs."""
        return {"due": self.due, "down": self.down}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore what `state_dict` returned."""
        self.due, self.down = state["due"].clone(), state["down"].clone()

"""Early ends of episodes: falls, and hops on both feet."""

import torch

from hugwbc.gait import Gait
from hugwbc.learned.env.readings import Readings, feet_on_ground
from hugwbc.robot import Robot
from hugwbc.sim.engine import FALL_HEIGHT, FALL_PITCH, FALL_ROLL

LONGEST_TOUCH = 0.07  # [s] for which the held foot of a hop may touch the ground


def fallen(readings: Readings, robot: Robot) -> torch.Tensor:
    """Return whether a robot is inclined too far or its pelvis too low, shape (n,), bool.

    The paper also ends episodes at contacts of the trunk. Before one of the limits here is passed, only the robot's
    own arms touch the trunk, moved by the intervention. That is not a fall, and the policy cannot avoid it.
    """
    tilted = (readings.pitch.abs() > FALL_PITCH) | (readings.roll.abs() > FALL_ROLL)
    return tilted | (readings.height + robot.nominal_height < FALL_HEIGHT)


def held_foot_down(readings: Readings, gait: torch.Tensor) -> torch.Tensor:
    """Return whether the held foot of a hopping robot is on the ground, shape (n,), bool.

    Args:
        readings: state of the robots.
        gait: values of `Gait`, shape (n,).
    """
    left, right = feet_on_ground(readings.foot_force).unbind(1)
    return ((gait == Gait.HOPPING_LEFT) & right) | ((gait == Gait.HOPPING_RIGHT) & left)


class HeldFootRule:
    """The rule that ends an episode of hopping when the held foot stays on the ground.

    A brief touch is allowed: ending episodes at it made the policy give up its velocity to keep the foot high. A third
    of a second would be too long: a jump on both feet stays on the ground no longer than that.

    Attributes:
        due: time in the episode from which the foot must be in the air [s], shape (n,).
        down: time for which the foot has been on the ground [s], shape (n,).
    """

    def __init__(self, count: int, grace: float, dt: float) -> None:
        """Set up the rule.

        Args:
            count: number of robots.
            grace: time after a new command in which the foot may still be on the ground [s].
            dt: control period [s].
        """
        self._grace, self._dt = grace, dt
        self.due = torch.zeros(count)
        self.down = torch.zeros(count)

    def restart(self, robots: torch.Tensor, age: torch.Tensor, *, hopping: bool = False) -> None:
        """Note that robots have a new command.

        Args:
            robots: indices, shape (k,).
            age: control steps since the start of their episodes, shape (k,).
            hopping: whether they start in the middle of a hop, and so get no time to lift the foot.
        """
        self.due[robots] = age * self._dt + (0.0 if hopping else self._grace)
        self.down[robots] = 0.0

    def broken(self, readings: Readings, gait: torch.Tensor, age: torch.Tensor) -> torch.Tensor:
        """Return which episodes end, shape (n,), bool; call it once per control step.

        Args:
            readings: after the step.
            gait: values of `Gait`, shape (n,).
            age: control steps since the start of each episode, shape (n,).
        """
        self.down = torch.where(held_foot_down(readings, gait), self.down + self._dt, 0.0)
        return (self.down > LONGEST_TOUCH) & (age * self._dt >= self.due)

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Return everything that a resumed run needs."""
        return {"due": self.due, "down": self.down}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore what `state_dict` returned."""
        self.due, self.down = state["due"].clone(), state["down"].clone()

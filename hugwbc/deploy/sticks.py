"""Commands from the sticks of the remote control."""

import math

from hugwbc.commands import Command, command_ranges
from hugwbc.deploy.remote import Remote
from hugwbc.gait import Gait
from hugwbc.robot import Robot
from hugwbc.targets import HandTargets

_SLOPE = {"v_x": 0.5, "v_y": 0.4, "omega": 0.8}  # largest change [m/s^2], [rad/s^2]
_STILL = 1.0  # [s] with all sticks at rest and no speed left, after which the robot stands
_SMALL = 1e-6


class Sticks:
    """A source of commands: the left stick gives v_x and v_y, the right one omega.

    A stick at its end asks for half of the walking gait's range ahead, and for all of it to the other sides. Commands
    follow with limited slope; after a second without any, the robot stands.
    """

    def __init__(self, robot: Robot) -> None:
        """Begin standing; the ranges are the robot's."""
        self._ranges = command_ranges(Gait.WALKING, robot)
        self._asked = dict.fromkeys(_SLOPE, 0.0)
        self._used = dict.fromkeys(_SLOPE, 0.0)
        self._time: float | None = None
        self._moved = -math.inf

    def steer(self, remote: Remote, time: float) -> None:
        """Take the sticks at a time [s]."""
        step = 0.0 if self._time is None else max(time - self._time, 0.0)
        self._time = time
        self._asked = {
            "v_x": self._scaled("v_x", remote.ly) * (0.5 if remote.ly > 0.0 else 1.0),
            "v_y": self._scaled("v_y", -remote.lx),
            "omega": self._scaled("omega", -remote.rx),
        }
        for name, slope in _SLOPE.items():
            change = self._asked[name] - self._used[name]
            self._used[name] += min(max(change, -slope * step), slope * step)
        if any(abs(value) > _SMALL for value in (*self._asked.values(), *self._used.values())):
            self._moved = time

    def command_at(self, t: float) -> Command:
        """Return the command now; `t` does not matter."""
        if self._time is None or self._time - self._moved > _STILL:
            return Command(gait=Gait.STANDING)
        return Command(**self._used, gait=Gait.WALKING)

    def hands_at(self, t: float) -> HandTargets | None:
        """Leave the arms to the controller."""
        return None

    def _scaled(self, name: str, stick: float) -> float:
        low, high = self._ranges[name].finishing
        return stick * (high if stick > 0.0 else -low)

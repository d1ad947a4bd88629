"""A command source for a person at a page: what the person asks for becomes commands that a robot can follow."""

import dataclasses
import threading

import numpy as np

from hugwbc.commands import COMMAND_NAMES, VELOCITY_NAMES, Command, command_ranges, default_command
from hugwbc.gait import Gait
from hugwbc.targets import HandTargets

# How fast commands follow the sliders, in the command's unit per second, in the order of COMMAND_NAMES.
RATES = np.array([0.5, 0.5, 1.0, 1.0, 0.3, 0.2, 0.4, 0.8])
SLOW = 0.02  # [m/s, rad/s]; a robot with slower commands may change its gait


class LiveSource:
    """Commands that ramp towards the wanted command; the robot comes to rest before it changes its gait.

    Several threads may ask for values at any time.

    Attributes:
        wanted: the command that the person asks for, with its gait.
        hands: the hand targets; None leaves the arms to the controller.
    """

    def __init__(self, wanted: Command | None = None) -> None:
        self.wanted = wanted or Command()
        self.hands: HandTargets | None = None
        self._command = default_command(self.wanted.gait)
        self._t = 0.0
        self._asking = threading.Lock()

    def restart(self) -> None:
        """Set the time back to 0 and start from rest in the wanted gait."""
        self._command = default_command(self.wanted.gait)
        self._t = 0.0

    def ask(self, name: str, value: float) -> None:
        """Ask for a value of one command; a value outside the range of the gait is clamped."""
        with self._asking:
            self.wanted = dataclasses.replace(self.wanted, **{name: value}).clamp()[0]

    def ask_gait(self, gait: Gait) -> None:
        """Ask for a gait; values outside its ranges are clamped."""
        with self._asking:
            self.wanted = dataclasses.replace(self.wanted, gait=gait).clamp()[0]

    def command_at(self, t: float) -> Command:
        """Return the command at time t [s], as far as the ramps have come."""
        dt, self._t = max(0.0, t - self._t), max(t, self._t)
        wanted, gait = self.wanted, self._command.gait
        goal = wanted.array()
        if wanted.gait is not gait:
            moving = max(abs(getattr(self._command, name)) for name in VELOCITY_NAMES)
            if moving <= SLOW:
                gait = wanted.gait
            else:
                goal[: len(VELOCITY_NAMES)] = 0.0  # come to rest first
        # The ranges are those of the present gait: the wanted one may admit velocities that this one does not.
        low, high = np.array([command_ranges(gait)[name].finishing for name in COMMAND_NAMES]).T
        value = np.clip(self._command.array(), low, high)
        step = RATES * dt
        self._command = Command.from_array(value + np.clip(np.clip(goal, low, high) - value, -step, step), gait)
        return self._command

    def hands_at(self, t: float) -> HandTargets | None:
        """Return the present hand targets."""
        return self.hands

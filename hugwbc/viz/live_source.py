"""A command source for a person at a page: what the person asks for becomes commands that a robot can follow."""

import dataclasses
import threading
import time

import numpy as np

from hugwbc.commands import COMMAND_NAMES, VELOCITY_NAMES, Command, command_ranges, default_command
from hugwbc.gait import Gait
from hugwbc.robot import Robot
from hugwbc.scripts.socket_source import SILENCE, SocketSource
from hugwbc.targets import HandTargets

# How fast commands follow the sliders, in the command's unit per second, in the order of COMMAND_NAMES.
RATES = np.array([0.5, 0.5, 1.0, 1.0, 0.3, 0.2, 0.4, 0.8])
NOTICE_TIME = 6.0  # [s] that a notice is shown
SLOW = 0.02  # [m/s, rad/s]; a robot with slower commands may change its gait


class LiveSource:
    """Commands that ramp towards the requested one; the robot comes to rest before it changes to another moving gait.

    A stand is asked for at once, because every control loop brakes before it (`hugwbc.runtime.braking`).

    Several threads may ask for values at any time. While another program's messages come, they count instead, until the
    person says stop.
    """

    def __init__(self, robot: Robot, stream: SocketSource | None = None) -> None:
        self.robot = robot  # whose ranges count
        self._stream, self.following = stream, False  # whether another program gives the commands now
        self._stopped = False  # whether the person stopped that program, which has not been silent since
        self.requested = default_command(Gait.STANDING, robot)  # what the person asks for
        self.hands: HandTargets | None = None  # None leaves the arms to the controller
        self.notice, self.noticed = "", -np.inf  # what was done with the last request, for people; shown until then
        self._walks_by_itself = self._paused = False
        self.command = self.requested  # as far as the ramps have come
        self._t = 0.0
        self._asking = threading.Lock()

    def stand(self) -> None:
        """Ask for nothing but standing."""
        with self._asking:
            self.requested, self._walks_by_itself = default_command(Gait.STANDING, self.robot), False

    def tell(self, notice: str, shown: float = NOTICE_TIME) -> None:
        """Say something to the person, shown for a time [s]."""
        self.notice, self.noticed = notice, time.monotonic() + shown

    def ask(self, name: str, value: float) -> None:
        """Ask for a value of one command; a value outside the range of the gait is clamped.

        A velocity makes a standing robot walk, because standing admits none.
        """
        if self.following:
            return
        with self._asking:
            gait = self.requested.gait
            if gait is Gait.STANDING and name in VELOCITY_NAMES and abs(value) > 0.0:
                gait, self._walks_by_itself = Gait.WALKING, True
                self.tell("standing allows no velocity: the robot starts walking")
            self.requested, changes = dataclasses.replace(self.requested, **{name: value}, gait=gait).clamp(self.robot)
            if changes:
                self.tell(f"{gait.label}: {changes[0]}")

    def ask_gait(self, gait: Gait) -> None:
        """Ask for a gait; values outside its ranges are clamped."""
        if self.following:
            return
        with self._asking:
            self._walks_by_itself = False
            self.requested, changes = dataclasses.replace(self.requested, gait=gait).clamp(self.robot)
            if changes:
                self.tell(f"{gait.label}: {'; '.join(map(str, changes))}")

    def let_go(self) -> None:
        """Request a stand if the robot walks only because a velocity was requested, and none is any more."""
        if self.following:
            return
        with self._asking:
            if self._walks_by_itself and not any(getattr(self.requested, name) for name in VELOCITY_NAMES):
                self._stand_still()

    def stop(self) -> None:
        """Request a stand, whoever drives; another program counts again once it has been silent."""
        with self._asking:
            if self.following:
                self.following, self._stopped = False, True
                self.tell(f"stopped: the other program drives again once it has sent nothing for {SILENCE:g} s")
            self._stand_still()

    def pause(self, *, on: bool) -> None:
        """Stand and wait, or continue with the command, by the usual ramps."""
        self._paused = on

    def halt(self, reason: str) -> None:
        """Request a stand, because nobody drives; the reason is for people."""
        if self.following:
            return
        with self._asking:
            self._stand_still()
            self.tell(reason)

    def _stand_still(self) -> None:
        """Replace the request by a stand with the same posture, as far as a stand admits it."""
        at_rest = dataclasses.replace(self.requested, **dict.fromkeys(VELOCITY_NAMES, 0.0), gait=Gait.STANDING)
        self.requested, self._walks_by_itself = at_rest.clamp(self.robot)[0], False

    def command_at(self, t: float) -> Command:
        """Return the command at time t [s], as far as the ramps have come; time that goes back starts from rest."""
        if self._follow():
            self._t = t
            return self.command
        if t < self._t:
            self._t, self.command = 0.0, default_command(self.requested.gait, self.robot)
        dt, self._t = t - self._t, t
        requested, gait = self.requested.array(), self.command.gait
        requested_gait = Gait.STANDING if self._paused else self.requested.gait
        if requested_gait is not gait:
            moving = max(abs(getattr(self.command, name)) for name in VELOCITY_NAMES)
            if moving <= SLOW or requested_gait is Gait.STANDING:
                gait = requested_gait
            else:
                requested[: len(VELOCITY_NAMES)] = 0.0  # come to rest first
        # The ranges are those of the present gait: the requested one may admit velocities that this one does not.
        low, high = np.array([command_ranges(gait, self.robot)[name].finishing for name in COMMAND_NAMES]).T
        value = np.clip(self.command.array(), low, high)
        step = RATES * dt
        self.command = Command.from_array(value + np.clip(np.clip(requested, low, high) - value, -step, step), gait)
        return self.command

    def hands_at(self, t: float) -> HandTargets | None:
        """Return the present hand targets."""
        return self._stream.hands_at(t) if self._stream is not None and self.following else self.hands

    def _follow(self) -> bool:
        """Take the command of the other program, and return whether its messages come."""
        if self._stream is None:
            return False
        command = self._stream.command_at(0.0)
        self._stopped = self._stopped and self._stream.driven
        if self._stream.driven and not self._stopped:
            self.following, self.requested, self.command = True, command, command
        elif self.following:
            self.following = False
            self.stand()
            self.tell("the other program is silent: the robot stands, and can be driven from here")
        return self.following

"""The way from one gait to another: brake until the robot is slow, stand, and only then start the other."""

import dataclasses
import math

import numpy as np

from hugwbc.commands import VELOCITY_NAMES, Command, default_command
from hugwbc.gait import Gait
from hugwbc.robot import Robot
from hugwbc.state import RobotState
from hugwbc.stride import OverStride

DECELERATION = np.array([1.0, 1.0, 2.0])  # of the commanded v_x, v_y [m/s^2] and omega [rad/s^2]
SLOW = np.array([0.15, 0.15, 0.3])  # [m/s], [m/s], [rad/s]; a slower robot may stand
PAUSE = 0.5  # [s], shortest stand before another gait
JUMPS = 1.5  # [s] of jumps after hops
LONGEST = 4.0  # [s] at rest by the command, after which the robot stands however fast it seems to be


class Braking:
    """Turns a jump from one gait to another into a stop: brake, stand, and then start the other.

    A controller that is switched from a fast walk straight to standing falls: the next step, which would catch the
    body, is missing. The commanded velocity therefore falls at `DECELERATION` in the present gait. A posture that
    changes in a leap would turn the body in the air, so that only a walk takes the new one. From a hop the robot would
    stand on one leg; it jumps for `JUMPS` first, which puts both feet down. It stands once its mean velocity over a
    stride, within which the pelvis sways, is below `SLOW`. A robot of unknown velocity counts as slow one stride after
    the command has come to rest. A walk ends in the middle of a stance (`hugwbc.stride.MidStance`). After a stand of
    `PAUSE`, in the posture of the command, another gait may start.

    Attributes:
        active: whether the robot is being braked, or stands before another gait.
    """

    def __init__(self, robot: Robot | None = None) -> None:
        """Start from a stand, in the defaults of a robot or the paper's."""
        self.active, self._stand = False, default_command(Gait.STANDING, robot)
        self._stood = math.inf  # [s] since the robot stands
        self._jumps = 0.0  # [s] of the jumps after hops that are left
        self._begin(self._stand)

    def _begin(self, command: Command) -> None:
        """Start a gait at rest."""
        self._last = command
        self._velocity, self._over_stride = np.zeros(3), OverStride()
        self._at_rest = 0.0  # [s] since the commanded velocity is 0
        self._time, self._unknown = 0.0, -math.inf  # [s] in this gait, and when its velocity was last unknown

    def __call__(self, command: Command, state: RobotState, dt: float, *, mid_stance: bool = True) -> Command:
        """Return the command for the next period; a walk may end now if the robot is in mid-stance."""
        if self._last.gait is Gait.STANDING:
            self._stood += dt
            self.active = command.gait is not Gait.STANDING and self._stood < PAUSE
            if not self.active and command.gait is not Gait.STANDING:
                self._begin(command)
            stand = dataclasses.replace(self._stand, h=command.h, p=command.p, w=command.w)
            return stand if self.active else command
        self._time += dt
        if state.velocity is None or not state.is_usable:
            self._unknown = self._time
        else:
            self._velocity = self._over_stride(self._time, state.heading_velocity, 1.0 / self._last.f)
        now = mid_stance or self._last.gait is not Gait.WALKING
        self.active = command.gait is not self._last.gait or self._jumps > 0.0
        if not self.active:
            self._last, self._at_rest = command, 0.0
            return command
        if self._last.gait.hops:
            self._last, self._jumps = dataclasses.replace(self._last, gait=Gait.JUMPING), JUMPS
        self._jumps -= dt
        self._last = self._slower(command, dt)
        self._at_rest = 0.0 if any(getattr(self._last, name) for name in VELOCITY_NAMES) else self._at_rest + dt
        stops = self._jumps <= 0.0 and command.gait is not self._last.gait
        if stops and now and (self._slow() or self._at_rest > LONGEST):
            self._stood = 0.0
            self._begin(self._stand)
            return self(command, state, dt, mid_stance=mid_stance)
        return self._last

    def _slower(self, command: Command, dt: float) -> Command:
        """Return the present gait with less velocity; a walk also takes the body posture of the command."""
        last = self._last
        velocity = np.array([getattr(last, name) for name in VELOCITY_NAMES], dtype=float)
        velocity -= np.clip(velocity, -DECELERATION * dt, DECELERATION * dt)
        changed = dict(zip(VELOCITY_NAMES, velocity.tolist(), strict=True))
        posture = command if last.gait is Gait.WALKING else last
        return dataclasses.replace(last, **changed, h=posture.h, p=posture.p, w=posture.w)

    def _slow(self) -> bool:
        """Return whether the mean velocity of the last stride is small, after at least one stride."""
        stride = 1.0 / self._last.f - 1e-9
        if self._time < stride:
            return False
        if self._time - self._unknown < stride:
            return self._at_rest >= stride
        return bool((np.abs(self._velocity) <= SLOW).all())

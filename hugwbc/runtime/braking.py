"""The way from one gait to another: brake until the robot is slow, stand, and only then start the other."""

import collections
import dataclasses
import math

import numpy as np

from hugwbc import rotations
from hugwbc.commands import VELOCITY_NAMES, Command, default_command
from hugwbc.gait import Gait
from hugwbc.robot import Robot
from hugwbc.state import RobotState
from hugwbc.stride import MidStance

DECELERATION = np.array([1.0, 1.0, 2.0])  # of the commanded v_x, v_y [m/s^2] and omega [rad/s^2]
SLOW = (0.15, 0.15, 0.3)  # [m/s], [m/s], [rad/s]; a slower robot may stand
PAUSE = 0.5  # [s], shortest stand before another gait
JUMPS = 1.5  # [s] of jumps after hops
LONGEST = 4.0  # [s] at rest by the command, after which the robot stands however fast it seems to be


_Velocity = tuple[float, float, float] | None


class Braking:
    """Turns a jump from one gait to another into a stop: brake, stand, and then start the other.

    A controller that is switched from a fast walk straight to standing falls: the next step, which would catch the
    body, is missing. The commanded velocity therefore falls at `DECELERATION` in the present gait. A posture that
    changes in a leap would turn the body in the air, so that only a walk takes the new one. From a hop the robot would
    stand on one leg; it jumps for `JUMPS` first, which puts both feet down. It stands once its mean velocity over a
    stride is below `SLOW`, as the state says; the pelvis sways within a stride. A state without velocity counts as slow
    one stride after the command has come to rest. A walk ends in the moment that `MidStance` tells. After a stand of
    `PAUSE`, in the posture of the command, another gait may start.

    Attributes:
        active: whether the robot is on that way now.
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
        self._velocities: collections.deque[_Velocity] = collections.deque()  # of the last stride
        self._sum = [0.0, 0.0, 0.0]
        self._at_rest = 0.0  # [s] since the commanded velocity is 0
        self._mid_stance, self._time = MidStance(), 0.0  # [s] in this gait

    def __call__(self, command: Command, state: RobotState, dt: float) -> Command:
        """Return the command for the next period."""
        if self._last.gait is Gait.STANDING:
            self._stood += dt
            self.active = command.gait is not Gait.STANDING and self._stood < PAUSE
            if not self.active and command.gait is not Gait.STANDING:
                self._begin(command)
            stand = dataclasses.replace(self._stand, h=command.h, p=command.p, w=command.w)
            return stand if self.active else command
        stride = 1.0 / self._last.f
        self._note(_velocity(state), stride + dt, dt)
        self._time += dt
        now = self._mid_stance(self._time, state.foot_force, stride) or self._last.gait is not Gait.WALKING
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
        if stops and now and (self._slow(dt) or self._at_rest > LONGEST):
            self._stood = 0.0
            self._begin(self._stand)
            return self(command, state, dt)
        return self._last

    def _slower(self, command: Command, dt: float) -> Command:
        """Return the present gait with less velocity; a walk also takes the body posture of the command."""
        last = self._last
        velocity = np.array([getattr(last, name) for name in VELOCITY_NAMES], dtype=float)
        velocity -= np.clip(velocity, -DECELERATION * dt, DECELERATION * dt)
        changed = dict(zip(VELOCITY_NAMES, velocity.tolist(), strict=True))
        posture = command if last.gait is Gait.WALKING else last
        return dataclasses.replace(last, **changed, h=posture.h, p=posture.p, w=posture.w)

    def _slow(self, dt: float) -> bool:
        """Whether the mean velocity of the last stride is small, after at least one stride."""
        stride = 1.0 / self._last.f
        if len(self._velocities) * dt < stride:
            return False
        if any(velocity is None for velocity in self._velocities):
            return self._at_rest >= stride
        return all(abs(total) <= slow * len(self._velocities) for total, slow in zip(self._sum, SLOW, strict=True))

    def _note(self, velocity: _Velocity, longest: float, dt: float) -> None:
        """Add a velocity to those of the last `longest` seconds and to their sum; floats are faster than arrays."""
        self._velocities.append(velocity)
        if velocity is not None:
            self._sum = [total + each for total, each in zip(self._sum, velocity, strict=True)]
        while len(self._velocities) * dt > longest:
            old = self._velocities.popleft()
            if old is not None:
                self._sum = [total - each for total, each in zip(self._sum, old, strict=True)]


def _velocity(state: RobotState) -> _Velocity:
    """Return the velocity in the heading frame [m/s] and the yaw rate [rad/s]; None where it is unknown."""
    if state.velocity is None or not state.is_usable:
        return None
    x, y, _ = state.velocity.tolist()
    cosine, sine = math.cos(state.yaw), math.sin(state.yaw)
    turn = float(rotations.rotate(state.orientation, state.angular_velocity)[2])
    return cosine * x + sine * y, cosine * y - sine * x, turn

"""Pushing and pulling by walking, with the hands where they are."""

import math

import numpy as np

from hugwbc import rotations
from hugwbc.commands import Command
from hugwbc.errors import ConfigError
from hugwbc.gait import Gait
from hugwbc.scripts.behaviours.behaviour import Behaviour, Course, Failure, check_time, seen
from hugwbc.scripts.behaviours.hand_motion import check_above
from hugwbc.scripts.behaviours.view import Action, View, kept, standing

_GAIN = 0.8  # [1/s], speed per distance that is left, and per distance from the line
_TURN_GAIN = 1.0  # [1/s]
_SLOWEST = 0.08  # [m/s]
_STUCK = 3.0  # [s] in which the object has to move by a centimetre


class Push(Behaviour):
    """Walks ahead on a straight line, with the hands as they are, until an object has moved by a distance."""

    sign = 1.0

    def __init__(self, object: str, distance: float, *, speed: float = 0.2, timeout: float = 40.0) -> None:
        """Set what to move, and how far.

        Args:
            object: its name.
            distance: by how much it has to move along the robot's heading at the start [m].
            speed: of the walk [m/s].
            timeout: after which it fails [s].
        """
        check_time("timeout", timeout)
        check_above("distance", distance, 20.0)
        if not 0.05 <= speed <= 0.6:
            raise ConfigError(f"speed is {speed} m/s; give 0.05 to 0.6 m/s")
        self.object, self.distance, self.speed, self.timeout = object, distance, speed, timeout

    def course(self, view: View) -> Course:  # noqa: D102
        start, yaw, at = view.position, view.state.yaw, seen(view, self.object).position
        axes = rotations.rotation_z(yaw)
        far, time = 0.0, view.time
        while True:
            moved = self.sign * float((seen(view, self.object).position - at) @ axes[:, 0])
            left = self.distance - moved
            self.progress = f"'{self.object}' has moved by {100 * moved:.0f} of {100 * self.distance:g} cm"
            if left <= 0.0:
                break
            if moved > far + 0.01:
                far, time = moved, view.time
            if view.time - time > _STUCK + 2.0 * (far == 0.0):
                raise Failure(f"{self.progress} and is stuck")
            turn = float(rotations.wrap_angle(yaw - view.state.yaw))
            aside = float((start - view.position) @ axes[:, 1])
            command = Command(
                v_x=self.sign * min(self.speed, _GAIN * left + _SLOWEST),
                v_y=min(max(_GAIN * aside, -0.15), 0.15),
                omega=min(max(_TURN_GAIN * turn, -0.4), 0.4),
                h=view.last.command.h,
                p=view.last.command.p,
                gait=Gait.WALKING,
            )
            view = yield Action(command, kept(view))
        while view.last.command.gait is not Gait.STANDING:
            view = yield Action(standing(view), kept(view))
        return view


class Pull(Push):
    """Walks back on a straight line, with the hands as they are, until an object has moved by a distance."""

    sign = -1.0


class Stand(Behaviour):
    """Stands with a height, a pitch and a waist angle, for a time; the hands stay."""

    def __init__(self, seconds: float = 1.0, *, h: float = 0.0, p: float = 0.0, w: float = 0.0) -> None:
        """Set the posture: h [m], p and w [rad], and how long [s]."""
        check_time("seconds", seconds)
        self.command, self.seconds = Command(h=h, p=p, w=w).validate(), seconds
        self.timeout = math.inf  # its own time

    def course(self, view: View) -> Course:  # noqa: D102
        begin: float | None = None
        while begin is None or view.time - begin < self.seconds:
            last = view.last.command
            there = np.allclose(last.array(), self.command.array(), atol=1e-3) and last.gait is Gait.STANDING
            begin = view.time if begin is None and there else begin
            view = yield Action(self.command, kept(view))
        return view

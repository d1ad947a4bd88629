"""Commands as the plan follows them: within their ranges, and without jumps."""

import math
from typing import NamedTuple

import numpy as np

from hugwbc.commands import Command
from hugwbc.gait import Gait
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.reach import (
    highest_clearance,
    highest_leap_clearance,
    lowest_leaping_height,
    lowest_walking_height,
)

_HOPS = (Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT)
_LEAPS = (Gait.JUMPING, *_HOPS)
_NOTABLE = 0.005  # [m], from which on a change of h or l is reported


class SmoothCommand(NamedTuple):
    """A command that never jumps, with the rates of its body posture.

    Attributes:
        gait: as commanded.
        velocity: v_x, v_y [m/s], shape (2,).
        omega: yaw rate [rad/s].
        f: stride frequency [Hz].
        l: swing apex [m].
        h, p, w: [m], [rad], [rad].
        h_rate, p_rate, w_rate: their rates [m/s], [rad/s].
    """

    gait: Gait
    velocity: np.ndarray
    omega: float
    f: float
    l: float  # noqa: E741  the paper's symbol
    h: float
    p: float
    w: float
    h_rate: float
    p_rate: float
    w_rate: float


class CommandFilter:
    """Clamps commands to their ranges and limits their rates, so that a step command does not topple the robot."""

    def __init__(self, params: ControllerParams) -> None:
        self._params = params
        self._limits = (params.height_rate, params.pitch_rate, params.waist_rate)
        self.reset(0.0, 0.0, 0.0)

    def reset(self, h: float, p: float, w: float) -> None:
        """Start at rest from a posture [m, rad, rad]."""
        self._given: Command | None = None
        self._velocity = (0.0, 0.0, 0.0)
        self._frequency: float | None = None
        self._posture = [h, p, w]
        self._rate = [0.0, 0.0, 0.0]
        self._reached: tuple[bool, Gait, bool, float] | None = (
            None  # where nothing moves any more: the arguments it holds for
        )

    def update(
        self,
        command: Command,
        dt: float,
        *,
        stepping: bool = False,
        running: Gait = Gait.STANDING,
        waiting: bool = False,
        stray: float = 0.0,
    ) -> tuple[SmoothCommand, tuple[str, ...]]:
        """The command to follow now, and a report of what could not be followed as asked.

        Args:
            command: as given; NaN and values out of range are replaced and reported.
            dt: since the last call [s].
            stepping: whether the robot still steps, whatever the command: the limits of walking hold until it stands.
            running: the gait that the robot is still in; it comes to rest before it changes to the commanded one, at
                its own frequency and within its own limits.
            waiting: whether the robot is not ready to travel yet.
            stray: by how much the robot is faster along the heading than it was told to be, as after a push [m/s].
        """
        if command is not self._given:
            self._given = command
            valid, changes = command.clamp()
            self._valid = valid, tuple(map(str, changes))
        elif self._reached == (stepping, running, waiting, stray):
            return self._result
        before = self._state
        self._result = self._advance(*self._valid, dt, stepping, running, waiting, stray)
        self._reached = (stepping, running, waiting, stray) if self._state == before else None
        return self._result

    @property
    def _state(self) -> tuple[object, ...]:
        return self._velocity, self._frequency, *self._posture, *self._rate

    def _advance(
        self,
        command: Command,
        report: tuple[str, ...],
        dt: float,
        stepping: bool,
        running: Gait,
        waiting: bool,
        stray: float,
    ) -> tuple[SmoothCommand, tuple[str, ...]]:
        """`update` for a valid command, with what there is to report of it."""
        gait = command.gait
        stepping = stepping or gait is not Gait.STANDING
        params = self._params
        changing = running not in (Gait.STANDING, gait)
        limiting = running if changing else gait
        wanted = (0.0, 0.0, 0.0) if changing or waiting else (command.v_x, command.v_y, command.omega)
        # On three numbers, floats are several times faster than arrays.
        rates, (speed, aside, turn) = params.velocity_rate, self._velocity
        speed = _towards(speed, wanted[0], rates[0] * dt)
        aside = _towards(aside, wanted[1], rates[1] * dt)
        turn = _towards(turn, wanted[2], rates[2] * dt)
        self._velocity = speed, aside, turn
        self._frequency = command.f if self._frequency is None else self._frequency
        if not changing or gait is Gait.STANDING:
            self._frequency = _towards(self._frequency, command.f, params.frequency_rate * dt)

        h = command.h
        if stepping:
            h, why = self._stepping_height(h, speed, self._frequency, limiting, stray)
            if abs(h - command.h) > _NOTABLE:
                report += (f"h = {command.h:g} m {why}: using {h:.2f} m",)
        self._follow((h, command.p, command.w), dt)
        height = self._posture[0]
        if limiting in _LEAPS:
            apex = highest_leap_clearance(params, height, self._frequency)
        else:
            apex = highest_clearance(params, height, self._frequency, speed)
        apex = min(command.l, apex)
        if stepping and apex < command.l - _NOTABLE:
            report += (
                f"l = {command.l:g} m is more than the leg can lift at this height, f and speed: using {apex:.2f} m",
            )
        velocity = np.array([speed, aside])
        return SmoothCommand(
            gait, velocity, self._velocity[2], self._frequency, apex, *self._posture, *self._rate
        ), report

    def _stepping_height(self, h: float, speed: float, f: float, gait: Gait, stray: float) -> tuple[float, str]:
        """The h that a commanded one becomes while the legs move [m], and why.

        Args:
            h: as commanded [m].
            speed: along the heading [m/s].
            f: stride frequency [Hz].
            gait: whose limits hold.
            stray: by how much the robot is faster than that [m/s].
        """
        params = self._params
        lowering = params.speed_lowering * max(abs(speed) - params.lowering_from, 0.0)
        # In a squat a robot that was pushed could not brake: its height is that of the speed which it has.
        lowest = max(lowest_walking_height(params, each, 0.5 / f, self._posture[1]) for each in (speed, speed + stray))
        wanted, why = h - lowering, "leaves the trailing leg too short at this speed"
        if gait in _HOPS and wanted > -params.hop_lowering:
            wanted, why = -params.hop_lowering, "is too high for a leg that leans"
        if gait in _LEAPS:
            lowest = max(lowest, lowest_leaping_height(params, f, 1 if gait in _HOPS else 2))
        if h < lowest:
            # The trailing leg of a fast walk needs its lowering, wherever the stance leg's room ends.
            least = lowest if gait in _LEAPS else lowest - lowering
            if wanted < least:
                wanted, why = least, "leaves the stance leg no room to move"
        return wanted, why

    def _follow(self, target: tuple[float, float, float], dt: float) -> None:
        """Move the posture towards a target with bounded rate and bounded rate of the rate."""
        for axis, limits in enumerate(self._limits):
            self._posture[axis], self._rate[axis] = approach(
                self._posture[axis], self._rate[axis], target[axis], limits, dt
            )


def approach(value: float, rate: float, target: float, limits: tuple[float, float], dt: float) -> tuple[float, float]:
    """A value and its rate after a tick of moving to a target at a bounded rate and a bounded rate of the rate.

    Args:
        value: now.
        rate: its rate now.
        target: of the value.
        limits: largest rate and largest rate of the rate.
        dt: [s].
    """
    fastest, quickest = limits
    gap, change = target - value, quickest * dt
    if abs(gap) <= change * dt and abs(gap / dt - rate) <= change:  # it can get there now, and stop next time
        return target, gap / dt
    # Fast enough to arrive, slow enough to stop there: the smaller of the braking parabola and its tangent.
    speed = min(math.sqrt(quickest * abs(gap)), abs(gap) * 2.0 * quickest / fastest, fastest)
    rate += min(max(math.copysign(speed, gap) - rate, -change), change)
    return value + rate * dt, rate


def _towards(value: float, target: float, step: float) -> float:
    """The value after a step of bounded size towards a target."""
    return value + min(max(target - value, -step), step)

"""Filter of commands by what the legs can do now and by rate, and correction of the velocity plan by measurement."""

import math
from typing import NamedTuple

import numpy as np

from hugwbc.commands import Command
from hugwbc.gait import Gait
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.reach import (
    fastest_walk,
    highest_clearance,
    highest_leap_clearance,
    highest_leaping_height,
    lowest_leaping_height,
    lowest_walking_height,
)
from hugwbc.robot import Robot

_SETTLING_STEPS, _SETTLING_LEAPS = 3, 1  # number that the velocity trim ignores, from that of a change of command on
_HELD, _SLOWEST_HELD = 0.8, 0.08  # share of the commanded velocity that a held robot lacks; least such velocity [m/s]


class SmoothCommand(NamedTuple):
    """A command whose velocities and posture never jump, with the rates of the posture."""

    gait: Gait  # gait as commanded
    velocity: np.ndarray  # v_x and v_y, heading frame [m/s], shape (2,)
    omega: float  # yaw rate [rad/s]
    f: float  # stride frequency [Hz]
    # swing apex above the ground [m]
    l: float  # noqa: E741  the paper's symbol
    posed: bool  # whether h and p have almost arrived: leaps wait for that, since they change them slowly
    # h, p, w: pelvis height above nominal [m], pelvis pitch [rad] and waist angle [rad]
    h: float
    p: float
    w: float
    # h_rate, p_rate, w_rate: their rates [m/s], [rad/s], [rad/s]
    h_rate: float
    p_rate: float
    w_rate: float


class GaitState(NamedTuple):
    """The gait state, which decides how much of a command can be followed now."""

    # whether the robot steps or has not yet settled, whatever the command; meanwhile the limits of walking hold
    stepping: bool = False
    # gait that the robot is still in. Before it changes to the commanded gait it comes to rest in this one, at the
    # frequency and within the limits of this one
    running: Gait = Gait.STANDING
    waiting: bool = False  # whether the robot is not ready to travel yet
    stray: float = 0.0  # by how much the robot is faster along the heading than commanded, as after a push [m/s]
    fastest: float = math.inf  # largest speed that the ground allows [m/s]


_STILL = GaitState()


class CommandFilter:
    """Limits the rates of commands, so that a jump does not topple the robot."""

    def __init__(self, params: ControllerParams, robot: Robot) -> None:
        self._params, self._robot = params, robot
        self._limits = (params.height_rate, params.pitch_rate, params.waist_rate)
        self._leap_limits = tuple(
            (height_rate, params.leap_pitch_rate, params.waist_rate)
            for height_rate in (params.jump_height_rate, params.hop_height_rate)
        )
        # Gaps to h and p that are left when these move as slowly as in a hop (the straight line in `approach`).
        slow, usual = self._leap_limits[1], self._limits
        self._close = tuple(slow[axis][0] * 0.5 * usual[axis][0] / usual[axis][1] for axis in range(2))
        self.reset(0.0, 0.0, 0.0)

    def reset(self, h: float, p: float, w: float) -> None:
        """Start at rest from a posture: pelvis height [m], pelvis pitch [rad], waist angle [rad]."""
        self._given: Command | None = None
        self._velocity = (0.0, 0.0, 0.0)
        self._frequency: float | None = None
        self._posture = [h, p, w]
        self._asked_posture = h, p, w  # commanded before the gait changes
        self._rate = [0.0, 0.0, 0.0]
        self._arrived: GaitState | None = None  # gait state for which the last result has stopped changing

    def update(self, command: Command, dt: float, legs: GaitState = _STILL) -> SmoothCommand:
        """Return the command to follow now, `dt` [s] after the last call."""
        # Most ticks repeat the last command after everything has arrived: their result is kept.
        if command is not self._given:
            self._given = command
        elif self._arrived == legs:
            return self._result
        before = self._state
        self._result = self._advance(command, dt, legs)
        self._arrived = legs if self._state == before else None
        return self._result

    @property
    def _state(self) -> tuple[object, ...]:
        return self._velocity, self._frequency, *self._posture, *self._rate

    def _advance(self, command: Command, dt: float, legs: GaitState) -> SmoothCommand:
        """Advance by one tick towards a command."""
        gait = command.gait
        params = self._params
        changing = legs.running not in (Gait.STANDING, gait)
        limiting = legs.running if changing else gait
        wanted = (0.0, 0.0, 0.0) if changing or legs.waiting else (command.v_x, command.v_y, command.omega)
        if len(limiting.feet) == 2:
            fastest = fastest_walk(params, command.f, self._robot)
            fastest *= params.jump_speed if limiting.flight else 1.0
            wanted = (min(max(wanted[0], -fastest), fastest), *wanted[1:])
        if limiting.hops:
            # The hip cannot swing the leg far enough across for more.
            outwards = 1.0 if limiting.feet == (0,) else -1.0
            wanted = (wanted[0], outwards * max(outwards * wanted[1], -params.hop_inward_speed), wanted[2])
        speed = math.hypot(wanted[0], wanted[1])
        if speed > legs.fastest:  # on slippery ground
            share = legs.fastest / speed
            wanted = (share * wanted[0], share * wanted[1], share * wanted[2])
        # On three numbers, floats are several times faster than arrays.
        (ahead_rate, side_rate, turn_rate), (speed, aside, turn) = params.velocity_rate, self._velocity
        speed = _towards(speed, wanted[0], ahead_rate * dt)
        aside = _towards(aside, wanted[1], (params.hop_side_rate if limiting.hops else side_rate) * dt)
        turn = _towards(turn, wanted[2], turn_rate * dt)
        self._velocity = speed, aside, turn
        self._frequency = command.f if self._frequency is None else self._frequency
        if not changing or gait is Gait.STANDING:
            self._frequency = _towards(self._frequency, command.f, params.frequency_rate * dt)

        # A posture that changes in the last leap would turn the body in the air.
        if not changing or not limiting.flight:
            self._asked_posture = command.h, command.p, command.w
        h, pitch, waist = self._asked_posture
        if legs.stepping or gait is not Gait.STANDING:
            h = self._stepping_height(h, speed, self._frequency, limiting, legs.stray)
        leaping = legs.running.flight and not legs.waiting
        posed = abs(h - self._posture[0]) <= self._close[0] and abs(pitch - self._posture[1]) <= self._close[1]
        rates = self._leap_limits[limiting.hops] if leaping else self._limits
        for axis, (target, limits) in enumerate(zip((h, pitch, waist), rates, strict=True)):
            self._posture[axis], self._rate[axis] = approach(self._posture[axis], self._rate[axis], target, limits, dt)
        height = self._posture[0]
        if limiting.flight:
            apex = highest_leap_clearance(params, height, self._frequency, self._robot)
        else:
            apex = highest_clearance(params, height, self._frequency, speed, self._robot)
        apex = min(command.l, apex)
        velocity = np.array([speed, aside])
        return SmoothCommand(gait, velocity, turn, self._frequency, apex, posed, *self._posture, *self._rate)

    def _stepping_height(self, h: float, speed: float, f: float, gait: Gait, stray: float) -> float:
        """Return the height that is used while the legs move [m].

        Args:
            h: height as commanded [m].
            speed: commanded speed along the heading [m/s].
            f: stride frequency [Hz].
            gait: gait whose limits hold.
            stray: by how much the robot is faster than that speed [m/s].
        """
        params = self._params
        lowering = params.speed_lowering * max(abs(speed) - params.lowering_from, 0.0)
        # A pushed robot could not brake in a squat, so the height also suits the speed that it actually has.
        lowest = max(
            lowest_walking_height(params, each, 0.5 / f, self._posture[1], self._robot)
            for each in (speed, speed + stray)
        )
        if not gait.flight:
            return max(h, lowest) - lowering  # at this speed the trailing leg would be too short
        highest = highest_leaping_height(params, self._robot)
        if gait.hops:
            h, highest = h - lowering, min(highest, -params.hop_lowering)  # a leg that leans is shorter
        else:  # both legs lean backwards at the take-off
            highest -= min(params.speed_lowering * abs(speed), params.hop_lowering)
        lowest = max(lowest, lowest_leaping_height(params, f, 1 if gait.hops else 2))
        travel = min(math.hypot(*self._velocity) / params.leap_squat_speed, 1.0)
        least = -params.hop_lowering if gait.hops else -params.jump_lowering
        lowest += travel * max(least - lowest, 0.0)
        return min(max(h, lowest), highest)  # where a fast leap has no room between them, straight legs are worse


class VelocityTrim:
    """Integral correction of the velocity plan, once per step.

    The pelvis sways within a step, so the error is averaged over two steps before it is integrated. A step during which
    the command changes does not count: the robot lags then, and a correction would overshoot. Small changes, as of a
    command given by hand or one that steers by the robot's position, do not count as a change: such a command never
    rests. Nor does the correction grow while something holds the robot or pushes it back: once free, it would run past
    its goal.

    Attributes:
        value: correction of v_x and v_y, heading frame [m/s], shape (2,).
    """

    def __init__(self, params: ControllerParams) -> None:
        self._params = params
        self.reset()

    def reset(self) -> None:
        """Drop the correction."""
        self.value = np.zeros(2)
        self._previous: np.ndarray | None = None
        self._wanted: list[float] | None = None
        self._before: list[float] | None = None  # command when the step began
        self._settling = 0
        self._clear()

    def _clear(self) -> None:
        self._sum = [0.0, 0.0]
        self._time = 0.0
        self._changed = False

    def measure(self, velocity: np.ndarray, wanted: np.ndarray, dt: float) -> None:
        """Record one tick.

        Args:
            velocity: measured velocity of the pelvis, heading frame [m/s], shape (2,).
            wanted: commanded velocity, heading frame [m/s], shape (2,).
            dt: duration of the tick [s].
        """
        asked = wanted.tolist()
        before = self._before = self._before or asked
        for axis, actual in enumerate(velocity.tolist()):
            self._sum[axis] += (asked[axis] - actual) * dt
            self._changed |= abs(asked[axis] - before[axis]) > self._params.velocity_integral_change
        self._wanted = asked
        self._time += dt

    def end_step(self, *, leap: bool = False) -> None:
        """Correct by the mean error of the last two steps, or leaps; a leap counts as the two steps that it lasts."""
        if self._time <= 0.0:
            return
        self._before = self._wanted
        # A larger error is a push or a start: stepping deals with it, and the integral must not wind up.
        ignored = _SETTLING_LEAPS if leap else _SETTLING_STEPS
        self._settling = ignored if self._changed else max(self._settling - 1, 0)
        error = np.array(self._sum) / self._time
        if self._settling:
            self._previous = None
            self._clear()
            return
        if self._previous is not None:
            bound = self._params.velocity_integral_bound
            both = np.clip([error, self._previous], -bound, bound)
            step = self._params.velocity_integral * (2 if leap else 1) * 0.5 * both.sum(axis=0)
            wanted, lack = np.array(self._wanted), 0.5 * (error + self._previous)
            held = wanted @ wanted > _SLOWEST_HELD**2 and (lack - _HELD * wanted) @ wanted > 0.0
            most = np.abs(self.value) if held else self._params.max_velocity_trim
            self.value = np.clip(self.value + step, -most, most)
        self._previous = error
        self._clear()


def approach(value: float, rate: float, target: float, limits: tuple[float, float], dt: float) -> tuple[float, float]:
    """Return a value and its rate a tick of `dt` [s] nearer to a target; `limits` bound its rate and acceleration."""
    fastest, quickest = limits
    gap, change = target - value, quickest * dt
    if abs(gap) <= change * dt and abs(gap / dt - rate) <= change:  # it arrives in this tick, and can stop in the next
        return target, gap / dt
    # As fast as still allows to stop at the target: the smaller of a braking parabola and a straight line, since near
    # the target the parabola is too steep to be followed in discrete time.
    speed = min(math.sqrt(quickest * abs(gap)), abs(gap) * 2.0 * quickest / fastest, fastest)
    rate += min(max(math.copysign(speed, gap) - rate, -change), change)
    return value + rate * dt, rate


def _towards(value: float, target: float, step: float) -> float:
    """Return the value after a step of bounded size towards a target."""
    return value + min(max(target - value, -step), step)

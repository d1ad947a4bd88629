"""Hand targets that stand still between two messages, as a smooth motion from one message to the next."""

import dataclasses
import math

import numpy as np

from hugwbc.targets import HandTargets

LONGEST = 0.25  # [s] between two messages of a stream; targets that stay for longer are steps, and meant
QUIET = 1.0  # [s] without a message, after which what comes next may be a path that is not held
AHEAD = 0.05  # [s], at most, for which a hand moves on when a message is late
FASTEST = (1.5, 4.5)  # [m/s, rad/s] of hands and joints; targets that move faster jump
_STEPS = 4  # uneven steps in a row that tell a stream; of numbered messages, which no path has, one
_IN_LINE = 0.9  # least cosine between two steps along a path; noise turns at random
_UNEVEN = 1.4  # ratio of two steps that a smooth motion does not make up and down again
_BASE = 0.06  # [s], over which a velocity is measured
_GAIN = 0.1  # share of a message in the running averages of its stream
_MOST_SPREAD = 0.03  # [s]
_MOST_LOST = 1.2  # mean number of messages between two arrivals that is still a loss
_MOST_MISSED = 100  # messages in a row; the count may also begin anew, or be any number
_FIRST = 8  # messages from which the period is learned before a loss is looked for
_VECTORS = ("left", "right", "left_direction", "right_direction", "joints")


class HeldTargets:
    """Interpolation between the messages of a stream of targets, whatever they come by.

    Messages at 10 to 72 Hz reach a control loop as targets that stand still and then step. A stream is told by its
    steps, not by where it comes from: steps in one line, with pauses of up to `LONGEST` between them, or, where the
    rate is near the loop's, by turns short and long. Other targets pass at once and unchanged: a path that moves in
    every tick, noise, a step after a pause, a jump.

    Each message gets a time at which the hands shall be there: one message period, one tick and twice the usual spread
    of the arrivals later. These times are evenly spaced, however uneven the arrivals are. A cubic leads there from the
    present position and velocity, so that the velocity never steps. When the next message is late, the hands move on
    for up to `AHEAD`, stop, and return to the last one.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the stream."""
        self._shape: tuple[object, ...] = ()

    def follow(self, hands: HandTargets, dt: float) -> HandTargets:
        """Return the targets of this tick.

        Args:
            hands: the newest targets, usable (`HandTargets.is_usable`).
            dt: time since the last tick [s].
        """
        given = [name for name in _VECTORS if getattr(hands, name) is not None]
        if not given or not 0.0 < dt < math.inf:
            return hands
        point = np.concatenate([getattr(hands, name) for name in given], dtype=float)
        if self._shape != (hands.frame, *given):
            self._begin(point, hands, dt)
            self._shape = (hands.frame, *given)
            return hands
        self._now += dt
        numbered = hands.sequence is not None
        if hands.sequence != self._sequence if numbered else bool((point != self._point).any()):
            self._arrive(point, hands, dt)
        elif self._now - self._arrival > QUIET:
            self._held = False
        if not self._held:
            self._place(point)
            return hands
        self._q, self._dq = self._played()
        parts = np.split(self._q, np.cumsum([getattr(hands, name).size for name in given])[:-1])
        moved = {name: _unit(part) if "direction" in name else part for name, part in zip(given, parts, strict=True)}
        if hands.joints is not None:
            moved["joint_velocity"] = self._dq[-8:]
        # Without its stamp: unlike the messages', its differences are those of a motion.
        return dataclasses.replace(hands, stamp=None, **moved)

    def _begin(self, point: np.ndarray, hands: HandTargets, dt: float) -> None:
        self._now = self._arrival = self._uneven_at = 0.0
        self._point, self._sequence = point, hands.sequence
        self._step = np.zeros_like(point)
        self._count = self._uneven = self._trend = 0
        self._period, self._spread, self._held = dt, 0.0, False
        self._interval, self._gap = dt, 1.0  # means of the time and the number of messages between two arrivals
        self._place(point)
        self._past = [(0.0, point)]  # when the hands shall be where

    def _place(self, point: np.ndarray) -> None:
        """Be at a point, at rest."""
        self._q, self._dq = point, np.zeros_like(point)
        self._plan = (self._now, self._q, self._dq, self._now, point, self._dq)

    def _arrive(self, point: np.ndarray, hands: HandTargets, dt: float) -> None:
        """Take the target of a new message: look whether it is one of a stream, and plan the motion to it if so."""
        interval, step = self._now - self._arrival, point - self._point
        self._look(interval, step, hands, dt)
        due, delay = self._past[-1][0], self._period + dt + 2.0 * self._spread
        messages = 1
        if hands.sequence is not None and self._sequence is not None:
            messages = hands.sequence - self._sequence
        elif self._gap > _MOST_LOST:  # the rate has fallen
            self._count = 0
        elif self._count >= _FIRST:
            messages = round((self._now + delay - due) / self._period)
        messages = min(max(messages, 1), _MOST_MISSED)
        self._arrival, self._sequence, self._point, self._step = self._now, hands.sequence, point, step
        if interval <= LONGEST:
            self._count += 1
            share = max(_GAIN, 1.0 / self._count)
            self._interval += share * (interval - self._interval)
            self._gap += share * (messages - self._gap)
            self._period = self._interval / self._gap
        if self._held:
            self._aim(point, due + messages * self._period, self._now + delay, hands, dt)
        else:
            self._past = [(self._now + delay, point)]

    def _aim(self, point: np.ndarray, even: float, soon: float, hands: HandTargets, dt: float) -> None:
        """Plan the motion to a point: there at an even distance in time from the last one, if about as `soon`."""
        off = soon - even
        if abs(off) > soon - self._now:  # the stream has just begun, has paused or lost messages
            even, off = soon, 0.0
        due = max(even + _GAIN * off, self._now + 0.5 * dt)
        self._spread += 0.5 * _GAIN * (min(abs(off), _MOST_SPREAD) - self._spread)
        by_joints = hands.joints is not None
        gap = np.abs(point - self._q)[slice(-8, None) if by_joints else slice(3 * int(hands.given.sum()))]
        if gap.max(initial=0.0) > FASTEST[by_joints] * (due - self._now + dt):
            self._place(point)
            self._past = [(due, point)]
            return
        base = max(_BASE, 1.01 * (due - self._past[-1][0]))
        self._past = [past for past in self._past if past[0] >= due - base] or self._past[-1:]
        begin, start = self._past[0]
        self._past.append((due, point))
        self._plan = (self._now - dt, self._q, self._dq, due, point, (point - start) / (due - begin))

    def _look(self, interval: float, step: np.ndarray, hands: HandTargets, dt: float) -> None:
        """Judge by a step whether the targets are those of a stream."""
        size, before = math.sqrt(step @ step), math.sqrt(self._step @ self._step)
        if interval > LONGEST or float(step @ self._step) <= _IN_LINE * size * before:
            return
        trend = int(size > _UNEVEN * before) - int(before > _UNEVEN * size)
        if interval > 1.5 * dt or trend * self._trend < 0:
            again = self._now - self._uneven_at <= LONGEST
            self._uneven, self._uneven_at = self._uneven + 1 if again else 1, self._now
            self._held = self._held or self._uneven >= (_STEPS if hands.sequence is None else 1)
        self._trend = trend or self._trend

    def _played(self) -> tuple[np.ndarray, np.ndarray]:
        """Return where the hands shall be now, and their velocity."""
        begin, start, speed, due, point, velocity = self._plan
        if self._now < due:
            return _cubic(self._now, begin, start, speed, due, point, velocity)
        ahead = min(AHEAD, self._period)
        farther, stop = point + velocity * ahead, due + ahead + max(2.0 * self._period, 2.0 * AHEAD)
        if self._now <= due + ahead:
            return point + velocity * (self._now - due), velocity
        if self._now < stop:
            return _cubic(self._now, due + ahead, farther, velocity, stop, point, np.zeros_like(point))
        return point, np.zeros_like(point)


def _cubic(
    now: float, begin: float, start: np.ndarray, speed: np.ndarray, end: float, goal: np.ndarray, velocity: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return position and velocity on the cubic between two points with given velocities (Hermite's interpolation)."""
    length = end - begin
    share, way = (now - begin) / length, goal - start
    second, third = 3.0 * way - length * (2.0 * speed + velocity), length * (speed + velocity) - 2.0 * way
    place = start + share * (length * speed + share * (second + share * third))
    return place, speed + share * (2.0 * second + 3.0 * share * third) / length


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / max(float(np.linalg.norm(vector)), 1e-9)

"""Hand targets that stand still between two messages, as a smooth motion from one message to the next."""

import dataclasses
import math

import numpy as np

from hugwbc.targets import ORIENTATIONS, HandTargets

LONGEST = 0.25  # [s] between two messages of a stream; targets that stay for longer are steps, and meant
QUIET = 1.0  # [s] without a message, after which what comes next may be a path that is not held
AHEAD = 0.05  # [s], at most, for which a hand moves on when a message is late
FASTEST = (1.5, 4.5)  # [m/s, rad/s] of hands and joints; targets that move faster jump
_STEPS = 4  # uneven steps in a row that tell a stream; of numbered messages, which no path has, one
_IN_LINE = 0.9  # least cosine between two steps along a path; noise turns at random
_UNEVEN = 1.4  # ratio of two steps that a smooth motion does not make up and down again
_BASE = 0.06  # [s], over which a velocity is measured
_GAIN = 0.1  # share of a message in the running averages of its stream
_MOST = 100  # largest difference of the numbers of two messages that counts; a count may also begin anew
_UNIT = ("left_direction", "right_direction", *ORIENTATIONS)
_VECTORS = ("left", "right", *_UNIT, "joints")


class HeldTargets:
    """Interpolation between the messages of a stream of targets, however they arrive.

    A stream is recognised by its steps: they lie in one line, with pauses of up to `LONGEST` between them, or are short
    and long by turns where its rate is near the control loop's. A path that moves in every tick, noise, a step after a
    pause and a jump pass at once and unchanged. Each message gets a time at which the hands shall be there, evenly
    spaced however uneven the arrivals are: one message period, one tick and twice the usual unevenness later. A cubic
    leads there from the present position and velocity. When the next message is late, the hands move on for up to
    `AHEAD` and return.
    """

    def __init__(self) -> None:
        self._shape: tuple[object, ...] = ()

    def follow(self, hands: HandTargets, dt: float) -> HandTargets:
        """Return the targets of a tick `dt` [s] after the last one, from the newest, usable targets."""
        given = [name for name in _VECTORS if getattr(hands, name) is not None]
        if not given or not 0.0 < dt < math.inf:
            return hands
        vectors = [getattr(hands, name) for name in given]
        level = [name for name in given if name in ORIENTATIONS and not getattr(hands, name).any()]  # no quaternion
        shape = (hands.frame, *given, *level)
        begins = self._shape != shape
        if not begins:  # of the two quaternions of an orientation, the nearer one leads there
            rows = zip(given, vectors, self._vectors, strict=True)
            vectors = [-x if name in ORIENTATIONS and x @ last < 0.0 else x for name, x, last in rows]
        self._vectors, point = vectors, np.concatenate(vectors, dtype=float)
        if begins:
            self._shape = shape
            self._begin(point, hands, dt)
        self._now += dt
        moved = bool((point != self._point).any())
        if moved if hands.sequence is None else hands.sequence != self._sequence:
            self._arrive(point, hands, dt)
        elif self._now - self._arrival > QUIET:
            self._held = False
        if not self._held:
            self._place(point)
            return hands
        self._q, self._dq = self._played()
        parts = np.split(self._q, np.cumsum([getattr(hands, name).size for name in given])[:-1])
        new = {n: x / max(math.sqrt(x @ x), 1e-9) if n in _UNIT else x for n, x in zip(given, parts, strict=True)}
        if hands.joints is not None:
            new["joint_velocity"] = self._dq[-hands.joints.size :]
        # Without its stamp: unlike the messages', its differences are those of a motion.
        return dataclasses.replace(hands, stamp=None, **new)

    def _begin(self, point: np.ndarray, hands: HandTargets, dt: float) -> None:
        self._now = self._arrival = self._uneven_at = 0.0
        self._point, self._step, self._sequence = point, np.zeros_like(point), hands.sequence
        self._count = self._uneven = self._trend = 0
        self._interval, self._gap = dt, 1.0  # means of the time and the number of messages between two arrivals
        self._unevenness, self._held = 0.0, False  # mean distance of arrivals from even ones [s]
        self._place(point)

    def _place(self, point: np.ndarray) -> None:
        """Be at a point, at rest."""
        self._q, self._dq = point, np.zeros_like(point)
        self._knots = [(self._now, point, self._dq)]  # times, positions and velocities of the plan
        self._past = [(self._now, point)]  # when the hands should have been where

    def _arrive(self, point: np.ndarray, hands: HandTargets, dt: float) -> None:
        """Take the target of a new message: look whether it is one of a stream, and plan the motion to it if so."""
        interval, step, messages = self._now - self._arrival, point - self._point, 1
        self._look(interval, step, hands, dt)
        if hands.sequence is not None and self._sequence is not None:
            messages = min(max(hands.sequence - self._sequence, 1), _MOST)
        self._arrival, self._sequence, self._point, self._step = self._now, hands.sequence, point, step
        if interval <= LONGEST:
            self._count += 1
            share = max(_GAIN, 1.0 / self._count)
            self._interval += share * (interval - self._interval)
            self._gap += share * (messages - self._gap)
        if not self._held:
            return
        period = self._interval / self._gap
        delay, last = period + dt + 2.0 * self._unevenness, self._past[-1][0]
        off = self._now + delay - last - messages * period
        late = min(abs(off), delay)
        self._unevenness += 0.5 * _GAIN * (late - self._unevenness) * (late < delay)
        # The stream has just begun, has paused or lost messages: count anew.
        due = self._now + delay - (off * (1.0 - _GAIN) if abs(off) <= delay else 0.0)
        due = max(due, self._now + 0.6 * max(period, dt))
        by_joints = hands.joints is not None
        moved = slice(3 * int(hands.given.sum())) if hands.joints is None else slice(-hands.joints.size, None)
        leap = np.abs(point - self._q)[moved]
        if leap.max(initial=0.0) > FASTEST[by_joints] * (due - self._now + dt):
            self._place(point)
            return
        # What was planned before a count anew may lie beyond it: unless shifted, it would turn the velocity round.
        beyond = max(last + 0.6 * messages * period - due, 0.0)
        self._past, last = [(when - beyond, where) for when, where in self._past], last - beyond
        base = max(_BASE, 1.01 * (due - last))
        self._past = [past for past in self._past if past[0] >= due - base] or self._past[-1:]
        velocity = (point - self._past[0][1]) / (due - self._past[0][0])
        self._past.append((due, point))
        ahead, rest = min(AHEAD, period), max(2.0 * period, 2.0 * AHEAD)
        self._knots = [
            (self._now - dt, self._q, self._dq),
            (due, point, velocity),
            (due + ahead, point + velocity * ahead, velocity),
            (due + ahead + rest, point, np.zeros_like(point)),
        ]

    def _look(self, interval: float, step: np.ndarray, hands: HandTargets, dt: float) -> None:
        """Judge by a step whether the targets are those of a stream."""
        size, before = math.sqrt(step @ step), math.sqrt(self._step @ self._step)
        if interval > LONGEST or float(step @ self._step) <= _IN_LINE * size * before:
            return
        trend = int(size > _UNEVEN * before) - int(before > _UNEVEN * size)
        if interval > 1.5 * dt or trend * self._trend < 0:
            self._uneven = self._uneven + 1 if self._now - self._uneven_at <= LONGEST else 1
            self._uneven_at = self._now
            self._held = self._held or self._uneven >= (_STEPS if hands.sequence is None else 1)
        self._trend = trend or self._trend

    def _played(self) -> tuple[np.ndarray, np.ndarray]:
        """Return position and velocity of the plan now, by Hermite's interpolation."""
        after = next((index for index, knot in enumerate(self._knots) if self._now < knot[0]), 0)
        if not after:
            return self._knots[-1][1:]
        (begin, start, speed), (end, goal, velocity) = self._knots[after - 1 : after + 1]
        length, way = end - begin, goal - start
        share = (self._now - begin) / length
        second, third = 3.0 * way - length * (2.0 * speed + velocity), length * (speed + velocity) - 2.0 * way
        place = start + share * (length * speed + share * (second + share * third))
        return place, speed + share * (2.0 * second + 3.0 * share * third) / length

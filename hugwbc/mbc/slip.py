"""Slipping soles: how much friction the ground still has, and how fast a robot may walk on it."""

import math
from collections.abc import Sequence

import numpy as np

_FILTER = 0.02  # [s], time constant of the soles' speeds: a sole that touches down slides for less than that
_SHARE = 0.5  # most of it that one reading makes: with a period as long as that slide, no single one is a slip
_SLIPS = 0.45  # [m/s], filtered speed of a sole under load that does not occur on good ground
_SLIDES = 0.5  # [m/s], filtered speed that it does not reach once enough less friction is assumed
_LOADED = 0.1718  # share of the weight, least force on a foot that tells of the ground
_GRIP = 0.4  # horizontal over vertical force of a sole that slides on good ground, as after a push, at least
_BETWEEN = 0.3  # [s] between two reductions, about a step: a slip goes on until the other foot stands
_AT_ONCE = 0.05  # [s], the same for a sole that slides
_REDUCTION = 0.3  # factor on the friction that is assumed, for each slip
_LEAST = 0.1  # friction that is always assumed
_RECOVERY = 0.01  # [1/s], rise of the friction that is assumed while nothing slips
_PATIENCE, _TRUST = 5.0, 10.0  # [s] without a slip, after which it rises as many times as fast: it may be good ground
_BELOW = 0.8  # share of the friction with which a sole slipped again, up to which it does
_SPEED = 2.5  # [m/s] allowed for each unit of friction on slippery ground


class SlipWatch:
    """Assumes less friction as soon as a loaded sole moves, and slowly more again.

    A walk on good ground uses the friction of the soles to turn and to brake, so less is assumed only where it is less.

    Attributes:
        friction: coefficient that the contact forces may use.
        fastest: largest speed that suits it [m/s]; infinite where nothing has slipped.
    """

    def __init__(self, friction: float, weight: float) -> None:
        """Begin with the coefficient of good ground and the weight of the robot [N]."""
        self._good, self._loaded = friction, _LOADED * weight
        self.reset()

    def reset(self) -> None:
        """Assume good ground."""
        self.friction, self.fastest = self._good, math.inf
        self._filtered = [(0.0, 0.0, 0.0)] * 2  # by foot: speed [m/s], horizontal and vertical force [N]
        self._since = _BETWEEN  # the last reduction [s]
        self._trusted = self._good  # friction up to which it rises fast

    def update(self, velocities: Sequence[np.ndarray], forces: np.ndarray, dt: float) -> None:
        """Take both soles' velocities [m/s], shape (2 or more,) each, and the forces on them [N], shape (2, 3)."""
        slips, share = 0.0, min(dt / _FILTER, _SHARE)
        for foot, (x, y, z) in enumerate(forces.tolist()):  # of so few numbers, floats are faster than arrays
            slow, aside, down = 0.0, 0.0, 0.0
            if z > self._loaded:
                slow, aside, down = math.hypot(*velocities[foot][:2].tolist()), math.hypot(x, y), z
            speed, sideways, load = self._filtered[foot]
            speed += share * (slow - speed)
            sideways += share * (aside - sideways)
            load += share * (down - load)
            self._filtered[foot] = speed, sideways, load
            if sideways < _GRIP * load:
                slips = max(slips, speed)
        self._since += dt
        if slips > _SLIPS and self._since > (_AT_ONCE if slips > _SLIDES else _BETWEEN):
            if self.friction < self._good:
                self._trusted = _BELOW * self.friction
            self.friction, self._since = max(_REDUCTION * self.friction, _LEAST), 0.0
        elif slips <= _SLIPS:
            fast = self._since > _PATIENCE and self.friction < self._trusted
            self.friction = min(self.friction + (_TRUST if fast else 1.0) * _RECOVERY * dt, self._good)
        self.fastest = math.inf if self.friction == self._good else _SPEED * self.friction

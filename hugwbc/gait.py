"""Gaits: phases of both feet, clock signals, expected contact and the quintic swing profile.

A foot stands in the first half of its cycle and swings in the second. With a stance of half a cycle, the paper's
homogenised phase (bar phi) is the phase itself.

Functions of arrays take NumPy arrays or torch tensors and return the same kind, so that the training environment, the
`qp` controller and the evaluation share one definition. The last axis of the phases of feet is (left, right).
"""

import enum
import functools
import math
import operator

import numpy as np

from hugwbc.errors import UnknownNameError
from hugwbc.numeric import Array, minimum_jerk, namespace, number
from hugwbc.state import GRAVITY

COMMAND_NAMES = ("v_x", "v_y", "omega", "f", "l", "h", "p", "w")
# Standard deviation of the switching intervals of the expected contact, in units of the phase.
CONTACT_SIGMA = 0.05
STANDING_PHASE = 0.25  # middle of stance: expected contact 1, clock +1
FLYING_PHASE = 0.75  # middle of swing: expected contact 0, clock -1
DEFAULT_DUTY = 0.5
_BOUNCING = (1.0, 10.0)  # [Hz], range of the frequencies of `bounce`, so that any number gives a finite path


class Gait(enum.IntEnum):
    """The paper's gaits, with hopping split by the leg that hops; each has a number and the properties below.

    Attributes:
        feet: which feet step, 0 for the left and 1 for the right one; the other leg of a hop is held up.
        offset: by how much the left foot's phase is ahead of the right one's [cycles].
        flight: whether the robot leaves the ground in each cycle.
        travels: whether velocities may be commanded.
        hops: whether one leg hops while the other is held up.
        alternates: whether the feet swing in turn.
    """

    feet: tuple[int, ...]
    offset: float
    flight: bool
    travels: bool
    hops: bool
    alternates: bool

    STANDING = 0, (), 0.0, False, False
    WALKING = 1, (0, 1), 0.5
    JUMPING = 2, (0, 1), 0.0, True
    HOPPING_LEFT = 3, (0,), 0.0, True
    HOPPING_RIGHT = 4, (1,), 0.0, True

    def __new__(
        cls, number: int, feet: tuple[int, ...] = (), offset: float = 0.0, flight: bool = False, travels: bool = True
    ) -> "Gait":
        """Make a gait of a row."""
        gait = int.__new__(cls, number)
        gait._value_ = number
        gait.feet, gait.offset, gait.flight, gait.travels = feet, offset, flight, travels
        gait.hops, gait.alternates = len(feet) == 1, offset != 0.0
        return gait

    @property
    def label(self) -> str:
        """Lower-case name, as on the command line."""
        return self.name.lower()

    @classmethod
    def parse(cls, label: object) -> "Gait":
        """Return the gait with a label, or with a number as a data set stores it."""
        try:
            return cls[label.upper()] if isinstance(label, str) else cls(number(label))  # type: ignore[arg-type]
        except (KeyError, ValueError):
            raise UnknownNameError("gait", label, [gait.label for gait in cls]) from None

    def mirrored(self) -> "Gait":
        """Return the gait seen in a mirror, whose common phase is ahead by `offset`; a hop changes legs."""
        image = tuple(sorted(1 - foot for foot in self.feet)), -self.offset % 1.0, self.flight, self.travels
        rows = ((gait, (gait.feet, gait.offset, gait.flight, gait.travels)) for gait in (self, *Gait))
        return next((gait for gait, row in rows if row == image), self)


# Numbers of the gaits for the functions of arrays below.
_OFFSETS = {int(gait): gait.offset for gait in Gait if gait.offset}
_HOPS, _FLIGHTS = [int(gait) for gait in Gait if gait.hops], [int(gait) for gait in Gait if gait.flight]
_HOLDING = [[int(gait) for gait in Gait if gait.hops and foot not in gait.feet] for foot in range(2)]


def hopping(gait: Array) -> Array:
    """Return whether values of `Gait` are hops on either leg, same shape, bool."""
    return _any_of(gait, _HOPS)


def flies(gait: Array) -> Array:
    """Return whether values of `Gait` are jumps or hops, which have a flight, same shape, bool."""
    return _any_of(gait, _FLIGHTS)


def held(gait: Array) -> Array:
    """Return whether values of `Gait`, shape (...), hold up the left and the right leg, shape (..., 2), bool."""
    return namespace(gait).stack([_any_of(gait, those) for those in _HOLDING], -1)


def _any_of(gait: Array, those: list[int]) -> Array:
    return functools.reduce(operator.or_, [gait == one for one in those])


def _normal_cdf(x: Array) -> Array:
    xp = namespace(x)
    if xp is np:
        return 0.5 * (1.0 + _erf(np.asarray(x) / math.sqrt(2.0)))
    return xp.special.ndtr(x)


_erf = np.vectorize(math.erf, otypes=[float])


def advance_phase(phase: Array, frequency: Array, dt: float) -> Array:
    """Return the common phase after `dt` seconds: (phi + f dt) mod 1 (the paper's phase equation, with the modulo)."""
    return (phase + frequency * dt) % 1.0


def foot_phases(phase: Array, gait: Array) -> Array:
    """Return the phases of the left and right foot.

    This is the paper's phase equation with the constants of its gait section: both feet at 0.25 when standing, the
    held leg at 0.75 when hopping, an offset between the feet of psi = 0.5 when walking and 0 when jumping. The offset
    is added to the left foot, so that a walk that starts at phase 0 begins with the left foot in swing.

    Args:
        phase: common phase in [0, 1), shape (...).
        gait: values of `Gait`, same shape.

    Returns:
        Phases in [0, 1), shape (..., 2).
    """
    xp = namespace(phase)
    phase = np.asarray(phase, dtype=float) if xp is np else phase
    gait = np.asarray(gait) if xp is np else gait
    offset = xp.zeros_like(phase)
    for one, ahead in _OFFSETS.items():
        offset = xp.where(gait == one, ahead, offset)
    standing, feet = gait == Gait.STANDING.value, ((phase + offset) % 1.0, phase)
    moving = [xp.where(_any_of(gait, those), FLYING_PHASE, mine) for those, mine in zip(_HOLDING, feet, strict=True)]
    return xp.stack([xp.where(standing, STANDING_PHASE, mine) for mine in moving], -1)


def clock(phase: Array) -> Array:
    """Return the clock signals of feet at their phases, sin(2 pi phi), positive in stance (the paper's Cl_L, Cl_R)."""
    return namespace(phase).sin(2.0 * math.pi * phase)


def expected_contact(phase: Array) -> Array:
    """Return the expected contact probability C of a foot at its phase (the paper's equation of C), in [0, 1]."""

    def cdf(offset: float) -> Array:
        return _normal_cdf((phase - offset) / CONTACT_SIGMA)

    return cdf(0.0) * (1.0 - cdf(0.5)) + cdf(1.0) * (1.0 - cdf(1.5))


def swing_height(phase: Array, height: Array) -> Array:
    """Return the target sole clearance of a foot [m]: zero in stance, a piecewise quintic through the apex in swing.

    The height is l s(u), with u = (phi - 0.5) / 0.25 in the rise, u = (1 - phi) / 0.25 in the fall, and
    s(u) = 10 u^3 - 15 u^4 + 6 u^5. Velocity and acceleration vanish at lift-off, apex and touch-down. This corrects
    the paper's appendix: its printed coefficients miss its own boundary conditions (signs of the u^4 and u^3 terms in
    the rise; sign and constant in the fall). Its boundary conditions are right and give the form used here.

    Args:
        phase: phase of a foot in [0, 1].
        height: commanded apex l [m].
    """
    xp = namespace(phase)
    u = xp.clip(xp.where(phase < 0.75, phase - 0.5, 1.0 - phase) / 0.25, 0.0, 1.0)
    return xp.where(phase < 0.5, 0.0, height * minimum_jerk(u))


def bounce(phase: Array, gait: Array, frequency: Array) -> tuple[Array, Array]:
    """Return height [m] and speed [m/s] of the vertical path of a body that flies in the swing half of the cycle.

    In flight the path is a free fall; in stance, with constant force, it is the same parabola upside down. Both last
    half a cycle, so that the height is zero on average, at touch-down and at lift-off. Without a flight both are zero.

    Args:
        phase: common phase in [0, 1), shape (n,).
        gait: values of `Gait`, shape (n,).
        frequency: commanded f [Hz], shape (n,).

    Returns:
        Height and speed, each of shape (n,).
    """
    flying, u = phase >= DEFAULT_DUTY, (phase % 0.5) / 0.5
    sign = flies(gait) * (2.0 * flying - 1.0)
    duration = 0.5 / namespace(frequency).clip(frequency, *_BOUNCING)
    speed = 0.5 * GRAVITY * duration  # at lift-off
    return sign * speed * duration * u * (1.0 - u), sign * speed * (1.0 - 2.0 * u)

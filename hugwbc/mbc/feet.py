"""Feet and the ground that they find: soles, loads, a plane through the last stances, and slips."""

import collections
import math
from collections.abc import Sequence

import numpy as np

from hugwbc.mbc.dynamics import Dynamics, pitch_of
from hugwbc.mbc.qp import CONTACT_POINTS
from hugwbc.mbc.reach import toe_down
from hugwbc.robot import SIDES, Robot

SOLES = tuple(f"{side}_sole" for side in SIDES)
"""Frames at the centres of the soles."""
_ENDS = tuple(tuple(CONTACT_POINTS[2 * foot : 2 * foot + 2]) for foot in range(len(SIDES)))  # heel and toe of each foot
# Share of the weight at which a foot has found the ground. Loads that are inferred from joint torques are noisy: those
# of a swinging foot stay below 50 N in 99 % of the time. A foot that is believed to stand too early hangs in the air.
_TOUCHING = 0.25
_CARRYING = 0.0344  # share of the weight below which a foot that should stand is not on the ground
_LOADED = 0.1718  # share of the weight from which on the motion of a sole tells of the ground
_RESTING_RATE = 0.5  # [rad/s], below which a loaded sole lies on heel and toe
_SLOPE_TIME = 0.02  # [s], time constant with which the slope of a resting sole is taken for the ground's
_STANCES = 6  # number of stances that the plane is fitted to
_STIFFNESS = 0.03  # [m^2], ridge towards level: variance of uneven ground over that of a gradient

_SPEED_TIME = 0.02  # [s], time constant of the soles' speeds: a sole that touches down slides for less than that
_SHARE = 0.5  # largest share of one reading in that filter: even with long periods, a single reading makes no slip
_SLIPS = 0.45  # [m/s], filtered speed of a sole under load that does not occur on good ground
_SLIDES = 0.5  # [m/s], filtered speed that a sole does not reach once the assumed friction is low enough
_GRIP = 0.4  # least ratio of horizontal to vertical force of a sole that slides on good ground, as after a push
_BETWEEN = 0.3  # [s] between two reductions, about a step: a slip goes on until the other foot stands
_AT_ONCE = 0.05  # [s], the same for a sole faster than `_SLIDES`
_REDUCTION = 0.3  # factor on the assumed friction at each slip
_LEAST = 0.1  # least assumed friction
_RECOVERY = 0.01  # [1/s], rise of the assumed friction while nothing slips
_PATIENCE, _TRUST = 5.0, 10.0  # [s] without a slip, and the factor on the rise thereafter: the ground may be good again
_BELOW = 0.8  # share of the friction with which a sole slipped again, up to which the rise is that fast
_SPEED = 2.5  # [m/s], largest speed per unit of friction on slippery ground


def pivot(dynamics: Dynamics, foot: int, balance: float) -> np.ndarray:
    """Return the nominal centre of pressure of a standing foot in the world [m], shape (3,).

    Args:
        dynamics: robot model at the current state.
        foot: 0 for left, 1 for right.
        balance: distance of the centre of pressure ahead of the ankle [m].
    """
    sole = dynamics.frame(SOLES[foot])
    x, y = sole.rotation[:2, 0].tolist()
    ahead = (balance - dynamics.robot.sole_ahead) / max(math.hypot(x, y), 1e-6)
    return sole.position + np.array([ahead * x, ahead * y, 0.0])


def sole_about(pivot: np.ndarray, yaw: float, balance: float, robot: Robot) -> np.ndarray:
    """Return where to put a sole's centre so that its nominal centre of pressure is at a given place.

    Args:
        pivot: desired place of the centre of pressure, world x and y [m], shape (2,).
        yaw: heading of the foot [rad].
        balance: distance of the centre of pressure ahead of the ankle [m].
        robot: gives the place of the sole's centre ahead of the ankle.

    Returns:
        Centre of the sole, world x and y [m], shape (2,).
    """
    ahead = robot.sole_ahead - balance
    return pivot + np.array([ahead * math.cos(yaw), ahead * math.sin(yaw)])


def hop_edge(robot: Robot) -> float:
    """Return how far outwards of its sole's centre line the foot of a hop stands [m].

    The leg leans inwards, and the sole with it, onto its outer edge. An ankle that rolls keeps the sole level.
    """
    return 0.0 if "ankle_roll" in robot.pairs else float(robot.sole_y[1])


def end_heights(dynamics: Dynamics, foot: int) -> list[float]:
    """Return the heights of heel and toe in the world [m]."""
    return [float(dynamics.point(end)[2]) for end in _ENDS[foot]]


def sole_height(dynamics: Dynamics, foot: int) -> float:
    """Return the height of the sole's centre in the world [m]."""
    return float(dynamics.frame(SOLES[foot]).position[2])


def feet_yaw(dynamics: Dynamics) -> float:
    """Return the mean heading of the two feet [rad]."""
    # The sum of the two forward axes points along the mean heading, also where the angles wrap.
    left, right = (dynamics.frame(sole).rotation for sole in SOLES)
    return math.atan2(left[1, 0] + right[1, 0], left[0, 0] + right[0, 0])


def swing_pitch(dynamics: Dynamics, foot: int, to_heading: np.ndarray, slope: float = 0.0) -> float:
    """Return the pitch of a lifted sole [rad]: that of the ground, as far as the shank's lean and the ankle allow.

    Args:
        dynamics: robot model at the current state.
        foot: 0 for left, 1 for right.
        to_heading: rotation from world x and y into the heading frame, shape (2, 2).
        slope: slope of the ground along the foot, positive with the toe down [rad].
    """
    shank = dynamics.robot.moved["knee"][foot]
    rate = float(to_heading[1].dot(dynamics.velocity(shank)[3:5]))
    return toe_down(pitch_of(dynamics.rotation(shank)), rate, slope, dynamics.robot)


class Ground:
    """The ground as the feet find it. It counts as level where the state has no foot forces.

    Attributes:
        gradient: dz/dx and dz/dy of the plane through the last stances, world axes, shape (2,).
        slopes: slope of the ground along the left and the right foot, positive with the toe down [rad], shape (2,).
        resting: whether the left and the right foot lie still under load, shape (2,), bool. Heel and toe of a resting
            foot both carry, whatever the slope.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all stances and assume level ground."""
        self.gradient = np.zeros(2)
        self.slopes = np.zeros(2)
        self.resting = np.zeros(2, dtype=bool)
        self._stances: collections.deque[np.ndarray] = collections.deque(maxlen=_STANCES)

    def update(self, dynamics: Dynamics, contact: np.ndarray, yaw: float, dt: float) -> None:
        """Follow the soles for one tick.

        Args:
            dynamics: robot model at the current state.
            contact: whether the left and the right foot should stand, shape (2,), bool.
            yaw: heading of the robot [rad].
            dt: time since the last call [s].
        """
        for foot, name in enumerate(SOLES):
            load = dynamics.load(foot)
            if load is None or not contact[foot]:
                self.resting[foot], self.slopes[foot] = False, self.slope_along(yaw)
                continue
            sole = dynamics.frame(name)
            rate = float(sole.rotation[:, 1].dot(sole.velocity[3:]))
            # Only a sole that is loaded and does not rotate has both ends down, so that its pitch is the ground's.
            rests = load > _LOADED * dynamics.robot.weight and abs(rate) < _RESTING_RATE
            self.resting[foot] = rests
            if rests:
                self.slopes[foot] += (pitch_of(sole.rotation) - self.slopes[foot]) * min(dt / _SLOPE_TIME, 1.0)

    def touched(self, dynamics: Dynamics, foot: int) -> bool | None:
        """Return whether a swinging foot has come down; None where the state has no foot forces."""
        load = dynamics.load(foot)
        return None if load is None else load > _TOUCHING * dynamics.robot.weight

    def carries(self, dynamics: Dynamics, foot: int) -> bool | None:
        """Return whether a foot that should stand carries load; None where the state has no foot forces."""
        load = dynamics.load(foot)
        return None if load is None else load > _CARRYING * dynamics.robot.weight

    def note(self, dynamics: Dynamics, foot: int) -> None:
        """Add the current stance of a foot to the plane, if the foot rests.

        The gradient minimises the squared vertical distances of all heels and toes from the plane through their mean,
        with a ridge towards level: a few stances on uneven ground must not look like a hill.
        """
        if not self.resting[foot]:
            return
        self._stances.append(np.array([dynamics.point(end) for end in _ENDS[foot]]))
        points = np.concatenate(self._stances)
        points = points - points.mean(axis=0)
        across = points[:, :2]
        self.gradient = np.linalg.solve(across.T @ across + _STIFFNESS * np.eye(2), across.T @ points[:, 2])

    def shift(self, offset: np.ndarray) -> None:
        """Move the remembered stances after the estimate of the position jumped by `offset` [m], shape (3,)."""
        for points in self._stances:
            points += offset

    def rise(self, start: np.ndarray, end: np.ndarray) -> float:
        """Return the rise of the plane from one point to another [m]; only their world x and y count."""
        return float(self.gradient.dot(end[:2] - start[:2]))

    def slope_along(self, yaw: float) -> float:
        """Return the slope of the plane along a heading, downhill positive [rad]."""
        x, y = self.gradient.tolist()
        return -math.atan(x * math.cos(yaw) + y * math.sin(yaw))


class SlipWatch:
    """Assumes less friction as soon as a loaded sole slides, and slowly more again.

    A walk on good ground uses the friction of the soles to turn and to brake, so less is assumed only after a slip.

    Attributes:
        friction: coefficient that the contact forces may use.
        fastest: largest speed that suits it [m/s]; infinite while the coefficient is that of good ground.
    """

    def __init__(self, friction: float, weight: float) -> None:
        """Begin with the coefficient of good ground and the weight of the robot [N]."""
        self._good, self._loaded = friction, _LOADED * weight
        self.reset()

    def reset(self) -> None:
        """Assume good ground."""
        self.friction, self.fastest = self._good, math.inf
        self._filtered = [(0.0, 0.0, 0.0)] * 2  # by foot: speed [m/s], horizontal and vertical force [N]
        self._since = _BETWEEN  # [s] since the last reduction
        self._trusted = self._good  # friction up to which it rises fast

    def update(self, velocities: Sequence[np.ndarray], forces: np.ndarray, dt: float) -> None:
        """Take both soles' velocities [m/s], (2 or more,) each, and the forces on them [N], (2, 3), of a tick [s]."""
        slips, share = 0.0, min(dt / _SPEED_TIME, _SHARE)
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

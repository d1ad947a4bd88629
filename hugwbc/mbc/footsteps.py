r"""Where and when to step: placement by the divergent component of motion, timing under disturbances.

The robot is a linear inverted pendulum about its stance foot. The divergent component :math:`\xi = c + \dot c / \omega`
moves away from the centre of pressure as :math:`e^{\omega t}` and takes the centre of mass along (capture point: Pratt
et al., Humanoids 2006; divergent component of motion: Englsberger, Ott and Albu-Schaeffer, IEEE T-RO 2015). A walk is
stable if every step brings it back to where the periodic gait has it.
"""

import cmath
import math
from typing import NamedTuple

import numpy as np

from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.swing import SwingTrajectory
from hugwbc.state import GRAVITY

_LOWEST = 0.5  # of the leg, least height of the centre of mass above the foot, so that a fall does not divide by zero
_CHOICES = 4  # number of shorter durations of a step to choose from, and of longer ones
_PEAK = 5.77  # peak acceleration of a quintic from rest to rest over a distance of 1 in a time of 1: 10 / sqrt(3)
_SHORTEST = 0.06  # [s], shortest remaining time of a step that is retimed; a foot needs that to come down


class Pendulum(NamedTuple):
    """The robot as a linear inverted pendulum about the stance foot."""

    pivot: np.ndarray  # nominal centre of pressure in the world [m], shape (2,)
    # centre of mass in the world, shifted by forces on the hands (`Dynamics.hand_shift`) [m], shape (2,)
    com: np.ndarray
    omega: float  # natural frequency sqrt(g / height) [1/s]
    dcm: np.ndarray  # divergent component of motion in the world [m], shape (2,)

    @classmethod
    def about(cls, pivot: np.ndarray, dynamics: Dynamics, gradient: np.ndarray | None = None) -> "Pendulum":
        r"""Return the pendulum about a point on the ground.

        The velocity is not that of the centre of mass but the one that carries the measured angular momentum about the
        pivot (Gong and Grizzle, arXiv 2008.10763, 2020), :math:`L = k + (c - p) \times m \dot c`,
        :math:`\dot c_{eff} = (L_y, -L_x) / (m (c_z - p_z))`, which leg swing and trunk motion disturb far less. Then
        :math:`\xi = c + \dot c_{eff} / \omega`.

        On a slope the centre of mass moves in a plane parallel to the ground. Its height above the ground below it
        takes the place of that above the pivot, and the horizontal motion is that on level ground (Kajita et al., the
        3D linear inverted pendulum mode, IROS 2001).

        Args:
            pivot: point in the world [m], shape (3,).
            dynamics: robot model at the current state.
            gradient: slope of the ground, dz/dx and dz/dy, shape (2,); None for level ground.
        """
        x, y, z = (dynamics.com - pivot).tolist()
        along_x, along_y = (0.0, 0.0) if gradient is None else gradient.tolist()
        height = max(z - along_x * x - along_y * y, _LOWEST * dynamics.robot.leg_length)
        omega = math.sqrt(GRAVITY / height)
        vx, vy, vz = dynamics.com_velocity.tolist()
        spin_x, spin_y, _ = dynamics.momentum.tolist()
        # Angular momentum about the pivot per mass.
        about_x = spin_x / dynamics.mass + y * vz - z * vy
        about_y = spin_y / dynamics.mass + z * vx - x * vz
        lead = np.array([about_y / (height * omega), -about_x / (height * omega)])
        com = dynamics.com[:2] + dynamics.hand_shift(pivot)
        return cls(pivot[:2], com, omega, com + lead)

    def com_after(self, cop: np.ndarray, time: float) -> np.ndarray:
        """Return the centre of mass after a time [s] over a fixed centre of pressure, both in the world [m], (2,)."""
        # About the centre of pressure, c + c' / omega grows as e^{omega t} and c - c' / omega decays as e^{-omega t}.
        growth = math.exp(self.omega * time)
        diverged = (self.dcm - cop) * growth
        return cop + 0.5 * (diverged + (2.0 * self.com - self.dcm - cop) / growth)


def nominal_offset(
    velocity: complex, yaw_rate: float, step_time: float, omega: float, width: float, side: int
) -> complex:
    r"""Return the divergent component relative to the stance foot at the start of a step of the periodic gait.

    Travel: each step goes :math:`s = R(\psi / 2) v T (1 + \dot\psi^2 / \omega^2)` while the heading turns by
    :math:`\psi = \dot\psi T`. This is periodic if :math:`s + R(\psi) b = e^{\omega T} b`. The last factor belongs to a
    body that leans in by its centripetal acceleration over :math:`\omega^2`, so that its feet run on a larger circle
    than its centre of mass. Width: the feet alternate at a distance of `width`,
    :math:`b_y = \mp W / (1 + e^{\omega T})`. Vectors in the plane are complex numbers: R(psi) is e^{i psi}.

    Args:
        velocity: velocity of the robot, heading frame [m/s].
        yaw_rate: turning rate of the heading [rad/s].
        step_time: duration T of a step [s].
        omega: natural frequency of the pendulum [1/s].
        width: distance W between the centre lines of the feet [m].
        side: stance foot, 0 for left, 1 for right.

    Returns:
        Offset b in the heading frame of the stance foot [m].
    """
    growth = math.exp(omega * step_time)
    turn = cmath.exp(1j * yaw_rate * step_time)
    half_turn = cmath.exp(0.5j * yaw_rate * step_time)
    lean = 1.0 + (yaw_rate / omega) ** 2
    step = half_turn * velocity * step_time * lean
    towards_other = -1j if side == 0 else 1j
    return step / (growth - turn) + towards_other * width / (1.0 + growth)


class StepRequest(NamedTuple):
    """A step to plan: where the robot is and the gait that the step belongs to."""

    pendulum: Pendulum  # robot as a pendulum about the stance foot
    velocity: np.ndarray  # planned velocity, heading frame [m/s], shape (2,)
    yaw_rate: float  # planned turning rate [rad/s]
    heading: float  # heading of the robot now [rad]
    pivot_ahead: float  # distance of the pendulum's pivot ahead of the stance ankle [m]
    swing: int  # foot in the air, 0 for left, 1 for right
    step_time: float  # nominal duration T of the step [s]
    cop_reach: float  # largest distance of the centre of pressure from the ankle along the foot [m]


class StepPlan(NamedTuple):
    """Where to step, and the centre of pressure until then."""

    foothold: np.ndarray  # place of the swing foot's pivot, world [m], shape (2,)
    cop: np.ndarray  # centre of pressure of the stance foot, world [m], shape (2,)
    # from the nearest foothold within reach to the wanted one, heading frame of the landing [m]; zeros if the wanted
    # one is within reach
    missed: tuple[float, float]


def plan_step(params: ControllerParams, request: StepRequest, remaining: float) -> StepPlan:
    r"""Return the foothold that leads back to the periodic gait, and the centre of pressure until touch-down.

    .. math:: u = p_{cop} + (\xi - p_{cop})\, e^{\omega t_{rem}} - b^*

    with b* of `nominal_offset`. Laterally a line-shaped foot has no authority, so that the step is the only control.
    Sagittally the centre of pressure moves as well, within what the ankle torque allows.
    """
    pendulum, yaw_rate, swing = request.pendulum, request.yaw_rate, request.swing
    heading, pivot_ahead, step_time = request.heading, request.pivot_ahead, request.step_time
    # Vectors in the plane are complex numbers, seen from the pivot.
    speed, dcm = complex(*request.velocity.tolist()), complex(*(pendulum.dcm - pendulum.pivot).tolist())
    forward, landing = cmath.exp(1j * heading), cmath.exp(1j * (heading + yaw_rate * remaining))
    # A sideways walk closes its feet every other step: a wider stance keeps them apart then.
    width = max(params.step_width, params.min_foot_distance + abs(speed.imag) * step_time)
    # Sagittal feedback: compare the divergent component with where it should be now, so as to end this step as the
    # periodic gait would. Along the heading the periodic gait's offset is the same on both feet.
    offset = nominal_offset(speed, yaw_rate, step_time, pendulum.omega, width, swing)
    reference = offset.real * math.exp(pendulum.omega * (step_time - remaining))
    deviation = (dcm / forward).real - reference
    shift = params.cop_gain * deviation
    cop = (_clip(pivot_ahead + shift, -request.cop_reach, request.cop_reach) - pivot_ahead) * forward

    # The divergent component moves away from the centre of pressure as e^{omega t}.
    wanted = (cop + (dcm - cop) * math.exp(pendulum.omega * remaining)) / landing - offset
    # Reach is a box in the heading frame of the landing; the feet must neither cross nor spread too far.
    outward = 1.0 if swing == 0 else -1.0
    x = _clip(wanted.real, *params.max_step)
    y = outward * _clip(outward * wanted.imag, params.min_foot_distance, params.max_foot_distance)
    step = landing * complex(x, y)
    return StepPlan(
        pendulum.pivot + np.array([step.real, step.imag]),
        pendulum.pivot + np.array([cop.real, cop.imag]),
        (wanted.real - x, wanted.imag - y),
    )


def time_step(
    params: ControllerParams,
    request: StepRequest,
    step: StepPlan,
    swing: SwingTrajectory,
    elapsed: float,
    remaining: float,
) -> tuple[float, StepPlan]:
    r"""Return the remaining time with which the robot comes closest to its gait, and the step that goes with it.

    The divergent component :math:`\xi` of a pushed robot may leave the places from which the next stance foot can catch
    it: that foot comes no closer to the other one, no further away and no faster than the legs allow. The distance that
    it misses by depends on when it lands, since :math:`\xi` grows as :math:`e^{\omega t}`. As in Khadiv et al. (Walking
    control based on step timing adaptation, IEEE T-RO 2020) and Griffin et al. (Walking stabilization using step timing
    and location adjustment, IROS 2017), the duration d of the step is a second control in addition to its place:

    .. math:: \min_d \; \max(|e(d)| - e_0, 0)^2 + w\,(d / T - 1)^2 , \quad 1 / (1 + a) \le d / T \le 1 / (1 - a)

    with e the sideways distance between the wanted foothold and the nearest one within reach, plus the distance that
    the swing foot falls short of that one. As long as the foothold is within reach sideways, d = T.

    Args:
        params: a, e_0, w and the acceleration of a swing.
        request: step to plan.
        step: its plan for `remaining`.
        swing: trajectory of the foot in the air.
        elapsed: time since the step began [s].
        remaining: time to its end, as decided before [s].
    """
    share, step_time = params.step_timing, request.step_time
    if remaining < _SHORTEST:
        return remaining, step
    changed = abs(elapsed + remaining - step_time) > 1e-9
    if not changed and abs(step.missed[1]) <= params.step_timing_tolerance:
        return remaining, step
    # A few fixed durations, counted from the beginning of the step: a continuous minimum would flutter between ticks.
    lowest, best = math.inf, (remaining, step)
    for choice in range(-_CHOICES, _CHOICES + 1):
        pace = 1.0 - share * choice / _CHOICES
        left = step_time / pace - elapsed
        if left < _SHORTEST:
            continue
        plan = plan_step(params, request, left)
        missed = abs(plan.missed[1]) + _short(params, plan, swing, left)
        excess = max(missed - params.step_timing_tolerance, 0.0)
        cost = excess**2 + params.step_timing_weight * (1.0 / pace - 1.0) ** 2
        if cost < lowest:
            lowest, best = cost, (left, plan)
    return best


def _short(params: ControllerParams, step: StepPlan, swing: SwingTrajectory, left: float) -> float:
    """Return the distance from the foothold at which a swing foot ends at its largest acceleration [m].

    A quintic from rest to rest over a distance D in a time t accelerates by at most 5.77 D / t^2. The speed that the
    foot already has takes it half as far as it would without braking.
    """
    x, y = (step.foothold - swing.position[:2] - 0.5 * left * swing.velocity[:2]).tolist()
    return max(math.hypot(x, y) - params.swing_acceleration * left**2 / _PEAK, 0.0)


def _clip(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)

"""Where to step: placement by the divergent component of motion, with the velocity of the angular-momentum pendulum."""

import cmath
import math
from typing import NamedTuple

import numpy as np

from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.params import ControllerParams
from hugwbc.state import GRAVITY

_LOWEST = 0.4  # [m], of the centre of mass above the foot, so that a fall does not divide by zero


class Pendulum(NamedTuple):
    """The robot as a linear inverted pendulum about the stance foot.

    Attributes:
        pivot: nominal centre of pressure in the world [m], shape (2,).
        com: centre of mass in the world [m], shape (2,).
        omega: sqrt(g / height) [1/s].
        dcm: divergent component of motion in the world [m], shape (2,).
    """

    pivot: np.ndarray
    com: np.ndarray
    omega: float
    dcm: np.ndarray

    @classmethod
    def about(cls, pivot: np.ndarray, dynamics: Dynamics, gradient: np.ndarray | None = None) -> "Pendulum":
        r"""The pendulum about a point on the ground, world [m], shape (3,).

        On a slope, with dz/dx and dz/dy of shape (2,), the centre of mass moves in a plane parallel to the ground, and
        its height above the ground below it takes the place of that above the pivot: then the horizontal motion is
        that of level ground (Kajita et al., the 3D linear inverted pendulum mode, IROS 2001).

        Its velocity is the one that carries the measured angular momentum about the pivot (Gong and Grizzle 2020),
        :math:`L = k + (c - p) \times m \dot c`, :math:`\dot c_{eff} = (L_y, -L_x) / (m (c_z - p_z))`, which leg swing
        and trunk motion disturb far less than the velocity of the centre of mass;
        :math:`\xi = c + \dot c_{eff} / \omega`.
        """
        x, y, z = (dynamics.com - pivot).tolist()
        along_x, along_y = (0.0, 0.0) if gradient is None else gradient.tolist()
        height = max(z - along_x * x - along_y * y, _LOWEST)
        omega = math.sqrt(GRAVITY / height)
        vx, vy, vz = dynamics.com_velocity.tolist()
        spin_x, spin_y, _ = dynamics.momentum.tolist()
        about_x = spin_x / dynamics.mass + y * vz - z * vy
        about_y = spin_y / dynamics.mass + z * vx - x * vz
        lead = np.array([about_y / (height * omega), -about_x / (height * omega)])
        return cls(pivot[:2], dynamics.com[:2], omega, dynamics.com[:2] + lead)

    def com_after(self, cop: np.ndarray, time: float) -> np.ndarray:
        """Centre of mass after a time [s] over a centre of pressure, both in the world [m], shape (2,)."""
        growth = math.exp(self.omega * time)
        diverged = (self.dcm - cop) * growth
        return cop + 0.5 * (diverged + (2.0 * self.com - self.dcm - cop) / growth)


def nominal_offset(
    velocity: np.ndarray, yaw_rate: float, step_time: float, omega: float, width: float, side: int
) -> np.ndarray:
    r"""Divergent component relative to the stance foot at the start of a step of the periodic gait [m], shape (2,).

    Forward part: a step of :math:`s = R(\psi / 2) v T (1 + \dot\psi^2 / \omega^2)` per step while the heading turns by
    psi = yaw_rate T, periodic when :math:`s + R(\psi) b = e^{\omega T} b`. The last factor is that of a body that leans
    in by its centripetal acceleration over omega^2: its feet run on a larger circle than its centre of mass.
    Lateral part: feet `width` apart, alternating, :math:`b_y = \mp W / (1 + e^{\omega T})`. In the heading frame of
    the stance foot.

    Args:
        velocity: of the robot, heading frame [m/s], shape (2,).
        yaw_rate: [rad/s].
        step_time: T [s].
        omega: of the pendulum [1/s].
        width: distance between the feet's centre lines [m].
        side: the stance foot, 0 left or 1 right.
    """
    offset = _nominal_offset(complex(*velocity.tolist()), yaw_rate, step_time, omega, width, side)
    return np.array([offset.real, offset.imag])


def _nominal_offset(
    velocity: complex, yaw_rate: float, step_time: float, omega: float, width: float, side: int
) -> complex:
    """`nominal_offset` with vectors in the plane as complex numbers: R(psi) is e^{i psi}."""
    growth = math.exp(omega * step_time)
    turn = cmath.exp(1j * yaw_rate * step_time)
    half_turn = cmath.exp(0.5j * yaw_rate * step_time)
    # In a turn the body leans in by a / omega^2: the feet run on a larger circle than the centre of mass.
    lean = 1.0 + (yaw_rate / omega) ** 2
    step = half_turn * velocity * step_time * lean
    towards_other = -1j if side == 0 else 1j
    return step / (growth - turn) + towards_other * width / (1.0 + growth)


class StepPlan(NamedTuple):
    """What the planner decides at one tick.

    Attributes:
        foothold: of the swing foot's pivot, world [m], shape (2,).
        cop: centre of pressure of the stance foot, world [m], shape (2,).
        missed: from the foothold within reach to the wanted one, forward and left of the foot [m]; 0 if they are one.
    """

    foothold: np.ndarray
    cop: np.ndarray
    missed: tuple[float, float]


def plan_step(
    params: ControllerParams,
    pendulum: Pendulum,
    velocity: np.ndarray,
    yaw_rate: float,
    heading: float,
    pivot_ahead: float,
    swing: int,
    step_time: float,
    remaining: float,
) -> StepPlan:
    """The foothold that leads to the commanded periodic gait, and the centre of pressure until then.

    Laterally a single line-shaped foot has no authority: the step is the control. Sagittally the centre of pressure
    also moves, within what the ankle torque allows.

    Args:
        params: limits and gains.
        pendulum: about the stance foot.
        velocity: planned velocity, heading frame [m/s], shape (2,).
        yaw_rate: [rad/s].
        heading: of the robot now [rad].
        pivot_ahead: of the pendulum's pivot from the stance ankle [m].
        swing: the foot in the air, 0 left or 1 right.
        step_time: duration of the step [s].
        remaining: until its end [s].
    """
    # Vectors in the plane as complex numbers, from the pivot.
    speed, dcm = complex(*velocity.tolist()), complex(*(pendulum.dcm - pendulum.pivot).tolist())
    forward, landing = cmath.exp(1j * heading), cmath.exp(1j * (heading + yaw_rate * remaining))
    width = max(params.step_width, params.min_foot_distance + abs(speed.imag) * step_time)
    # Sagittal feedback: where the divergent component should be now, to end this step as the periodic gait would.
    # Along the heading the periodic gait's offset is the same on both feet.
    offset = _nominal_offset(speed, yaw_rate, step_time, pendulum.omega, width, swing)
    reference = offset.real * math.exp(pendulum.omega * (step_time - remaining))
    deviation = (dcm / forward).real - reference
    shift = params.cop_gain * deviation
    cop = (_clip(pivot_ahead + shift, -params.cop_reach, params.cop_reach) - pivot_ahead) * forward

    # The divergent component moves away from the centre of pressure as e^{omega t}.
    wanted = (cop + (dcm - cop) * math.exp(pendulum.omega * remaining)) / landing - offset
    outward = 1.0 if swing == 0 else -1.0
    x = _clip(wanted.real, *params.max_step)
    y = outward * _clip(outward * wanted.imag, params.min_foot_distance, params.max_foot_distance)
    step = landing * complex(x, y)
    return StepPlan(
        pendulum.pivot + np.array([step.real, step.imag]),
        pendulum.pivot + np.array([cop.real, cop.imag]),
        (wanted.real - x, wanted.imag - y),
    )


def _clip(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)

"""Where to step: placement by the divergent component of motion, with the velocity of the angular-momentum pendulum."""

import cmath
import dataclasses
import math

import numpy as np

from hugwbc import rotations
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.params import ControllerParams
from hugwbc.state import GRAVITY

_LOWEST = 0.4  # [m], of the centre of mass above the foot, so that a fall does not divide by zero


@dataclasses.dataclass(frozen=True, eq=False)
class Pendulum:
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
    def about(cls, pivot: np.ndarray, dynamics: Dynamics) -> "Pendulum":
        r"""The pendulum about a point on the ground, world [m], shape (3,).

        Its velocity is the one that carries the measured angular momentum about the pivot (Gong and Grizzle 2020),
        :math:`L = k + (c - p) \times m \dot c`, :math:`\dot c_{eff} = (L_y, -L_x) / (m (c_z - p_z))`, which leg swing
        and trunk motion disturb far less than the velocity of the centre of mass;
        :math:`\xi = c + \dot c_{eff} / \omega`.
        """
        x, y, z = (dynamics.com - pivot).tolist()
        height = max(z, _LOWEST)
        omega = math.sqrt(GRAVITY / height)
        vx, vy, vz = (dynamics.mass * dynamics.com_velocity).tolist()
        spin_x, spin_y, _ = dynamics.momentum.tolist()
        about_x = spin_x + y * vz - z * vy
        about_y = spin_y + z * vx - x * vz
        lead = np.array([about_y, -about_x]) / (dynamics.mass * height * omega)
        return cls(pivot[:2].copy(), dynamics.com[:2].copy(), omega, dynamics.com[:2] + lead)

    def dcm_after(self, cop: np.ndarray, duration: float) -> np.ndarray:
        r"""The divergent component after a time with the centre of pressure at a point: p + (xi - p) e^{omega t}."""
        return cop + (self.dcm - cop) * math.exp(self.omega * duration)


def nominal_offset(
    velocity: np.ndarray, yaw_rate: float, step_time: float, omega: float, width: float, side: int
) -> np.ndarray:
    r"""Divergent component relative to the stance foot at the start of a step of the periodic gait [m], shape (2,).

    Forward part: a step of s = R(psi/2) v T per step while the heading turns by psi = yaw_rate T, periodic when
    :math:`s + R(\psi) b = e^{\omega T} b`. Lateral part: feet `width` apart, alternating,
    :math:`b_y = \mp W / (1 + e^{\omega T})`. In the heading frame of the stance foot.

    Args:
        velocity: of the robot, heading frame [m/s], shape (2,).
        yaw_rate: [rad/s].
        step_time: T [s].
        omega: of the pendulum [1/s].
        width: distance between the feet's centre lines [m].
        side: the stance foot, 0 left or 1 right.
    """
    growth = math.exp(omega * step_time)
    # Vectors in the plane as complex numbers: R(psi) is e^{i psi}.
    turn = cmath.exp(1j * yaw_rate * step_time)
    half_turn = cmath.exp(0.5j * yaw_rate * step_time)
    # In a turn the body leans in by a / omega^2: the feet run on a larger circle than the centre of mass.
    lean = 1.0 + (yaw_rate / omega) ** 2
    step = half_turn * complex(*velocity) * step_time * lean
    forward = step / (growth - turn)
    towards_other = -1.0 if side == 0 else 1.0
    return np.array([forward.real, forward.imag + towards_other * width / (1.0 + growth)])


@dataclasses.dataclass(frozen=True, eq=False)
class StepPlan:
    """What the planner decides at one tick.

    Attributes:
        foothold: of the swing foot's pivot, world [m], shape (2,).
        cop: centre of pressure of the stance foot, world [m], shape (2,).
        clipped: whether the foothold was out of reach.
    """

    foothold: np.ndarray
    cop: np.ndarray
    clipped: bool


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
    from_heading = rotations.rotation_z(heading)[:2, :2]
    width = max(params.step_width, params.min_foot_distance + abs(velocity[1]) * step_time)
    # Sagittal feedback: where the divergent component should be now, had this step begun on the periodic gait.
    begun = nominal_offset(velocity, yaw_rate, step_time, pendulum.omega, width, 1 - swing)
    reference = begun[0] * math.exp(pendulum.omega * (step_time - remaining))
    deviation = from_heading[:, 0] @ (pendulum.dcm - pendulum.pivot) - reference
    shift = params.cop_gain * deviation
    shift = _clip(float(pivot_ahead + shift), -params.cop_reach, params.cop_reach) - pivot_ahead
    cop = pendulum.pivot + shift * from_heading[:, 0]

    landing = rotations.rotation_z(heading + yaw_rate * remaining)[:2, :2]
    offset = nominal_offset(velocity, yaw_rate, step_time, pendulum.omega, width, swing)
    wanted = landing.T @ (pendulum.dcm_after(cop, remaining) - pendulum.pivot) - offset
    outward = 1.0 if swing == 0 else -1.0
    ahead, aside = wanted.tolist()
    x = _clip(ahead, *params.max_step)
    y = outward * _clip(outward * aside, params.min_foot_distance, params.max_foot_distance)
    return StepPlan(pendulum.pivot + landing @ np.array([x, y]), cop, x != ahead or y != aside)


def _clip(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)

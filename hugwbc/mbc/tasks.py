r"""Tasks of the whole-body QP: what each part of the robot should do next.

A task turns a target into rows of a least-squares cost over the generalised acceleration :math:`\dot v`. With the task
velocity :math:`J v`, its rate is :math:`J \dot v + \dot J v`; the task asks for :math:`a^*` and the QP minimises
:math:`\sum_i \| J_i \dot v + \dot J_i v - a_i^* \|^2_{W_i}`.

The tasks multiply by `dot`: on matrices this small it takes less than half the time of `@`.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin

from hugwbc import rotations
from hugwbc.kinematics import in_place
from hugwbc.mbc.dynamics import Dynamics, pitch_of
from hugwbc.mbc.params import ControllerParams
from hugwbc.robot import Robot

_WORLD_ROWS = np.eye(6)


class TaskTerms(NamedTuple):
    """Rows of a least-squares cost: sum of weight * (jacobian dv/dt + drift - acceleration)^2."""

    jacobian: np.ndarray  # task velocity per generalised velocity, shape (k, nv)
    drift: np.ndarray  # rate of the task velocity at dv/dt = 0, shape (k,)
    acceleration: np.ndarray  # desired rate of the task velocity, shape (k,)
    weight: np.ndarray  # cost per squared acceleration error, shape (k,)


class Task(Protocol):
    """A quantity that the controller drives to a target."""

    def evaluate(self, dynamics: Dynamics) -> TaskTerms:
        """Return the rows at the state that `dynamics` was last updated with."""
        ...


# --- centre of mass and angular momentum


class CentreOfMassTask:
    r"""Horizontal position of the centre of mass, along and across the heading.

    .. math:: \ddot c^* = \ddot c_{ff} + k_p (c_d - c) + k_d (0 - \dot c)

    When the robot stands, both axes are pulled to the target. When it shifts its weight for a first step or hop, the
    axis across the heading follows the linear inverted pendulum, :math:`\ddot c_{ff} = \omega^2 (c - p_{cop})` with
    :math:`k_p = k_d = 0`.

    Attributes:
        target: c_d in the world [m], shape (2,).
        heading: direction of the first row [rad].
        feedforward: acceleration of the plan in the heading frame [m/s^2], shape (2,).
        servo: 1 for an axis that is pulled to the target, 0 for one that only follows the feed-forward, shape (2,).
    """

    def __init__(self, params: ControllerParams) -> None:
        self.target = np.zeros(2)
        self.heading = 0.0
        self.feedforward = np.zeros(2)
        self.servo = np.ones(2)
        self._weight = np.full(2, params.com_weight)
        self._gains = params.com_gains

    def evaluate(self, dynamics: Dynamics) -> TaskTerms:
        """Return two rows: along the heading and to its left."""
        to_heading = rotations.rotation_z(-self.heading)[:2, :2]
        kp, kd = self._gains
        error = to_heading.dot(self.target - dynamics.com[:2])
        servo = kp * error - kd * to_heading.dot(dynamics.com_velocity[:2])
        return TaskTerms(
            to_heading.dot(dynamics.com_jacobian[:2]),
            to_heading.dot(dynamics.com_drift[:2]),
            self.feedforward + self.servo * servo,
            self._weight,
        )


class CentreOfMassMotionTask:
    r"""Acceleration of the centre of mass in all three directions, from a force plan.

    .. math:: \ddot c^* = \ddot c_{ff}

    in world axes. There is no feedback here: it is in the force plan, which starts from the measured state and is
    solved many times during a stance.
    """

    def __init__(self, params: ControllerParams) -> None:
        self.feedforward = np.zeros(3)  # planned acceleration, world axes [m/s^2], shape (3,)
        self._weight = np.array(params.motion_weight)

    def evaluate(self, dynamics: Dynamics) -> TaskTerms:
        """Return three rows: along the world's x, y and z."""
        return TaskTerms(dynamics.com_jacobian, dynamics.com_drift, self.feedforward, self._weight)


class AngularMomentumTask:
    r"""Angular momentum about the centre of mass: damped, or driven by a force plan.

    .. math:: \dot k^* = \dot k_{ff} - k_d\, k, \qquad k = A_G(q)\, v

    in world axes [kg m^2/s]. Without a plan :math:`\dot k_{ff} = 0`; with a plan :math:`k_d = 0`.
    """

    def __init__(self, params: ControllerParams) -> None:
        self.planned: np.ndarray | None = None  # dot k_ff, world axes [N m], shape (3,); None without a plan
        self._weight = np.array(params.momentum_weight)
        self._planned_weight = np.array(params.planned_momentum_weight)
        self._damping = params.momentum_damping

    def evaluate(self, dynamics: Dynamics) -> TaskTerms:
        """Return three rows: about the world's x, y and z."""
        return TaskTerms(
            dynamics.momentum_jacobian,
            dynamics.momentum_drift,
            -self._damping * dynamics.momentum if self.planned is None else self.planned,
            self._weight if self.planned is None else self._planned_weight,
        )


# --- pelvis


class PelvisHeightTask:
    r"""Height of the pelvis origin.

    .. math:: \ddot z^* = k_p (z_d - z) + k_d (\dot z_d - \dot z)

    with z the height in the world [m].
    """

    def __init__(self, params: ControllerParams) -> None:
        self.target = 0.0  # z_d [m]
        self.rate = 0.0  # its rate [m/s]
        self._gains = params.height_gains
        self._weight = np.array([params.height_weight])

    def evaluate(self, dynamics: Dynamics) -> TaskTerms:
        """Return one row, along the world's z."""
        pelvis = dynamics.frame(dynamics.robot.base)
        kp, kd = self._gains
        acceleration = kp * (self.target - pelvis.position[2]) + kd * (self.rate - pelvis.velocity[2])
        return TaskTerms(pelvis.jacobian[2:3], pelvis.drift[2:3], np.array([acceleration]), self._weight)


class PelvisOrientationTask:
    r"""Orientation of the pelvis: no roll, the commanded pitch, and the yaw of the heading.

    .. math:: \dot\omega^* = k_p\, R_h^T R \log(R^T R_d) + k_d\, R_h^T (\omega_d - \omega)

    in the heading frame R_h, which has the target's yaw only, so that the rows are roll, pitch and yaw [rad].

    Attributes:
        yaw, pitch: angles of R_d [rad]; its roll is zero.
        yaw_rate, pitch_rate: their rates [rad/s].
        weight: weights of the three rows, shape (3,).
    """

    def __init__(self, params: ControllerParams) -> None:
        self.yaw = 0.0
        self.pitch = 0.0
        self.yaw_rate = 0.0
        self.pitch_rate = 0.0
        self._gains = params.orientation_gains
        self.weight = np.array(params.orientation_weight)

    def error(self, dynamics: Dynamics) -> np.ndarray:
        """Return the rotation that is lacking: roll, pitch and yaw in the heading frame [rad], shape (3,)."""
        rotation = dynamics.frame(dynamics.robot.base).rotation
        # R log(R^T R_d) equals log(R_d R^T), which saves a product.
        turn = pin.log3(rotations.rotation_zy(self.yaw, self.pitch).dot(rotation.T))
        return rotations.rotation_z(-self.yaw).dot(turn)

    def evaluate(self, dynamics: Dynamics) -> TaskTerms:
        """Return three rows: roll, pitch and yaw in the heading frame."""
        pelvis = dynamics.frame(dynamics.robot.base)
        to_heading = rotations.rotation_z(-self.yaw)
        kp, kd = self._gains
        acceleration = kp * self.error(dynamics) - kd * to_heading.dot(pelvis.velocity[3:])
        acceleration[1] += kd * self.pitch_rate
        acceleration[2] += kd * self.yaw_rate
        return TaskTerms(
            to_heading.dot(pelvis.jacobian[3:]), to_heading.dot(pelvis.drift[3:]), acceleration, self.weight
        )


class PelvisTravelTask:
    r"""Motion of the pelvis along the heading during a walk: that of the linear inverted pendulum.

    .. math:: \ddot x^* = \omega^2 (c - p_{cop})

    with c the centre of mass along the heading [m]. The pelvis follows the pendulum instead of the centre of mass,
    because the velocity command is the pelvis's, and because the mass of the lifted leg would shake it to and fro.
    There is no row across the heading: a single line-shaped foot has no authority there.
    """

    def __init__(self, params: ControllerParams) -> None:
        self.heading = 0.0  # direction of the row [rad]
        self.feedforward = 0.0  # acceleration of the pendulum [m/s^2]
        self._weight = np.array([params.travel_weight])

    def evaluate(self, dynamics: Dynamics) -> TaskTerms:
        """Return one row, along the heading."""
        pelvis = dynamics.frame(dynamics.robot.base)
        forward = np.array([[math.cos(self.heading), math.sin(self.heading)]])
        return TaskTerms(
            forward.dot(pelvis.jacobian[:2]),
            forward.dot(pelvis.drift[:2]),
            np.array([self.feedforward]),
            self._weight,
        )


# --- feet


def foot_axes(robot: Robot) -> slice:
    """Return the foot's own axes about which a leg turns it: all three with an ankle roll, else y and z."""
    return slice(0 if "ankle_roll" in robot.pairs else 1, 3)


def foot_rows(rotation: np.ndarray, axes: slice) -> np.ndarray:
    """Return the matrix that selects the directions a leg can move its foot in.

    Multiplied by the velocity of a frame, it gives linear velocity along the world's x, y and z, then angular velocity
    about some of the foot's own axes.

    Args:
        rotation: axes of the foot in the world, shape (3, 3).
        axes: which of the foot's own, see `foot_axes`.

    Returns:
        Selection matrix, shape (5, 6) or (6, 6).
    """
    rows = _WORLD_ROWS[: 6 - axes.start].copy()
    rows[3:, 3:] = rotation.T[axes]
    return rows


class StanceContactTask:
    r"""Contact of a standing foot: the sole's centre line rests; without an ankle roll the foot may roll about it.

    .. math::
        \dot V^* = k_d (V_d - V) + (0, 0, 0, k_p (\theta_d - \theta), 0), \qquad V = (\dot p, \omega_y, \omega_z)

    with the velocity of the sole's centre in world axes [m/s] and the angular velocity about the foot's own y and z
    axes [rad/s]; :math:`\theta` is the slope of the sole along its length and :math:`\theta_d` that of the ground, both
    positive with the toe down [rad].

    A foot whose ankle rolls has a sixth row, which keeps its sole level with the same gains. The legs of an H1 have no
    ankle roll, so that two full contacts would have rank 11 of 12, and one would tie the sway of the base to its roll.
    """

    def __init__(self, params: ControllerParams, side: str, robot: Robot) -> None:
        self._axes = foot_axes(robot)
        self.slope = 0.0  # theta_d [rad]
        self.settle = 0.0  # downward speed of a foot that should stand but is still above the ground [m/s]
        self._frame = f"{side}_sole"
        self._damping = params.contact_damping
        self._pitch_stiffness = params.contact_pitch_stiffness
        self._weight = np.full(6 - self._axes.start, params.contact_weight)

    def evaluate(self, dynamics: Dynamics) -> TaskTerms:
        """Return the rows: x, y, z in the world, roll of an ankle that has it, pitch and yaw in the foot."""
        foot = dynamics.frame(self._frame)
        rows = foot_rows(foot.rotation, self._axes)
        error = -rows.dot(foot.velocity)
        error[2] -= self.settle
        acceleration = self._damping * error
        acceleration[-2] += self._pitch_stiffness * (self.slope - pitch_of(foot.rotation))
        if not self._axes.start:
            acceleration[3] -= self._pitch_stiffness * math.asin(min(max(float(foot.rotation[2, 1]), -1.0), 1.0))
        return TaskTerms(rows.dot(foot.jacobian), rows.dot(foot.drift), acceleration, self._weight)


def swing_weights(of_rows: Sequence[float], robot: Robot) -> np.ndarray:
    """Return the weights of a swinging foot's rows, given those of x, y, z, pitch and yaw; roll counts like yaw."""
    return np.array([*of_rows[:3], *([] if foot_axes(robot).start else of_rows[4:]), *of_rows[3:]])


class SwingFootTask:
    r"""Trajectory of a lifted sole in position, pitch and yaw, and level in roll if the ankle has such a joint.

    .. math::
        \ddot p^* = \ddot p_d + k_p (p_d - p) + k_d (\dot p_d - \dot p), \qquad
        \dot\omega^* = k_p' \log(R^T R_d) - k_d' R^T \omega

    the first in world axes [m], the second about the foot's own axes [rad].

    Attributes:
        position, velocity, acceleration: p_d and its derivatives, world axes [m], [m/s], [m/s^2], shape (3,).
        yaw, pitch: angles of R_d [rad].
        weight: weights of the rows, shape (5,) or (6,).
    """

    def __init__(self, params: ControllerParams, side: str, robot: Robot) -> None:
        self._axes = foot_axes(robot)
        self.position = np.zeros(3)
        self.velocity = np.zeros(3)
        self.acceleration = np.zeros(3)
        self.yaw = 0.0
        self.pitch = 0.0
        self._frame = f"{side}_sole"
        gains = np.stack((params.swing_gains, params.swing_rotation_gains), axis=1)
        self._stiffness, self._damping = np.repeat(gains, (3, 3 - self._axes.start), axis=1)
        self.weight = swing_weights((*params.swing_weight, *params.swing_rotation_weight), robot)

    def evaluate(self, dynamics: Dynamics) -> TaskTerms:
        """Return the rows: x, y, z in the world, roll of an ankle that has it, pitch and yaw in the foot."""
        foot = dynamics.frame(self._frame)
        rows = foot_rows(foot.rotation, self._axes)
        turn = pin.log3(foot.rotation.T.dot(rotations.rotation_zy(self.yaw, self.pitch)))
        error = np.concatenate((self.position - foot.position, turn[self._axes]))
        acceleration = self._stiffness * error - self._damping * rows.dot(foot.velocity)
        acceleration[:3] += self.acceleration + self._damping[:3] * self.velocity
        return TaskTerms(rows.dot(foot.jacobian), rows.dot(foot.drift), acceleration, self.weight)


# --- joints


class PostureTask:
    r"""Positions of some joints, such as the waist, the arms or the free leg of a hop [rad].

    .. math:: \ddot q^* = \ddot q_d + k_d (\mathrm{sat}(\dot q_d + \tfrac{k_p}{k_d} (q_d - q)) - \dot q)

    This is a PD law with a bound on the speed at which a gap is closed, so that a target may jump.

    Attributes:
        target, rate, acceleration: q_d [rad] and its derivatives [rad/s], [rad/s^2], shape (k,).
        stiffness, damping: k_p [1/s^2] and k_d [1/s], shape (k,).
        weight: weights of the rows, shape (k,).
        speed: bound on the closing speed [rad/s].
        closing: speed that the last `evaluate` wanted [rad/s], shape (k,).
    """

    def __init__(self, joints: np.ndarray, speed: float, gains: tuple[float, float] = (1.0, 1.0)) -> None:
        """Create a task of weight 1 for some joints.

        Args:
            joints: indices into the robot's joint vectors, shape (k,).
            speed: bound on the closing speed [rad/s].
            gains: k_p [1/s^2] and k_d [1/s] of all of them.
        """
        self.target = np.zeros(joints.size)
        self.rate = np.zeros(joints.size)
        self.acceleration = np.zeros(joints.size)
        self.stiffness, self.damping = (np.full(joints.size, gain) for gain in gains)
        self.weight = np.ones(joints.size)
        self.speed = speed
        self.closing = np.zeros(joints.size)
        self._joints = joints
        self._in_q: slice | np.ndarray | None = None

    def evaluate(self, dynamics: Dynamics) -> TaskTerms:
        """Return one row per joint."""
        if self._in_q is None:
            # The first call tells the order of the joints in the dynamics; q has one entry more than v for the base.
            columns = dynamics.columns[self._joints]
            self._in_q, self._in_v = in_place(columns + 1), in_place(columns)
            self._jacobian = np.eye(dynamics.nv)[columns]
            self._drift = np.zeros(self._joints.size)
        error = self.target - dynamics.q[self._in_q]
        wanted = self.rate + self.stiffness / self.damping * error
        self.closing = np.minimum(np.maximum(wanted, -self.speed), self.speed)
        acceleration = self.acceleration + self.damping * (self.closing - dynamics.v[self._in_v])
        return TaskTerms(self._jacobian, self._drift, acceleration, self.weight)

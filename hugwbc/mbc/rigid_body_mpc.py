"""Contact forces of a stance that ends in flight, by model-predictive control of the robot as a single rigid body.

Forces of a single rigid body by a condensed QP are due to Di Carlo et al. (Dynamic locomotion in the MIT Cheetah 3
through convex model-predictive control, IROS 2018). Here the horizon ends at the take-off instead of receding, the
flight enters in closed form, and the legs are not massless.
"""

import dataclasses

import numpy as np

from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.qp import friction_pyramid, proxqp
from hugwbc.state import GRAVITY

_INFINITY = 1e20
_TOLERANCE = 1e-4  # residual of forces in units of the robot's weight
_ITERATIONS, _INNER_ITERATIONS = 50, 20
_INFEASIBILITY_TOLERANCE = 1e-9


@dataclasses.dataclass(frozen=True, eq=False)
class RigidBody:
    """The robot as one body, in axes along the heading."""

    mass: float  # mass of the robot [kg]
    # angular momentum per angular velocity of the pelvis while the feet stay [kg m^2], shape (3, 3)
    inertia: np.ndarray
    coupling: np.ndarray  # angular momentum per velocity of the centre of mass while the feet stay [kg m], shape (3, 3)
    frozen_inertia: np.ndarray  # inertia of all links together about the centre of mass [kg m^2], shape (3, 3)
    # com and velocity: position and velocity of the centre of mass [m], [m/s], shape (3,)
    com: np.ndarray
    velocity: np.ndarray
    tilt: np.ndarray  # rotation from the desired to the actual orientation of the pelvis [rad], shape (3,)
    momentum: np.ndarray  # angular momentum about the centre of mass [kg m^2/s], shape (3,)


@dataclasses.dataclass(frozen=True, eq=False)
class Stance:
    """Where and for how long the ground can push, in the axes of the body."""

    points: np.ndarray  # contact points [m], two per foot, foot after foot, shape (P, 3)
    ankles: np.ndarray  # points on the axes of the ankle joints [m], shape (P / 2, 3)
    lateral: np.ndarray  # directions of these axes, shape (P / 2, 3)
    time_left: float  # time until the feet leave the ground [s], positive


@dataclasses.dataclass(frozen=True, eq=False)
class TakeOff:
    """Where the stance should lead, in the axes of the body."""

    height: float  # height of the centre of mass when the feet leave the ground [m]
    velocity: np.ndarray  # velocity of the centre of mass at that moment [m/s], shape (3,)
    spin: np.ndarray  # desired angular velocity, now and at take-off [rad/s], shape (3,)
    flight: float  # duration of the flight that follows [s]; zero to come to rest


@dataclasses.dataclass(frozen=True, eq=False)
class ForcePlan:
    """Forces of the ground until the feet leave it."""

    solved: bool  # whether the solver converged
    forces: np.ndarray  # force on each point in N intervals of equal length [N], shape (N, P, 3)
    interval: float  # length of an interval [s]

    def at(self, time: float) -> np.ndarray:
        """Return the forces at a time [s] after the plan was made [N], shape (P, 3)."""
        return self.forces[min(int(time / self.interval), len(self.forces) - 1)]


class RigidBodyMpc:
    r"""Planner of the forces over the rest of a stance, with the flight after it in view.

    .. math::
        m \ddot c = \sum_i f_i + m g, \qquad \dot k = \sum_i (r_i - \bar c) \times f_i, \qquad
        k = I (\dot\theta + \omega_d) + K (\dot c - \dot r) + (I_0 - I)\, \omega_r

    The legs weigh as much as the trunk, so their motion matters. They keep the feet where the plan has them:
    :math:`\dot r` and :math:`\omega_r` are the velocity and the turning rate of the feet. Both are zero in stance. In
    flight they are on average twice those of the body, since the feet have to catch up. I is the inertia that the
    pelvis then feels, :math:`I_0` that of the frozen robot.

    The centre of mass in the moment arm, :math:`\bar c`, keeps its height and its horizontal velocity. This makes the
    problem linear; it is corrected by solving again, many times per stance. The rest of the stance is cut into
    `mpc_intervals` equal parts of constant force, so that the grid always ends where the feet leave the ground. The
    flight is ballistic, with k conserved. States are eliminated (condensed): the unknowns are the forces of the
    scheduled contacts, in units of the robot's weight.

    The cost asks for the height and velocity of the take-off, for an upright body at take-off and landing, for small
    departures from the velocity on the way, and for forces close to an even vertical push. The constraints are friction
    pyramids, which also keep the ground from pulling, and the moment that the ankles hold.
    """

    def __init__(self, params: ControllerParams, points: int, ankle_torque: float) -> None:
        """Set up the constraints and the solver.

        Args:
            params: weights and limits.
            points: number of contact points, two per foot.
            ankle_torque: torque limit of one ankle [N m].
        """
        self._params = params
        self._ankle_torque = params.torque_fraction * ankle_torque
        self._points = points
        self._intervals = params.mpc_intervals
        width = 3 * points
        size = self._intervals * width
        # Every interval has the same rows: four of friction per point, then one of the ankle per foot. The matrix is
        # block diagonal, since no constraint ties the forces of two intervals to each other.
        self._rows = 4 * points + points // 2
        self._C = np.zeros((self._intervals, self._rows, self._intervals, width))
        friction = np.kron(np.eye(points), friction_pyramid(params.friction))
        for j in range(self._intervals):
            self._C[j, : 4 * points, j] = friction
        self._low = np.full((self._intervals, self._rows), -_INFINITY)
        self._high = np.zeros((self._intervals, self._rows))
        self._size = size
        self.reset()

    def reset(self) -> None:
        """Forget the previous solution, so that the next solve starts cold."""
        self._solver = proxqp.dense.QP(self._size, 0, self._intervals * self._rows, False)
        settings = self._solver.settings
        settings.eps_abs = _TOLERANCE
        settings.max_iter, settings.max_iter_in = _ITERATIONS, _INNER_ITERATIONS
        settings.eps_primal_inf = settings.eps_dual_inf = _INFEASIBILITY_TOLERANCE
        settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
        self._started = False

    def solve(self, body: RigidBody, stance: Stance, target: TakeOff) -> ForcePlan:
        """Plan the forces from now on.

        Returns:
            The plan; if it is not `solved`, its forces are those of a quiet stand.
        """
        time_left = max(stance.time_left, self._params.mpc_shortest_stance)
        try:
            x = self._run(body, stance, target, time_left)
        except np.linalg.LinAlgError:
            x = None
        solved = x is not None
        if x is None:
            # Without a solution the ground carries the robot's weight, evenly, until the next plan.
            self.reset()
            x = np.tile([0.0, 0.0, 1.0 / self._points], self._intervals * self._points)
        forces = body.mass * GRAVITY * x.reshape(self._intervals, self._points, 3)
        return ForcePlan(solved, forces, time_left / self._intervals)

    def _run(self, body: RigidBody, stance: Stance, target: TakeOff, time_left: float) -> np.ndarray | None:
        """Return the optimal forces in units of the robot's weight, shape (size,); None if none were found."""
        weight = body.mass * GRAVITY
        influence, moments = self._influence(body, stance, time_left)
        H, g = self._cost(body, target, influence, moments, time_left)
        self._fill_ankles(stance, weight)
        if not (np.isfinite(H).all() and np.isfinite(g).all()):
            return None
        data = (H, g, None, None, self._C.reshape(-1, self._size), self._low.ravel(), self._high.ravel())
        if self._started:
            self._solver.update(*data, False)
        else:
            self._solver.init(*data)
            self._started = True
        self._solver.solve()
        x = np.array(self._solver.results.x)
        solved = self._solver.results.info.status == proxqp.PROXQP_SOLVED and bool(np.all(np.isfinite(x)))
        return x if solved else None

    def _influence(self, body: RigidBody, stance: Stance, time_left: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the accelerations that the forces of an interval, in units of the weight, cause in that interval.

        Returns:
            Acceleration of the centre of mass [m/s^2], shape (3, 3 P), and, from the moments, of the tilt [rad/s^2],
            shape (N, 3, 3 P).
        """
        times = (np.arange(self._intervals) + 0.5) * time_left / self._intervals
        # Moment arms about the predicted centre of mass, which travels horizontally only.
        com = body.com + np.outer(times, body.velocity * [1.0, 1.0, 0.0])
        arms = stance.points[None] - com[:, None]  # (N, P, 3)
        cross = np.zeros((self._intervals, 3, self._points, 3))
        cross[:, 0, :, 1], cross[:, 0, :, 2] = -arms[..., 2], arms[..., 1]
        cross[:, 1, :, 0], cross[:, 1, :, 2] = arms[..., 2], -arms[..., 0]
        cross[:, 2, :, 0], cross[:, 2, :, 1] = -arms[..., 1], arms[..., 0]
        moments = cross.reshape(self._intervals, 3, -1) * (body.mass * GRAVITY)
        return np.tile(GRAVITY * np.eye(3), self._points), np.linalg.solve(body.inertia, moments)

    def _cost(
        self, body: RigidBody, target: TakeOff, linear: np.ndarray, angular: np.ndarray, time_left: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return H and g of the condensed problem: motion targets, and forces close to an even push."""
        parts = self._asked(body, target, linear, angular, time_left)
        matrix = np.concatenate([block * np.sqrt(weight) for block, _, weight in parts])
        wanted = np.concatenate([value * np.sqrt(weight) for _, value, weight in parts])
        # The force weight also makes H regular, since different forces may cause the same motion.
        H = matrix.T @ matrix
        force_weight = self._params.mpc_force_weight * (time_left / self._intervals)
        H.flat[:: self._size + 1] += force_weight
        g = -(wanted @ matrix)
        # An even push has the mean force that brings the vertical velocity to that of the take-off, and no other part.
        mean = 1.0 + (target.velocity[2] - body.velocity[2]) / (GRAVITY * time_left)
        g[2::3] -= force_weight * max(mean, 0.0) / self._points
        return H, g

    def _asked(
        self, body: RigidBody, target: TakeOff, linear: np.ndarray, angular: np.ndarray, time_left: float
    ) -> tuple[tuple[np.ndarray, np.ndarray, float], ...]:
        """Return the motion targets of the cost: rows over the forces, desired values, and weights.

        The motion is linear in the forces: their effect should equal what is wanted minus the motion without forces.
        """
        params, n = self._params, self._intervals
        dt = time_left / n
        # Effect of the acceleration in interval j on velocity and position at the end of interval k.
        ends = np.arange(1, n + 1)
        past = ends[:, None] > np.arange(n)
        speed = dt * past
        place = dt**2 * past * (ends[:, None] - np.arange(n) - 0.5)
        t = dt * ends
        spin, sway, frozen = (
            np.linalg.solve(body.inertia, x) for x in (body.momentum, body.coupling, body.frozen_inertia)
        )
        spin = spin - target.spin
        # In flight the feet catch up with the body at twice its speed. The momentum of the legs then changes the rate
        # of the tilt beyond what the total angular momentum gives.
        drift = sway[:, :2] @ target.velocity[:2] - 2.0 * (frozen - np.eye(3)) @ target.spin
        if target.flight == 0.0:
            drift = np.zeros(3)
        # The motion without forces: a ballistic centre of mass, and a body that keeps its angular momentum.
        free_velocity = body.velocity + np.outer(t, [0.0, 0.0, -GRAVITY])
        free_height = body.com[2] + body.velocity[2] * time_left - 0.5 * GRAVITY * time_left**2
        path = np.outer(t, body.velocity) + np.outer(0.5 * t**2, [0.0, 0.0, -GRAVITY])
        free_tilt = body.tilt + np.outer(t, spin) - path @ sway.T

        def rows(weights: np.ndarray, block: np.ndarray) -> np.ndarray:
            """Return the rows of sum over j of weights_kj block_j, shape (K * rows, size)."""
            return (weights[:, :, None, None] * block).swapaxes(1, 2).reshape(-1, self._size)

        # With the feet fixed, motion of the centre of mass takes its share K of the angular momentum from the trunk.
        velocity_rows = rows(speed, linear[:2])
        tilt_rows = rows(place, angular - sway @ linear)
        last = speed[-1:]
        return (
            (velocity_rows[:-2], (target.velocity[:2] - free_velocity[:-1, :2]).ravel(), params.mpc_sway_weight * dt),
            (velocity_rows[-2:], target.velocity[:2] - free_velocity[-1, :2], params.mpc_velocity_weight),
            (rows(last, linear[2:]), target.velocity[2:] - free_velocity[-1, 2:], params.mpc_rise_weight),
            (rows(place[-1:], linear[2:]), np.array([target.height - free_height]), params.mpc_height_weight),
            (tilt_rows, -free_tilt.ravel(), params.mpc_tilt_weight / n),
            (rows(last, angular), -spin - drift, params.mpc_spin_weight),
            (
                tilt_rows[-3:] + target.flight * rows(last, angular),
                -(free_tilt[-1] + target.flight * (spin + drift)),
                params.mpc_landing_tilt_weight,
            ),
        )

    def _fill_ankles(self, stance: Stance, weight: float) -> None:
        """Bound the moment of the ground about each ankle by the ankle's torque."""
        for foot in range(self._points // 2):
            pair = slice(2 * foot, 2 * foot + 2)
            # lateral . (arm x f) = (lateral x arm) . f
            row = np.cross(stance.lateral[foot], stance.points[pair] - stance.ankles[foot]).ravel()
            index = 4 * self._points + foot
            intervals = np.arange(self._intervals)
            self._C[intervals, index, intervals, 6 * foot : 6 * foot + 6] = row
            self._low[:, index], self._high[:, index] = -self._ankle_torque / weight, self._ankle_torque / weight

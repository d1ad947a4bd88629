"""Contact forces of a stance that ends in flight, by model-predictive control of the robot as a single rigid body."""

import dataclasses

import numpy as np

from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.proxsuite_build import proxqp
from hugwbc.mbc.qp import friction_pyramid
from hugwbc.state import GRAVITY

_INFINITY = 1e20
_TOLERANCE = 1e-4  # of forces in units of the robot's weight
_ITERATIONS, _INNER_ITERATIONS = 50, 20
_INFEASIBILITY_TOLERANCE = 1e-9


@dataclasses.dataclass(frozen=True, eq=False)
class RigidBody:
    """The robot as one body, in axes along the heading.

    Attributes:
        mass: [kg].
        inertia: angular momentum per angular velocity of the pelvis while the feet stay [kg m^2], shape (3, 3).
        coupling: angular momentum per velocity of the centre of mass while the feet stay [kg m], shape (3, 3).
        frozen_inertia: of all links together about the centre of mass [kg m^2], shape (3, 3).
        com, velocity: of the centre of mass [m], [m/s], shape (3,).
        tilt: rotation from the desired to the actual orientation of the pelvis [rad], shape (3,).
        momentum: angular, about the centre of mass [kg m^2/s], shape (3,).
    """

    mass: float
    inertia: np.ndarray
    coupling: np.ndarray
    frozen_inertia: np.ndarray
    com: np.ndarray
    velocity: np.ndarray
    tilt: np.ndarray
    momentum: np.ndarray


@dataclasses.dataclass(frozen=True, eq=False)
class Stance:
    """What the ground may do until the feet leave it, in the axes of the body.

    Attributes:
        points: where the ground pushes [m], shape (P, 3); two points a foot, foot after foot.
        ankles: axes of the feet's ankle joints [m], shape (P / 2, 3).
        lateral: directions of these axes, shape (P / 2, 3).
        time_left: until the feet leave the ground [s], positive.
    """

    points: np.ndarray
    ankles: np.ndarray
    lateral: np.ndarray
    time_left: float


@dataclasses.dataclass(frozen=True, eq=False)
class TakeOff:
    """Where the stance is to lead, in the axes of the body.

    Attributes:
        height: of the centre of mass when the feet leave the ground [m].
        velocity: of the centre of mass then [m/s], shape (3,).
        spin: angular velocity, now and then [rad/s], shape (3,).
        flight: duration of the flight that follows [s]; zero to come to rest.
    """

    height: float
    velocity: np.ndarray
    spin: np.ndarray
    flight: float


@dataclasses.dataclass(frozen=True, eq=False)
class ForcePlan:
    """What the ground is to do until the feet leave it.

    Attributes:
        solved: whether the solver converged.
        forces: on each point, in N intervals of equal length [N], shape (N, P, 3).
        interval: its length [s].
    """

    solved: bool
    forces: np.ndarray
    interval: float

    def at(self, time: float) -> np.ndarray:
        """Forces at a time after the plan was made [N], shape (P, 3)."""
        return self.forces[min(int(time / self.interval), len(self.forces) - 1)]


class RigidBodyMpc:
    r"""Forces over the rest of a stance and the flight after it.

    .. math::
        m \ddot c = \sum_i f_i + m g, \qquad \dot k = \sum_i (r_i - \bar c) \times f_i, \qquad
        k = I (\dot\theta + \omega_d) + K (\dot c - \dot r) + (I_0 - I)\, \omega_r

    The legs weigh as much as the trunk, so that it matters how they move: they keep the feet where the plan has them,
    and :math:`\dot r`, :math:`\omega_r` are velocity and turning rate of the feet: zero in stance; in flight, on
    average twice those of the body, since the feet catch up. I is the inertia that the pelvis then feels, I_0 that of
    the frozen robot. The centre of mass in the moment arm, c bar, keeps its height and its horizontal velocity: the
    problem is then linear and is solved again, many times per stance. The rest of the stance is cut into
    `mpc_intervals` equal parts of constant force, so that the grid always ends where the feet leave the ground; the
    flight is ballistic, with k conserved. States are eliminated (condensed): the unknowns are the forces of the
    scheduled contacts, in units of the robot's weight.

    The cost asks for height and velocity at take-off, for an upright body then and at the landing, for small departures
    from the velocity on the way, and for forces close to an even vertical push. Constraints: friction pyramids, which
    include that the ground does not pull, and the moment that the ankles hold.
    """

    def __init__(self, params: ControllerParams, points: int, ankle_torque: float) -> None:
        """Set up for a number of contact points, two a foot, and an ankle torque limit [N m]."""
        self._params = params
        self._ankle_torque = params.torque_fraction * ankle_torque
        self._points = points
        self._intervals = params.mpc_intervals
        width = 3 * points
        size = self._intervals * width
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
        """Forget the previous solution."""
        self._solver = proxqp.dense.QP(self._size, 0, self._intervals * self._rows, False)
        settings = self._solver.settings
        settings.eps_abs = _TOLERANCE
        settings.max_iter, settings.max_iter_in = _ITERATIONS, _INNER_ITERATIONS
        settings.eps_primal_inf = settings.eps_dual_inf = _INFEASIBILITY_TOLERANCE
        settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
        self._started = False

    def solve(self, body: RigidBody, stance: Stance, target: TakeOff) -> ForcePlan:
        """The forces to apply from now on; with `solved` false those of a quiet stand."""
        time_left = max(stance.time_left, self._params.mpc_shortest_stance)
        try:
            x = self._run(body, stance, target, time_left)
        except np.linalg.LinAlgError:
            x = None
        solved = x is not None
        if x is None:
            self.reset()
            x = np.tile([0.0, 0.0, 1.0 / self._points], self._intervals * self._points)
        forces = body.mass * GRAVITY * x.reshape(self._intervals, self._points, 3)
        return ForcePlan(solved, forces, time_left / self._intervals)

    def _run(self, body: RigidBody, stance: Stance, target: TakeOff, time_left: float) -> np.ndarray | None:
        """Optimal forces, in units of the robot's weight, shape (size,); None if there are none."""
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
        """Acceleration of the centre of mass [m/s^2], shape (3, 3 P), and of the tilt [rad/s^2], shape (N, 3, 3 P)."""
        times = (np.arange(self._intervals) + 0.5) * time_left / self._intervals
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
        """H and g of the condensed problem: all that is asked for, and forces close to an even push."""
        parts = self._asked(body, target, linear, angular, time_left)
        matrix = np.concatenate([block * np.sqrt(weight) for block, _, weight in parts])
        wanted = np.concatenate([value * np.sqrt(weight) for _, value, weight in parts])
        H = matrix.T @ matrix
        force_weight = self._params.mpc_force_weight * (time_left / self._intervals)
        H.flat[:: self._size + 1] += force_weight
        g = -(wanted @ matrix)
        # The mean force that brings the vertical velocity to that of the take-off, shared evenly.
        mean = 1.0 + (target.velocity[2] - body.velocity[2]) / (GRAVITY * time_left)
        g[2::3] -= force_weight * max(mean, 0.0) / self._points
        return H, g

    def _asked(
        self, body: RigidBody, target: TakeOff, linear: np.ndarray, angular: np.ndarray, time_left: float
    ) -> tuple[tuple[np.ndarray, np.ndarray, float], ...]:
        """What the cost asks of the motion: rows over the forces, their wanted values, and the weight of each part."""
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
        # Rate of the tilt in flight beyond that which the angular momentum gives.
        drift = sway[:, :2] @ target.velocity[:2] - 2.0 * (frozen - np.eye(3)) @ target.spin
        if target.flight == 0.0:
            drift = np.zeros(3)
        free_velocity = body.velocity + np.outer(t, [0.0, 0.0, -GRAVITY])
        free_height = body.com[2] + body.velocity[2] * time_left - 0.5 * GRAVITY * time_left**2
        path = np.outer(t, body.velocity) + np.outer(0.5 * t**2, [0.0, 0.0, -GRAVITY])
        free_tilt = body.tilt + np.outer(t, spin) - path @ sway.T

        def rows(weights: np.ndarray, block: np.ndarray) -> np.ndarray:
            """Row vectors of sum over j of weights_kj block_j: shape (K * rows, size)."""
            return (weights[:, :, None, None] * block).swapaxes(1, 2).reshape(-1, self._size)

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
        """Moment of the ground about each ankle within the ankle's torque."""
        for foot in range(self._points // 2):
            pair = slice(2 * foot, 2 * foot + 2)
            # lateral . (arm x f) = (lateral x arm) . f
            row = np.cross(stance.lateral[foot], stance.points[pair] - stance.ankles[foot]).ravel()
            index = 4 * self._points + foot
            intervals = np.arange(self._intervals)
            self._C[intervals, index, intervals, 6 * foot : 6 * foot + 6] = row
            self._low[:, index], self._high[:, index] = -self._ankle_torque / weight, self._ankle_torque / weight

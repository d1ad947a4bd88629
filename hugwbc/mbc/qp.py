"""The whole-body QP: inverse dynamics under contact, friction, torque and joint limits."""

import dataclasses
import enum
from collections.abc import Sequence

import numpy as np
from proxsuite import proxqp

from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.tasks.task import TaskTerms
from hugwbc.robot import SIDES, Robot

CONTACT_POINTS = tuple(f"{side}_{end}" for side in SIDES for end in ("heel", "toe"))
"""Frames at which the ground pushes: the ends of each sole's centre line."""
_FORCES = 3 * len(CONTACT_POINTS)
_BASE = 6
_INFINITY = 1e20
_BOTH = np.array([[1.0], [-1.0]])  # signs of the two directions of a joint
_INNER_ITERATIONS = 20
_INFEASIBILITY_TOLERANCE = 1e-9


class QpStatus(enum.Enum):
    """How a solve ended."""

    SOLVED = "solved"
    RELAXED = "solved without joint limits"
    FAILED = "failed"


@dataclasses.dataclass(frozen=True, eq=False)
class QpSolution:
    """Accelerations, forces and torques of one solve.

    Attributes:
        status: whether they can be used.
        iterations: of the solver.
        acceleration: dv/dt, in the dynamics' order, shape (nv,).
        forces: of the ground on `CONTACT_POINTS`, world axes [N], shape (4, 3).
        torque: in the robot's joint order [N*m], shape (19,).
    """

    status: QpStatus
    iterations: int
    acceleration: np.ndarray
    forces: np.ndarray
    torque: np.ndarray


class WholeBodyQp:
    r"""Weighted least squares over accelerations and contact forces, torques eliminated.

    .. math::
        \min_{\dot v, f}\; & \sum_i \| J_i \dot v + \dot J_i v - a_i^* \|^2_{W_i}
            + \epsilon_v \|\dot v\|^2 + \epsilon_f \|f - f^*\|^2 \\
        \text{s.t. } & M_b \dot v + h_b = J_b^T f \quad\text{(base, 6 rows)} \\
        & |M_j \dot v + h_j - J_j^T f| \le \tau_{max} \quad\text{(joints, 19 rows)} \\
        & |f_x|, |f_y| \le \tfrac{\mu}{\sqrt 2} f_z, \quad 0 \le f_z \le f_{max} \quad\text{(4 points)} \\
        & \dot v_j^{min}(q, v) \le \dot v_j \le \dot v_j^{max}(q, v) \quad\text{(joint range and speed)}

    The size never changes: a foot in the air has its forces bounded to zero. Without the joint-range bounds the problem
    is always feasible (any torque is consistent with some acceleration), so that they are dropped for one tick if the
    solver fails with them. Every solve is bounded by `qp_max_iterations` outer and 20 inner iterations; the
    closest-feasible mode of ProxQP is never used, since its run time is not bounded.
    """

    def __init__(self, params: ControllerParams, robot: Robot, nv: int, columns: np.ndarray) -> None:
        """Set up for `nv` velocities, of which `columns` are the robot's joints."""
        self._params = params
        self._robot = robot
        self._nv = nv
        # A slice where the order allows it: it reads and writes in place, an index array copies.
        first = int(columns[0])
        in_order = np.array_equal(columns, np.arange(first, first + columns.size))
        self._columns = slice(first, first + columns.size) if in_order else columns
        self._joints = columns - 6
        self._fastest = params.speed_fraction * robot.velocity_limit
        self._range = np.stack((robot.upper, -robot.lower)) - params.joint_margin
        self._torque_limit = params.torque_fraction * robot.torque_limit
        size, joints = nv + _FORCES, len(robot.joint_names)
        self._H = np.zeros((size, size))
        self._g = np.zeros(size)
        self._A = np.zeros((_BASE, size))
        self._C = np.zeros((joints + 4 * len(CONTACT_POINTS), size))
        self._low = np.full(len(self._C), -_INFINITY)
        self._high = np.zeros(len(self._C))
        self._box_low = np.full(size, -_INFINITY)
        self._box_high = np.full(size, _INFINITY)
        self._add_friction(joints)
        self._points = np.zeros((_FORCES, nv))
        self.reset()

    def _add_friction(self, first_row: int) -> None:
        slope = self._params.friction / np.sqrt(2.0)
        for point in range(len(CONTACT_POINTS)):
            column = self._nv + 3 * point
            for k, (axis, sign) in enumerate(((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0))):
                row = first_row + 4 * point + k
                self._C[row, column + axis] = sign
                self._C[row, column + 2] = -slope

    def reset(self) -> None:
        """Forget the previous solution; the next solve starts cold."""
        self._solver = proxqp.dense.QP(len(self._g), _BASE, len(self._low), True)
        self._solver.settings.eps_abs = self._params.qp_tolerance
        self._solver.settings.max_iter = self._params.qp_max_iterations
        # The default inner bound of 1500 lets an infeasible problem run for seconds.
        self._solver.settings.max_iter_in = _INNER_ITERATIONS
        # The default takes feasible problems for infeasible when a contact switch leaves the warm start far away.
        self._solver.settings.eps_primal_inf = _INFEASIBILITY_TOLERANCE
        self._solver.settings.eps_dual_inf = _INFEASIBILITY_TOLERANCE
        self._solver.settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
        self._started = False

    def solve(
        self,
        dynamics: Dynamics,
        terms: Sequence[TaskTerms],
        contact: np.ndarray,
        planned: np.ndarray | None = None,
    ) -> QpSolution:
        """The optimum at the dynamics' state.

        Args:
            dynamics: updated.
            terms: of every task.
            contact: whether the ground may push at each of `CONTACT_POINTS`, shape (4,), bool.
            planned: forces f* to stay close to [N], shape (4, 3); None for none, f* = 0 with a tiny weight.
        """
        self._fill_cost(terms, planned)
        self._fill_dynamics(dynamics)
        self._fill_contact(contact)
        self._fill_joint_limits(dynamics)
        status = QpStatus.SOLVED
        iterations = self._run()
        if not self._ok():
            status = QpStatus.RELAXED
            self._box_low[self._columns] = -_INFINITY
            self._box_high[self._columns] = _INFINITY
            self.reset()
            iterations += self._run()
        x = self._solver.results.x
        acceleration, forces = x[: self._nv].copy(), x[self._nv :].copy()
        # The joints' rows of the constraints are their torques, less the bias.
        torque = self._C[: len(self._torque_limit)] @ x + dynamics.bias[self._columns]
        if not self._ok() or not np.all(np.isfinite(torque)):
            self.reset()
            status = QpStatus.FAILED
        return QpSolution(status, iterations, acceleration, forces.reshape(-1, 3), torque)

    def _fill_cost(self, terms: Sequence[TaskTerms], planned: np.ndarray | None) -> None:
        jacobian = np.concatenate([t.jacobian for t in terms])
        weight = np.concatenate([t.weight for t in terms])
        target = np.concatenate([t.acceleration - t.drift for t in terms])
        weighted = jacobian * weight[:, None]
        nv = self._nv
        self._H[:nv, :nv] = jacobian.T @ weighted
        self._H.flat[: nv * len(self._g) : len(self._g) + 1] += self._params.acceleration_regularisation
        self._g[:nv] = -(target @ weighted)
        params = self._params
        weight = params.force_regularisation if planned is None else params.planned_force_weight
        np.fill_diagonal(self._H[nv:, nv:], weight)
        self._g[nv:] = 0.0 if planned is None else -weight * planned.ravel()

    def _fill_dynamics(self, dynamics: Dynamics) -> None:
        nv, columns = self._nv, self._columns
        for k, point in enumerate(CONTACT_POINTS):
            self._points[3 * k : 3 * k + 3] = dynamics.point(point)[1]
        self._A[:, :nv] = dynamics.M[:_BASE]
        self._A[:, nv:] = -self._points[:, :_BASE].T
        joints = len(self._torque_limit)
        self._C[:joints, :nv] = dynamics.M[columns]
        self._C[:joints, nv:] = -self._points[:, columns].T
        self._b = -dynamics.bias[:_BASE]
        bias = dynamics.bias[columns]
        self._low[:joints] = -self._torque_limit - bias
        self._high[:joints] = self._torque_limit - bias

    def _fill_contact(self, contact: np.ndarray) -> None:
        bound = np.outer(contact, (_INFINITY, _INFINITY, self._params.max_normal_force)).ravel()
        self._box_high[self._nv :] = bound
        self._box_low[self._nv :] = -bound
        self._box_low[self._nv + 2 :: 3] = 0.0

    def _fill_joint_limits(self, dynamics: Dynamics) -> None:
        """Bound each joint's acceleration so that it can still brake before its limit, and keeps its speed limit.

        Viability: a speed towards the limit of at most sqrt(2 a d), with d the distance left [rad] and a the assumed
        braking deceleration; beyond the limit, a slow return.
        """
        params = self._params
        # Both directions at once: distance left to the upper and to the lower limit.
        left = self._range - _BOTH * dynamics.q[7:][self._joints]
        speed = np.where(left > 0.0, np.sqrt(2.0 * params.joint_brake * np.maximum(left, 0.0)), 5.0 * left)
        # Close to the limit the square root falls too steeply to be followed in discrete time.
        speed = np.minimum(np.minimum(speed, left / params.joint_horizon), self._fastest)
        upward, downward = (_BOTH * speed - dynamics.v[self._columns]) / params.joint_horizon
        self._box_high[self._columns], self._box_low[self._columns] = upward, downward

    @property
    def problem(self) -> tuple[np.ndarray, ...]:
        """H, g, A, b, C, lower and upper bound of C x, lower and upper bound of x, as last solved."""
        return self._H, self._g, self._A, self._b, self._C, self._low, self._high, self._box_low, self._box_high

    def _run(self) -> int:
        data = self.problem
        if self._started:
            self._solver.update(*data, False)
        else:
            self._solver.init(*data)
            self._started = True
        self._solver.solve()
        return int(self._solver.results.info.iter)

    def _ok(self) -> bool:
        results = self._solver.results
        return results.info.status == proxqp.PROXQP_SOLVED and bool(np.all(np.isfinite(results.x)))

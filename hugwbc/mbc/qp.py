"""The whole-body QP: inverse dynamics under contact, friction, torque and joint limits.

ProxSuite comes in builds for wide vector instructions and loads the widest one that the processor supports. These sum
the first elements of a vector one by one until an address is aligned. Two solvers with the same problem then differ by
1e-11, and sometimes by an iteration, depending on what the process did before, and no walk can be repeated. The build
for any processor needs no such alignment. On problems as small as these it is as fast: 98 to 103 us per solve.
"""

import enum
import math
import sys
import types
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hugwbc.kinematics import in_place
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.tasks import TaskTerms
from hugwbc.robot import SIDES, Robot
from hugwbc.rotations import rotation_z

if "proxsuite" not in sys.modules:
    _narrow = types.ModuleType("proxsuite.instructionset")  # which ProxSuite asks for the processor's instructions
    _narrow.has_AVX512F = _narrow.has_AVX2 = lambda: False
    sys.modules[_narrow.__name__] = _narrow

from proxsuite import proxqp

CONTACT_POINTS = tuple(f"{side}_{end}" for side in SIDES for end in ("heel", "toe"))
"""Frames at which the ground pushes: the ends of each sole's centre line."""
_FORCES = 3 * len(CONTACT_POINTS)
_BASE = 6
_INFINITY = 1e20
_INNER_ITERATIONS = 8
_LARGEST_DEMAND = 1e4  # of a task [its unit / s^2]: far more than a robot can do, yet small enough for the solver
_INFEASIBILITY_TOLERANCE = 1e-12
# ProxQP penalises the distance from its last iterate by this much. Its default, 1e-6, is a tenth of the weight on the
# forces and holds them at their last values, which costs an iteration in every walking tick and four times the error.
_PROXIMAL_WEIGHT = 1e-7


def friction_pyramid(friction: float) -> np.ndarray:
    """Return the pyramid inside the friction cone about the vertical.

    Dividing by the square root of 2 puts the pyramid's edges on the cone, so that a force on them does not slip either.

    Returns:
        Four rows, shape (4, 3); a force is inside the pyramid if none of its products with them is above 0.
    """
    slope = friction / math.sqrt(2.0)
    return np.array([[1.0, 0.0, -slope], [-1.0, 0.0, -slope], [0.0, 1.0, -slope], [0.0, -1.0, -slope]])


class QpStatus(enum.Enum):
    """How a solve ended."""

    SOLVED = "solved"
    RELAXED = "solved without joint limits"
    FAILED = "failed"


class QpSolution(NamedTuple):
    """Accelerations, forces and torques of one solve."""

    status: QpStatus  # whether they can be used
    acceleration: np.ndarray  # dv/dt in the order of the dynamics, shape (nv,)
    forces: np.ndarray  # forces of the ground on `CONTACT_POINTS`, world axes [N], shape (4, 3)
    torque: np.ndarray  # joint torques in the robot's joint order [N*m], shape (n,)


class WholeBodyQp:
    r"""Weighted least squares over accelerations and contact forces, with the torques eliminated.

    .. math::
        \min_{\dot v, f}\; & \sum_i \| J_i \dot v + \dot J_i v - a_i^* \|^2_{W_i}
            + \epsilon_v \|\dot v\|^2 + \epsilon_f \|f - f^*\|^2 \\
        \text{s.t. } & M_b \dot v + h_b = J_b^T f \quad\text{(base, 6 rows)} \\
        & |M_j \dot v + h_j - J_j^T f| \le \tau_{max} \quad\text{(joints, n rows)} \\
        & |f_x|, |f_y| \le \tfrac{\mu}{\sqrt 2} f_z, \quad 0 \le f_z \le f_{max} \quad
            \text{(4 points, axes of the heading)} \\
        & \dot v_j^{min}(q, v) \le \dot v_j \le \dot v_j^{max}(q, v) \quad\text{(joint range and speed)}

    The size of the problem never changes. Where the ground does not push, the force keeps its variables but loses its
    effect and its bounds: its cost makes it zero, and the solver has no constraint to work on.

    Without the joint-range bounds the problem is always feasible, since any torque is consistent with some
    acceleration. If the solver fails with these bounds, they are dropped for one tick.

    Every solve is bounded by `qp_max_iterations` outer and 8 inner iterations. The closest-feasible mode of ProxQP is
    never used, since its run time is not bounded.
    """

    def __init__(self, params: ControllerParams, robot: Robot, nv: int, columns: np.ndarray) -> None:
        """Set up the matrices and the solver.

        Args:
            params: gains, weights and limits.
            robot: limits of the joints.
            nv: number of generalised velocities.
            columns: places of the robot's joints in them, shape (n,).
        """
        self._params = params
        self._nv = nv
        self._columns = in_place(columns)
        # Internally the joints are in the order of the generalised velocities.
        self._joints = slice(_BASE, nv)
        order = np.argsort(columns)
        self._highest_torque = params.torque_fraction * robot.torque_limit[order]
        self._lowest, self._highest = (limit[order] for limit in robot.limits(params.joint_margin))
        self._fastest = robot.velocity_limit[order]
        size, joints = nv + _FORCES, columns.size
        self._H = np.zeros((size, size))
        self._diagonal = np.einsum("ii->i", self._H)  # a view
        points = range(len(CONTACT_POINTS))
        self._g = np.zeros(size)
        # Rows: equation of motion of the base, of the joints, then friction. The base has no motor, so its six rows are
        # equalities (A); those of the joints are their torques, bounded like friction (C). All names below are views,
        # so that a tick fills the matrices in place.
        rows = np.zeros((_BASE + joints + 4 * len(points), size))
        self._motion, self._A, self._C = rows[:nv], rows[:_BASE], rows[_BASE:]
        self._forces = [self._motion[:, nv + 3 * point : nv + 3 * point + 3] for point in points]
        self._pyramids = [rows[nv + 4 * k : nv + 4 * k + 4, nv + 3 * k : nv + 3 * k + 3] for k in points]
        self._b = np.zeros(_BASE)
        self._low = np.full(len(self._C), -_INFINITY)
        self._high = np.zeros(len(self._C))
        self._box_low = np.full(size, -_INFINITY)
        self._box_high = np.full(size, _INFINITY)
        self.friction = params.friction
        self._contact = [True] * len(CONTACT_POINTS)
        self._box_low[nv + 2 :: 3], self._box_high[nv + 2 :: 3] = 0.0, params.max_normal_force
        self._joints_high, self._joints_low = self._box_high[self._joints], self._box_low[self._joints]
        self.reset()

    def reset(self) -> None:
        """Forget the previous solution, so that the next solve starts cold."""
        self._solver = proxqp.dense.QP(len(self._g), _BASE, len(self._low), True)
        settings = self._solver.settings
        settings.eps_abs = self._params.qp_tolerance
        settings.default_rho = _PROXIMAL_WEIGHT
        settings.max_iter = self._params.qp_max_iterations
        # The default inner bound of 1500 lets an infeasible problem run for seconds.
        settings.max_iter_in = _INNER_ITERATIONS
        # The default declares feasible problems infeasible when a contact switch leaves the warm start far away.
        settings.eps_primal_inf = settings.eps_dual_inf = _INFEASIBILITY_TOLERANCE
        settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
        self._started = False

    def solve(
        self,
        dynamics: Dynamics,
        terms: Sequence[TaskTerms],
        contact: np.ndarray,
        planned: np.ndarray | None = None,
        heading: float = 0.0,
    ) -> QpSolution:
        """Solve for the accelerations, forces and torques that serve the tasks best.

        Args:
            dynamics: robot model at the current state.
            terms: rows of every task.
            contact: whether the ground may push at each of `CONTACT_POINTS`, shape (4,), bool.
            planned: forces f* to stay close to, world axes [N], shape (4, 3); with None, f* = 0 with a tiny weight.
            heading: direction of the robot and of the pyramids' first axis [rad]: what the robot can do does not depend
                on where it faces.
        """
        self._fill_contact(contact)
        self._fill_friction(heading)
        self._fill_cost(terms, planned)
        self._fill_dynamics(dynamics)
        self._fill_joint_limits(dynamics)
        status = QpStatus.SOLVED
        solved, x = self._run()
        if not solved:
            status = QpStatus.RELAXED
            # A failed solve leaves a useless warm start: start cold.
            self._joints_low[:], self._joints_high[:] = -_INFINITY, _INFINITY
            self.reset()
            solved, x = self._run()
        # Multiplied by the solution, the equation of motion gives the torques without the bias.
        nv = self._nv
        torque = (self._motion.dot(x) + dynamics.bias)[self._columns]
        if not solved or not math.isfinite(torque.dot(torque)):
            self.reset()
            status = QpStatus.FAILED
        forces = x[nv:].reshape(-1, 3)
        forces *= contact[:, None]  # in the air they are zero up to the solver's tolerance
        return QpSolution(status, x[:nv], forces, torque)

    def _fill_cost(self, terms: Sequence[TaskTerms], planned: np.ndarray | None) -> None:
        """Fill H = J^T W J + regularisation and g = J^T W (drift - acceleration) from all tasks at once."""
        jacobians, drifts, accelerations, weights = zip(*terms, strict=True)
        jacobian = np.concatenate(jacobians)
        # One concatenation of many small arrays takes hardly longer than one of a third as many.
        drift, acceleration, weight = np.concatenate((*drifts, *accelerations, *weights)).reshape(3, -1)
        lacking = drift - acceleration
        np.minimum(np.maximum(lacking, -_LARGEST_DEMAND, out=lacking), _LARGEST_DEMAND, out=lacking)
        weighted = jacobian * weight[:, None]
        params, nv = self._params, self._nv
        stiffness = params.force_regularisation if planned is None else params.planned_force_weight
        self._H[:nv, :nv] = np.matmul(jacobian.T, weighted)
        self._diagonal[:nv] += params.acceleration_regularisation
        self._diagonal[nv:] = stiffness
        self._g[:nv], self._g[nv:] = lacking.dot(weighted), 0.0
        if planned is not None:
            self._g[nv:].reshape(-1, 3)[self._contact] = -stiffness * planned[self._contact]

    def _fill_dynamics(self, dynamics: Dynamics) -> None:
        """Fill the equation of motion, M dv/dt - J^T f = torque - bias, and the torque bounds."""
        for columns, stands, name in zip(self._forces, self._contact, CONTACT_POINTS, strict=True):
            if stands:
                np.negative(dynamics.point_jacobian(name).T, out=columns)
        self._motion[:, : self._nv] = dynamics.M
        self._b[:] = -dynamics.bias[:_BASE]
        torque, bias = self._highest_torque, dynamics.bias[_BASE:]
        self._low[: bias.size], self._high[: bias.size] = -torque - bias, torque - bias

    def _fill_contact(self, contact: np.ndarray) -> None:
        """Switch the effect and the bounds of the forces whose contact has changed."""
        now = contact.tolist()
        if now == self._contact:
            return
        self._contact = now
        for point, stands in enumerate(now):
            normal, friction = self._nv + 3 * point + 2, len(self._highest_torque) + 4 * point
            self._box_low[normal] = 0.0 if stands else -_INFINITY
            self._box_high[normal] = self._params.max_normal_force if stands else _INFINITY
            self._high[friction : friction + 4] = 0.0 if stands else _INFINITY
            if not stands:
                self._forces[point][:] = 0.0

    def _fill_friction(self, heading: float) -> None:
        """Fill the friction pyramids, whose axes are those of the heading."""
        turned = friction_pyramid(self.friction).dot(rotation_z(-heading))
        for rows in self._pyramids:
            rows[:] = turned

    def _fill_joint_limits(self, dynamics: Dynamics) -> None:
        """Bound each joint's acceleration so that the joint can still brake before its limit and keeps its speed limit.

        A joint at a distance d [rad] from its limit may move towards it at most at sqrt(2 a d), with a the assumed
        braking deceleration, and at most at d per `joint_horizon`: close to the limit the square root falls too steeply
        to be followed in discrete time. A joint beyond its limit has to come back within that horizon.

        The speed limit may be reached within the shorter `speed_horizon`: an approach over `joint_horizon` would keep a
        joint from its highest speed for most of a fast swing. A joint that is too fast slows down within
        `joint_horizon`, so that the bound does not ask for more torque than there is.
        """
        brake, horizon = self._params.joint_brake, self._params.joint_horizon
        q, v = dynamics.q[7:], dynamics.v[self._joints]
        # First rows: towards the upper limit; second rows: towards the lower one.
        left, spare = np.array((self._highest - q, q - self._lowest)), np.array((self._fastest - v, self._fastest + v))
        speed = np.minimum(np.sqrt(np.maximum(2.0 * brake * left, 0.0)), left / horizon)
        braking = (speed - np.array((v, -v))) / horizon
        most = np.minimum(braking, spare / np.where(spare > 0.0, self._params.speed_horizon, horizon))
        self._joints_high[:], self._joints_low[:] = most[0], -most[1]

    @property
    def problem(self) -> tuple[np.ndarray, ...]:
        """H, g, A, b, C, the bounds of C x (lower, upper) and those of x (lower, upper), as last solved."""
        return self._H, self._g, self._A, self._b, self._C, self._low, self._high, self._box_low, self._box_high

    def _run(self) -> tuple[bool, np.ndarray]:
        """Solve, and return whether that succeeded and the solution."""
        solver = self._solver
        if self._started:
            solver.update(*self.problem, False)
        else:
            solver.init(*self.problem)
            self._started = True
        solver.solve()
        results = solver.results
        x = np.array(results.x)
        return results.info.status == proxqp.PROXQP_SOLVED and math.isfinite(x.dot(x)), x

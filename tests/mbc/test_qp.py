import dataclasses

import numpy as np
import pinocchio as pin
import pytest
import qpsolvers

from hugwbc import Command, Gait, UpperBody, load_robot
from hugwbc.mbc import WholeBodyController
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.qp import CONTACT_POINTS, QpStatus, WholeBodyQp
from hugwbc.mbc.tasks import TaskTerms
from hugwbc.rotations import rotation_z
from hugwbc.sim import Simulation

ROBOT = load_robot()
ALL = np.ones(4, dtype=bool)


def _random_terms(rng, demand):
    return TaskTerms(rng.normal(size=(31, 25)), np.zeros(31), rng.uniform(-demand, demand, 31), rng.uniform(1, 100, 31))


def _qp(dynamics, **changes):
    return WholeBodyQp(ControllerParams(**changes), ROBOT, dynamics.nv, dynamics.columns)


def _residual(dynamics, solution):
    """Torques of all generalised coordinates by recursive Newton-Euler, less what the ground does."""
    total = pin.rnea(dynamics.model, dynamics.model.createData(), dynamics.q, dynamics.v, solution.acceleration)
    for name, force in zip(CONTACT_POINTS, solution.forces, strict=True):
        total = total - dynamics.frame(name).jacobian[:3].T @ force
    total[6:] += ROBOT.damping * dynamics.v[6:]
    return total


def test_solutions_obey_physics_and_limits(random_state):
    rng = np.random.default_rng(0)
    dynamics = Dynamics(load_robot())
    qp = _qp(dynamics)
    for _ in range(40):
        dynamics.update(random_state(rng))
        contact = rng.random(4) < 0.7
        solution = qp.solve(dynamics, [_random_terms(rng, 5)], contact)
        assert solution.status is not QpStatus.FAILED
        residual = _residual(dynamics, solution)
        assert residual[:6] == pytest.approx(np.zeros(6), abs=1e-3)
        assert residual[dynamics.columns] == pytest.approx(solution.torque, abs=1e-6)
        assert np.all(np.abs(solution.torque) <= 0.95 * ROBOT.torque_limit + 1e-3)
        horizontal = np.linalg.norm(solution.forces[:, :2], axis=1)
        assert np.all(horizontal <= 0.7 * solution.forces[:, 2] + 1e-3)
        assert np.all(solution.forces[:, 2] >= -1e-3)
        assert np.all(solution.forces[~contact] == 0.0)


@pytest.mark.parametrize("heading", [0.0, 0.6])
def test_the_friction_pyramid_turns_with_the_robot(random_state, heading: float) -> None:
    """What a robot can do must not depend on the compass."""
    rng = np.random.default_rng(3)
    dynamics, turn = Dynamics(load_robot()), rotation_z(-heading)
    qp, farthest = _qp(dynamics), 0.0
    for _ in range(20):
        dynamics.update(random_state(rng))
        forces = qp.solve(dynamics, [_random_terms(rng, 50)], ALL, heading=heading).forces @ turn.T
        bound = 0.7 / np.sqrt(2.0) * forces[:, 2:]
        assert np.all(np.abs(forces[:, :2]) <= bound + 1e-3)
        farthest = max(farthest, np.max(np.abs(forces @ rotation_z(0.3).T)[:, :2] - bound))
    assert farthest > 1.0, "otherwise no pyramid has bound anything"


def test_without_active_limits_it_is_the_equality_constrained_least_squares_solution(dynamics_of):
    dynamics = dynamics_of()
    rng = np.random.default_rng(1)
    # Ask for accelerations near zero of everything: standing still, far from every limit.
    jacobian, weight = np.eye(25), rng.uniform(10, 100, 25)
    target = rng.uniform(-0.05, 0.05, 25)
    terms = TaskTerms(jacobian, np.zeros(25), target, weight)
    solution = _qp(dynamics, qp_tolerance=1e-9).solve(dynamics, [terms], ALL)

    points = np.vstack([dynamics.frame(name).jacobian[:3] for name in CONTACT_POINTS])
    cost = np.diag(np.concatenate((weight + 1e-3, np.full(12, 1e-5))))
    equality = np.hstack((dynamics.M[:6], -points[:, :6].T))
    kkt = np.block([[cost, equality.T], [equality, np.zeros((6, 6))]])
    right = np.concatenate((weight * target, np.zeros(12), -dynamics.bias[:6]))
    expected = np.linalg.solve(kkt, right)
    assert solution.status is QpStatus.SOLVED
    assert solution.acceleration == pytest.approx(expected[:25], abs=1e-5)
    assert solution.forces.ravel() == pytest.approx(expected[25:37], abs=1e-2)
    assert np.sum(solution.forces[:, 2]) == pytest.approx(dynamics.mass * 9.81, rel=0.02)


def test_a_joint_brakes_before_its_limit(dynamics_of):
    knee = ROBOT.index("left_knee_joint")
    dq = np.zeros(19)
    dq[knee] = 10.0
    q = ROBOT.nominal.copy()
    q[knee] = ROBOT.upper[knee] - 0.05
    dynamics = dynamics_of(q=q, dq=dq)
    wanted = np.zeros(25)
    wanted[dynamics.columns[knee]] = 200.0
    terms = TaskTerms(np.eye(25), np.zeros(25), wanted, np.ones(25))
    solution = _qp(dynamics).solve(dynamics, [terms], np.zeros(4, dtype=bool))
    assert solution.status is QpStatus.SOLVED
    # 0.03 rad before the margin at 10 rad/s: it has to slow down, although the task asks it to speed up.
    assert solution.acceleration[dynamics.columns[knee]] < -100.0


def test_a_stuck_waist_leaves_the_limits_of_the_others(dynamics_of):
    """As the how-to makes one for a robot without a waist: its range is smaller than both margins."""
    knee, stuck = ROBOT.index("left_knee_joint"), 1e-3 * (np.arange(19) == ROBOT.waist)
    robot = dataclasses.replace(
        ROBOT, lower=np.where(stuck, -stuck, ROBOT.lower), upper=np.where(stuck, stuck, ROBOT.upper)
    )
    q = ROBOT.nominal.copy()
    q[knee] = ROBOT.upper[knee] - 0.05
    dynamics = dynamics_of(q=q, dq=10.0 * (np.arange(19) == knee))
    terms = TaskTerms(np.eye(25), np.zeros(25), np.zeros(25), np.ones(25))
    qp = WholeBodyQp(ControllerParams(), robot, dynamics.nv, dynamics.columns)
    solution = qp.solve(dynamics, [terms], np.zeros(4, dtype=bool))
    assert solution.status is QpStatus.SOLVED
    assert solution.acceleration[dynamics.columns[knee]] < -100.0


def test_infeasible_joint_limits_are_dropped_and_said_so(standing_state):
    dynamics = Dynamics(load_robot())
    # Far beyond the limit and speeding outwards with all joints: no torque within the limits brakes that at once.
    dynamics.update(dataclasses.replace(standing_state, q=ROBOT.upper + 0.5, dq=np.full(19, 100.0)))
    qp = _qp(dynamics)
    terms = TaskTerms(np.eye(25), np.zeros(25), np.zeros(25), np.ones(25))
    solution = qp.solve(dynamics, [terms], ALL)
    assert solution.status is QpStatus.RELAXED
    assert np.all(np.abs(solution.torque) <= ROBOT.torque_limit * (1.0 + 1e-3))
    # The next ordinary problem is solved as if nothing had happened.
    dynamics.update(standing_state)
    assert qp.solve(dynamics, [terms], ALL).status is QpStatus.SOLVED


def _solve_with_daqp(qp):
    H, g, A, b, C, low, high, box_low, box_high = qp.problem
    # The solvers of qpsolvers expect every row to have a finite bound.
    eye = np.eye(g.size)
    lower, upper, above, below = low > -1e19, high < 1e19, box_low > -1e19, box_high < 1e19
    rows = np.vstack((C[upper], -C[lower], eye[below], -eye[above]))
    limits = np.concatenate((high[upper], -low[lower], box_high[below], -box_low[above]))
    return qpsolvers.solve_qp(H, g, rows, limits, A, b, solver="daqp")


def test_another_algorithm_agrees_where_limits_bind(random_state):
    """Friction, torque limits and joint ranges at their bounds, as a fast swing has them."""
    rng, dynamics, bound = np.random.default_rng(0), Dynamics(load_robot()), 0
    qp = _qp(dynamics, qp_tolerance=1e-9, qp_max_iterations=200)
    for _ in range(40):
        dynamics.update(random_state(rng))
        solution = qp.solve(dynamics, [_random_terms(rng, 30)], rng.random(4) < 0.7)
        if solution.status is not QpStatus.SOLVED:
            continue
        other = _solve_with_daqp(qp)
        scale = np.max(np.abs(solution.acceleration))
        assert np.max(np.abs(other[:25] - solution.acceleration)) < 1e-4 * scale
        # How two feet share a load hardly matters to the cost, so that the costs are compared and not the forces.
        H, g = qp.problem[:2]
        mine, best = (0.5 * x @ H @ x + g @ x for x in (np.append(solution.acceleration, solution.forces), other))
        assert abs(mine - best) < 1e-6 * abs(best)
        bound += bool(np.any(np.abs(solution.torque) > 0.999 * 0.95 * ROBOT.torque_limit))
    assert bound > 10


def test_controllers_whose_memory_lies_elsewhere_give_the_same_torques():
    between, controllers = [], []
    for index in range(4):
        between.append(bytearray(17 * index + 1))
        controllers.append(WholeBodyController(load_robot()))
    simulation = Simulation()
    state, command = simulation.state(), Command(v_x=0.5, gait=Gait.WALKING)
    for controller in controllers:
        controller.reset(state)
    for _ in range(60):
        outputs = [controller.act(state, command, UpperBody.none()) for controller in controllers]
        for output in outputs[1:]:
            np.testing.assert_array_equal(output.tau, outputs[0].tau)
            np.testing.assert_array_equal(output.dq, outputs[0].dq)
        state = simulation.step(outputs[0], controllers[0].period)

import dataclasses

import numpy as np
import pytest

from hugwbc.benchmarks import qp_side_by_side
from hugwbc.benchmarks.qp_side_by_side import side_by_side, solve_with_qpsolvers
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.qp import QpStatus, WholeBodyQp
from hugwbc.mbc.tasks import TaskTerms


def _check(states):
    result = side_by_side(states, seed=3)
    assert result.states == result.solved == states
    assert result.compared_with_placo > states // 2
    assert result.torque_difference_placo < 1e-4
    assert result.acceleration_difference_placo < 1e-4
    assert result.solution_difference_other is not None and result.solution_difference_other < 1e-4
    assert set(result.time_ms) == {"whole-body QP", "whole-body QP, tight", "placo", "daqp"}


def test_placo_and_another_algorithm_find_the_same_motion():
    _check(40)


@pytest.mark.slow
def test_a_thousand_states_side_by_side():
    _check(1000)


def test_the_comparison_sees_another_robot(monkeypatch):
    """With a joint that turns a little heavier in placo's robot, the solutions are no longer the same."""
    built = qp_side_by_side.placo_robot

    def heavier(robot):
        wrapper = built(robot)
        armature = wrapper.model.armature.copy()
        armature[9] += 0.01
        wrapper.model.armature = armature
        return wrapper

    monkeypatch.setattr(qp_side_by_side, "placo_robot", heavier)
    assert side_by_side(10, other=None).torque_difference_placo > 1e-4


def test_another_algorithm_agrees_where_limits_bind(random_problem):
    """Friction, torque limits and joint ranges at their bounds, as a fast swing has them."""
    bound = 0
    for qp, dynamics, terms, contact in random_problem(40):
        solution = qp.solve(dynamics, [terms], contact)
        if solution.status is not QpStatus.SOLVED:
            continue
        other = solve_with_qpsolvers(qp, "daqp")
        scale = np.max(np.abs(solution.acceleration))
        assert np.max(np.abs(other[:25] - solution.acceleration)) < 1e-4 * scale
        # How two feet share a load hardly matters to the cost, so that the costs are compared and not the forces.
        H, g = qp.problem[:2]
        mine, best = (0.5 * x @ H @ x + g @ x for x in (np.append(solution.acceleration, solution.forces), other))
        assert abs(mine - best) < 1e-6 * abs(best)
        limit = 0.95 * dynamics.robot.torque_limit
        bound += bool(np.any(np.abs(solution.torque) > 0.999 * limit))
    assert bound > 10


@pytest.fixture
def random_problem():
    from hugwbc.mbc.dynamics import Dynamics

    def make(count):
        rng, dynamics = np.random.default_rng(0), Dynamics()
        params = dataclasses.replace(ControllerParams(), qp_tolerance=1e-9, qp_max_iterations=200)
        qp = WholeBodyQp(params, dynamics.robot, dynamics.nv, dynamics.columns)
        for _ in range(count):
            dynamics.update(qp_side_by_side.random_state(dynamics.robot, rng))
            rows = rng.uniform(-30, 30, 31), rng.uniform(1, 100, 31)
            terms = TaskTerms(rng.normal(size=(31, 25)), np.zeros(31), *rows, np.zeros(31))
            yield qp, dynamics, terms, rng.random(4) < 0.7

    return make

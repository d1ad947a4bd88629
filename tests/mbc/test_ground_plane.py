"""The ground from feet that stand on a slope in the simulation."""

import dataclasses
import math

import numpy as np
import pytest

from hugwbc import JointCommand, load_robot
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.ground_plane import Ground
from hugwbc.sim import Simulation, rough_terrain

ROBOT = load_robot()
SLOPE, YAW = 0.1, 0.4
BOTH = np.ones(2, dtype=bool)


@pytest.fixture(scope="module")
def standing_on_a_slope():
    simulation = Simulation(terrain=rough_terrain(0.0, np.random.default_rng(0), slope=SLOPE))
    simulation.reset(yaw=YAW)
    return simulation.step(JointCommand.position(ROBOT, simulation.data.qpos[7:].copy()), 0.15)


def _dynamics(state):
    dynamics = Dynamics()
    dynamics.update(state)
    return dynamics


def test_resting_soles_tell_the_slope_under_them(standing_on_a_slope):
    ground, dynamics = Ground(), _dynamics(standing_on_a_slope)
    for _ in range(100):
        ground.update(dynamics, BOTH, YAW, 0.002)
    assert ground.resting.all()
    assert ground.slopes == pytest.approx(np.full(2, -math.atan(math.tan(SLOPE) * math.cos(YAW))), abs=0.01)


def test_the_plane_through_the_stances_has_the_slope_of_the_ground_less_the_ridge(standing_on_a_slope):
    ground, dynamics = Ground(), _dynamics(standing_on_a_slope)
    ground.update(dynamics, BOTH, YAW, 0.002)
    for _ in range(3):
        for foot in (0, 1):
            ground.note(dynamics, foot)
    # Along the feet their ends spread by 6 * 2 * 0.15^2 = 0.27 m^2, so that the ridge takes a tenth.
    along, lost = np.array([math.cos(YAW), math.sin(YAW)]), 0.27 / (0.27 + 0.03)
    assert ground.gradient @ along == pytest.approx(math.tan(SLOPE) * math.cos(YAW) * lost, rel=0.1)
    assert ground.slope_along(YAW) == pytest.approx(-math.atan(ground.gradient @ along))
    assert ground.rise(np.array([1.0, 2.0, 0.0]), np.array([1.5, 2.5])) == pytest.approx(0.5 * ground.gradient.sum())


def test_a_foot_touches_by_its_load_and_one_in_the_air_expects_the_plane(standing_on_a_slope):
    force = np.array([[0.0, 0.0, 300.0], [0.0, 0.0, 5.0]])
    ground, dynamics = Ground(), _dynamics(dataclasses.replace(standing_on_a_slope, foot_force=force))
    ground.gradient[:] = [0.2, 0.0]
    ground.update(dynamics, np.array([True, False]), 0.0, 0.002)
    assert (ground.touched(dynamics, 0), ground.touched(dynamics, 1)) == (True, False)
    assert ground.slopes[1] == pytest.approx(-math.atan(0.2))
    assert ground.resting.tolist() == [True, False]


def test_without_foot_forces_the_ground_is_level(standing_on_a_slope):
    ground, dynamics = Ground(), _dynamics(dataclasses.replace(standing_on_a_slope, foot_force=None))
    ground.update(dynamics, BOTH, YAW, 0.002)
    ground.note(dynamics, 0)
    assert ground.touched(dynamics, 0) is None
    assert not ground.resting.any() and not ground.slopes.any() and not ground.gradient.any()


def test_a_foot_that_turns_does_not_rest(standing_on_a_slope):
    dq = standing_on_a_slope.dq.copy()
    dq[ROBOT.index("left_ankle_joint")] = 2.0
    ground, dynamics = Ground(), _dynamics(dataclasses.replace(standing_on_a_slope, dq=dq))
    ground.update(dynamics, BOTH, YAW, 0.002)
    assert ground.resting.tolist() == [False, True]

"""Geometry of the feet, the ground from feet that stand on a slope in the simulation, and slips."""

import dataclasses
import math

import numpy as np
import pytest

from hugwbc import Command, Gait, JointCommand, load_robot, rotations
from hugwbc.mbc import WholeBodyController, feet
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.feet import SlipWatch
from hugwbc.runtime import Constant, rollout
from hugwbc.sim import Simulation, Variation, rough_terrain

ROBOT = load_robot()
SLOPE, YAW = 0.1, 0.4
BOTH = np.ones(2, dtype=bool)
DT = 0.004
LOAD = np.array([[30.0, 40.0, 300.0], [0.0, 0.0, 0.0]])


@pytest.mark.parametrize("foot", [0, 1])
def test_the_pivot_is_ahead_of_the_ankle_on_the_ground_and_tells_where_the_sole_is(dynamics_of, foot):
    side = ("left", "right")[foot]
    dynamics = dynamics_of(0.7, joints={f"{side}_hip_yaw": 0.2})
    sole = dynamics.frame(f"{side}_sole")
    forward = sole.rotation[:2, 0]  # the foot leans by 0.02 rad: a little shorter than 1
    pivot = feet.pivot(dynamics, foot, 0.03)
    ankle = dynamics.position(f"{side}_ankle_link")[:2]
    assert (pivot[:2] - ankle) @ forward == pytest.approx(0.03, abs=2e-3)
    assert pivot[2] == sole.position[2] == feet.sole_height(dynamics, foot)
    yaw = float(np.arctan2(forward[1], forward[0]))
    assert feet.sole_about(pivot[:2], yaw, 0.03, dynamics.robot) == pytest.approx(sole.position[:2], abs=1e-12)


def test_the_heading_of_the_feet_is_their_mean_also_where_angles_wrap(dynamics_of):
    dynamics = dynamics_of(3.1, joints={"left_hip_yaw": 0.3, "right_hip_yaw": 0.1})
    assert float(rotations.wrap_angle(feet.feet_yaw(dynamics) - 3.3)) == pytest.approx(0.0, abs=5e-3)


def test_a_foot_that_points_down_has_its_toe_lower_than_its_heel(dynamics_of):
    heel, toe = feet.end_heights(dynamics_of(joints={"left_ankle": 0.2}), 0)
    length = ROBOT.sole_x[1] - ROBOT.sole_x[0]
    assert heel - toe == pytest.approx(length * np.sin(0.2), abs=1e-3)


@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_a_lifted_sole_is_level_or_on_the_slope_until_the_shank_leans_too_far(dynamics_of, yaw):
    to_heading = rotations.rotation_z(-yaw)[:2, :2]
    upright = dynamics_of(yaw)
    assert feet.swing_pitch(upright, 0, to_heading) == 0.0
    assert feet.swing_pitch(upright, 0, to_heading, slope=-0.1) == -0.1
    # The shank leans by hip pitch and knee together, of which the ankle takes 0.8 rad: -0.4 + 0.8 + 0.6 - 0.8.
    leaning = dynamics_of(yaw, joints={"left_knee": 0.6})
    assert feet.swing_pitch(leaning, 0, to_heading) == pytest.approx(0.2, abs=1e-3)


@pytest.fixture(scope="module")
def standing_on_a_slope():
    simulation = Simulation(terrain=rough_terrain(0.0, np.random.default_rng(0), slope=SLOPE))
    simulation.reset(yaw=YAW)
    return simulation.step(JointCommand.position(ROBOT, simulation.data.qpos[7:].copy()), 0.15)


def _updated(state):
    dynamics = Dynamics(load_robot())
    dynamics.update(state)
    return dynamics


def test_resting_soles_tell_the_slope_under_them(standing_on_a_slope):
    ground, dynamics = feet.Ground(), _updated(standing_on_a_slope)
    for _ in range(100):
        ground.update(dynamics, BOTH, YAW, 0.002)
    assert ground.resting.all()
    assert ground.slopes == pytest.approx(np.full(2, -math.atan(math.tan(SLOPE) * math.cos(YAW))), abs=0.01)


def test_the_plane_through_the_stances_has_the_slope_of_the_ground_less_the_ridge(standing_on_a_slope):
    ground, dynamics = feet.Ground(), _updated(standing_on_a_slope)
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
    ground, dynamics = feet.Ground(), _updated(dataclasses.replace(standing_on_a_slope, foot_force=force))
    ground.gradient[:] = [0.2, 0.0]
    ground.update(dynamics, np.array([True, False]), 0.0, 0.002)
    assert (ground.touched(dynamics, 0), ground.touched(dynamics, 1)) == (True, False)
    assert ground.slopes[1] == pytest.approx(-math.atan(0.2))
    assert ground.resting.tolist() == [True, False]


def test_the_noise_of_an_inferred_load_is_no_landing(standing_on_a_slope):
    """Loads of swinging feet that are inferred from joint torques stay below 50 N in 99 % of the time."""
    force = np.array([[0.0, 0.0, 50.0], [0.0, 0.0, 200.0]])
    ground, dynamics = feet.Ground(), _updated(dataclasses.replace(standing_on_a_slope, foot_force=force))
    assert (ground.touched(dynamics, 0), ground.touched(dynamics, 1)) == (False, True)
    assert ground.carries(dynamics, 0) and ground.carries(dynamics, 1), "a foot that stands may be unloaded"


def test_without_foot_forces_the_ground_is_level(standing_on_a_slope):
    ground, dynamics = feet.Ground(), _updated(dataclasses.replace(standing_on_a_slope, foot_force=None))
    ground.update(dynamics, BOTH, YAW, 0.002)
    ground.note(dynamics, 0)
    assert ground.touched(dynamics, 0) is None
    assert not ground.resting.any() and not ground.slopes.any() and not ground.gradient.any()


def test_a_foot_that_turns_does_not_rest(standing_on_a_slope):
    dq = standing_on_a_slope.dq.copy()
    dq[ROBOT.index("left_ankle_joint")] = 2.0
    ground, dynamics = feet.Ground(), _updated(dataclasses.replace(standing_on_a_slope, dq=dq))
    ground.update(dynamics, BOTH, YAW, 0.002)
    assert ground.resting.tolist() == [False, True]


def after(watch, speed, seconds, load=LOAD, dt=DT):
    """Let the left sole move at a speed for some time."""
    for _ in range(round(seconds / dt)):
        watch.update(np.array([[0.0, speed], [0.0, 0.0]]), load, dt)
    return watch


@pytest.mark.parametrize(
    ("speed", "seconds", "load"),
    [
        (0.2, 2.0, LOAD),  # as every sole moves a little
        (0.8, 0.012, LOAD),  # a slide at a touch-down
        (3.0, 0.5, [[0.0, 5.0, 50.0], [30.0, 40.0, 300.0]]),  # a sole without load
        (1.0, 0.5, [[0.0, 180.0, 300.0], [0.0, 0.0, 0.0]]),  # against much friction: on good ground
    ],
)
def test_what_is_no_slip_leaves_all_friction(speed, seconds, load):
    watch = after(SlipWatch(0.7, 582.0), speed, seconds, np.array(load))
    assert (watch.friction, watch.fastest) == (0.7, math.inf)


def test_one_reading_of_a_slow_controller_is_no_slip_and_several_are():
    watch = after(SlipWatch(0.7, 582.0), 0.8, 0.02, dt=0.02)  # of a sole that touches down
    assert after(watch, 0.0, 0.4, dt=0.02).friction == 0.7
    assert after(watch, 0.8, 0.1, dt=0.02).friction < 0.3


def test_good_ground_that_was_taken_for_slippery_is_soon_good_again():
    watch = after(SlipWatch(0.7, 582.0), 0.47, 0.2)
    assert after(watch, 0.0, 10.0).friction == 0.7
    # What slips a second time is slippery: the friction rises slowly from below that.
    after(after(after(watch, 0.47, 0.2), 0.0, 7.0), 0.47, 0.2)
    assert after(watch, 0.0, 20.0).friction < 0.6


def test_a_slip_lowers_the_friction_and_the_speed_until_the_ground_holds():
    watch = after(SlipWatch(0.7, 582.0), 0.47, 0.2)
    assert watch.friction == pytest.approx(0.21)
    assert watch.fastest < 0.6
    low = watch.friction
    assert low < after(watch, 0.0, 5.0).friction < 0.7
    assert after(watch, 0.0, 60.0).friction == 0.7
    watch = after(SlipWatch(0.7, 582.0), 2.0, 5.0)
    assert watch.friction > 0.0
    watch.reset()
    assert watch.friction == 0.7


@pytest.mark.parametrize("friction", [0.8, 0.3])
def test_it_walks_on_good_and_on_slippery_ground(friction):
    controller = WholeBodyController(load_robot())
    simulation = Simulation(variation=Variation(friction=friction), seed=5)
    trace = rollout(controller, Constant(Command(v_x=0.5, gait=Gait.WALKING)), simulation, duration=3.0)
    assert not trace.fell
    found = controller.diagnostics.friction
    assert found == 0.7 if friction == 0.8 else found < 0.3

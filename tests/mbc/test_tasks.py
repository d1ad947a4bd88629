"""Every task: its Jacobian and drift against finite differences, its law at hand-computed points."""

import dataclasses

import numpy as np
import pytest

from hugwbc import load_robot, rotations
from hugwbc.mbc import tasks
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.params import ControllerParams

PARAMS = ControllerParams()
ROBOT = load_robot()
STEP = 1e-6


def _each_task():
    """One of each task, with headings that are not the axes of the world."""
    com, travel, orientation = (
        kind(PARAMS) for kind in (tasks.CentreOfMassTask, tasks.PelvisTravelTask, tasks.PelvisOrientationTask)
    )
    com.heading, travel.heading, orientation.yaw = 0.7, -1.2, 2.0
    feet = tasks.SwingFootTask(PARAMS, "right", ROBOT), tasks.StanceContactTask(PARAMS, "left", ROBOT)
    posture = tasks.PostureTask(np.array([ROBOT.waist, *ROBOT.arms]), 10.0)
    plain = [tasks.PelvisHeightTask, tasks.AngularMomentumTask, tasks.CentreOfMassMotionTask]
    return [com, travel, orientation, *feet, posture, *(kind(PARAMS) for kind in plain)]


def test_task_velocities_change_by_jacobian_times_acceleration_plus_drift(random_state, moved):
    rng = np.random.default_rng(1)
    here, there = Dynamics(load_robot()), Dynamics(load_robot())
    for _ in range(5):
        state = random_state(rng)
        here.update(state)
        spin, acceleration = state.angular_velocity, rng.uniform(-3, 3, 25)
        joints = acceleration[here.columns]
        # dv/dt of the base is the rate of its velocity in the base frame: R (a + w x v) in the world.
        linear = rotations.rotate(state.orientation, acceleration[:3] + np.cross(spin, here.v[:3]))
        world_velocity = np.concatenate((state.velocity, spin, state.dq))
        later = dataclasses.replace(
            moved(state, world_velocity, STEP),
            velocity=state.velocity + linear * STEP,
            angular_velocity=spin + acceleration[3:6] * STEP,
            dq=state.dq + joints * STEP,
        )
        there.update(later)
        for task in _each_task():
            before, after = task.evaluate(here), task.evaluate(there)
            rate = (after.jacobian @ there.v - before.jacobian @ here.v) / STEP
            expected = before.jacobian @ acceleration + before.drift
            assert rate == pytest.approx(expected, abs=1e-4, rel=1e-5), type(task).__name__


def test_height_law(dynamics_of):
    dynamics = dynamics_of()
    task = tasks.PelvisHeightTask(ControllerParams(height_gains=(100.0, 20.0)))
    task.target, task.rate = 0.93, -0.1
    # 100 (0.93 - 0.98) + 20 (-0.1 - 0) = -7
    assert task.evaluate(dynamics).acceleration == pytest.approx([-7.0])


def test_orientation_rows_are_roll_pitch_yaw_in_the_heading(dynamics_of):
    dynamics = dynamics_of(orientation=rotations.from_yaw_pitch_roll(2.0, 0.1, 0.0))
    task = tasks.PelvisOrientationTask(ControllerParams(orientation_gains=(100.0, 20.0)))
    task.yaw, task.pitch = 2.0, 0.3
    assert task.error(dynamics) == pytest.approx([0.0, 0.2, 0.0], abs=1e-12)
    assert task.evaluate(dynamics).acceleration == pytest.approx([0.0, 20.0, 0.0], abs=1e-9)


def test_centre_of_mass_law_along_and_across_the_heading(dynamics_of):
    """Along it is pulled to the target, across it only follows the plan; the heading is the world's y."""
    dynamics = dynamics_of(velocity=np.array([0.3, 0.2, 0.0]))
    task = tasks.CentreOfMassTask(ControllerParams(com_gains=(30.0, 10.0)))
    task.heading, task.servo, task.feedforward = np.pi / 2.0, np.array([1.0, 0.0]), np.array([0.5, 0.7])
    task.target = dynamics.com[:2] + np.array([0.05, 0.1])
    # 0.5 + 30 * 0.1 - 10 * 0.2 = 1.5
    assert task.evaluate(dynamics).acceleration == pytest.approx([1.5, 0.7])


def test_swing_foot_law(dynamics_of):
    dynamics = dynamics_of(velocity=np.array([0.0, 0.0, 0.1]))
    task = tasks.SwingFootTask(
        ControllerParams(swing_gains=(100.0, 10.0), swing_rotation_gains=(50.0, 5.0)), "left", load_robot()
    )
    foot = dynamics.frame("left_sole")
    task.position, task.velocity = foot.position + np.array([0.02, 0.0, 0.03]), np.array([0.0, 0.0, 0.4])
    task.acceleration, task.pitch = np.array([0.0, 1.0, 0.0]), 0.1
    task.yaw = float(np.arctan2(foot.rotation[1, 0], foot.rotation[0, 0]))
    acceleration = task.evaluate(dynamics).acceleration
    # x 100 * 0.02; y 1; z 100 * 0.03 + 10 (0.4 - 0.1)
    assert acceleration[:3] == pytest.approx([2.0, 1.0, 6.0])
    # The foot rolls by 0.02 rad, which turns a little of the pitch into yaw.
    assert acceleration[3:] == pytest.approx([50.0 * 0.1, 0.0], abs=0.1)


def test_a_standing_foot_is_stopped_and_one_in_the_air_settles(dynamics_of):
    dynamics = dynamics_of(velocity=np.array([0.1, 0.0, -0.05]))
    task = tasks.StanceContactTask(ControllerParams(contact_damping=30.0), "right", load_robot())
    assert task.evaluate(dynamics).acceleration[:3] == pytest.approx([-3.0, 0.0, 1.5])
    task.settle = 0.3
    assert task.evaluate(dynamics).acceleration[2] == pytest.approx(30.0 * (-0.3 + 0.05))


def test_a_gap_is_closed_at_a_bounded_speed(dynamics_of):
    dynamics = dynamics_of()
    task = tasks.PostureTask(ROBOT.arms, speed=2.0)
    task.stiffness[:], task.damping[:] = 100.0, 20.0
    task.target[0] = 3.0  # unbounded, 100 * 3 = 300
    assert task.evaluate(dynamics).acceleration[0] == pytest.approx(20.0 * 2.0)
    task.target[0] = 0.1
    assert task.evaluate(dynamics).acceleration[0] == pytest.approx(100.0 * 0.1)
    task.acceleration[0] = 3.0
    assert task.evaluate(dynamics).acceleration[0] == pytest.approx(3.0 + 100.0 * 0.1)


def test_line_contact_has_no_roll_row(dynamics_of):
    dynamics = dynamics_of()
    roll = np.zeros(dynamics.nv)
    roll[dynamics.columns[ROBOT.index("left_hip_roll_joint")]] = 1.0
    terms = tasks.StanceContactTask(PARAMS, "left", load_robot()).evaluate(dynamics)
    assert terms.jacobian.shape[0] == 5
    # Turning the leg about x turns the foot about x: neither its pitch nor its yaw row sees it.
    assert (terms.jacobian @ roll)[3:] == pytest.approx([0.0, 0.0], abs=1e-9)


def test_under_a_plan_the_angular_momentum_follows_it_and_is_not_damped(dynamics_of):
    dynamics = dynamics_of(angular_velocity=np.array([0.0, 1.0, 0.0]))
    task = tasks.AngularMomentumTask(ControllerParams(momentum_damping=5.0))
    # The robot turns as one piece: its momentum is inertia times angular velocity.
    assert task.evaluate(dynamics).acceleration == pytest.approx(-5.0 * dynamics.inertia[:, 1])
    task.planned = np.array([1.0, 2.0, 3.0])
    assert task.evaluate(dynamics).acceleration == pytest.approx([1.0, 2.0, 3.0])


def test_a_standing_sole_is_turned_to_the_slope_of_the_ground(dynamics_of):
    dynamics = dynamics_of()
    task = tasks.StanceContactTask(ControllerParams(contact_pitch_stiffness=100.0), "left", load_robot())
    level = task.evaluate(dynamics).acceleration[3]
    task.slope = 0.05
    assert task.evaluate(dynamics).acceleration[3] - level == pytest.approx(100.0 * 0.05)

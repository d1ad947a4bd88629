"""Footholds and the single body of a leap, against Newton's laws and the whole robot's kinematics."""

import dataclasses

import numpy as np
import pytest

from hugwbc import Command, Gait, load_robot, rotations
from hugwbc.mbc.command_filter import CommandFilter, GaitState
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.feet import Ground
from hugwbc.mbc.gait_plan import GaitPlan
from hugwbc.mbc.leap import Leap
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.references import References, Tick

ROBOT = load_robot()
PARAMS = ControllerParams()
DT, GRAVITY, GROUND = 0.002, 9.81, 0.0
LEG = ("hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle")


def _command(gait):
    return CommandFilter(PARAMS, load_robot()).update(Command(gait=gait), DT, GaitState(running=gait))


def _foothold(dynamics, gait, plan, velocity, foot, yaw=0.0):
    """Where a foot should land on ground at a height of zero, with the robot heading along a yaw."""
    references = References(PARAMS, plan, Ground())
    references.yaw, references.ground = yaw, GROUND
    return Leap(PARAMS, plan, references, load_robot()).foothold(Tick(dynamics, _command(gait), velocity, DT), foot)


def _flying(gait, left):
    """A plan with so much time [s] left of a flight of 0.25 s."""
    plan = GaitPlan()
    while not plan.airborne or plan.remaining > left:
        plan.advance(gait, 2.0, DT, may_start=True, may_stop=False)
    return plan


def _dynamics(state, left, stance, horizontal, turning):
    """The robot turning as one piece, such that it lands with the vertical speed that a stance takes back [s], [s]."""
    dynamics = Dynamics(load_robot())
    fall = np.array([*horizontal, GRAVITY * (left - 0.5 * stance)])
    moving = dataclasses.replace(state, velocity=fall, angular_velocity=np.array(turning))
    dynamics.update(moving)
    lacking = fall - dynamics.com_velocity
    dynamics.update(dataclasses.replace(moving, velocity=fall + lacking))
    assert dynamics.com_velocity == pytest.approx(fall)
    return dynamics


def _after_stance(dynamics, foot, left, stance, wanted):
    """Angular momentum at take-off, if friction brings the velocity to the wanted one, by integration [kg m^2/s]."""
    com, velocity, mass = dynamics.com.copy(), dynamics.com_velocity.copy(), dynamics.mass
    com += velocity * left - 0.5 * GRAVITY * left**2 * np.array([0.0, 0.0, 1.0])
    velocity[2] -= GRAVITY * left
    pivot = np.array([*foot, GROUND])
    about_foot = dynamics.momentum + mass * np.cross(com - pivot, velocity)
    # Of all forces, only the weight has a moment about the foot.
    acceleration = np.array([*(wanted - velocity[:2]) / stance, GRAVITY])
    steps = 2000
    for _ in range(steps):
        middle = com + 0.5 * velocity * stance / steps
        about_foot += np.cross(middle - pivot, [0.0, 0.0, -mass * GRAVITY]) * stance / steps
        com += (velocity + 0.5 * acceleration * stance / steps) * stance / steps
        velocity += acceleration * stance / steps
    return about_foot - mass * np.cross(com - pivot, velocity)


@pytest.mark.parametrize(("gait", "foot"), [(Gait.HOPPING_LEFT, 0), (Gait.HOPPING_RIGHT, 1)])
@pytest.mark.parametrize("turning", [(0.4, 0.0, 0.0), (-0.2, 0.5, 0.0)])
def test_a_hop_lands_where_gravity_takes_the_angular_momentum_out(standing_state, gait, foot, turning):
    plan = _flying(gait, 0.1)
    left, stance, velocity = plan.remaining, plan.step_time, np.array([0.3, -0.1])
    dynamics = _dynamics(standing_state, left, stance, velocity, turning)
    assert np.abs(dynamics.momentum[:2]).max() > 2.0
    place = _foothold(dynamics, gait, plan, velocity, foot)
    # The foot's centre is inwards of the edge that it stands on.
    edge = place - [0.0, ROBOT.sole_y[1] * (-1.0 if foot == 0 else 1.0)]
    assert _after_stance(dynamics, edge, left, stance, velocity)[:2] == pytest.approx([0.0, 0.0], abs=0.05)


def test_a_hop_that_is_too_fast_is_slowed_by_its_place(standing_state):
    plan = _flying(Gait.HOPPING_LEFT, 0.1)
    left, stance, wanted = plan.remaining, plan.step_time, np.zeros(2)
    dynamics = _dynamics(standing_state, left, stance, (0.2, 0.0), (0.0, 0.0, 0.0))
    place = _foothold(dynamics, Gait.HOPPING_LEFT, plan, wanted, 0)
    edge = place + np.array([0.0, ROBOT.sole_y[1]])
    below = _after_stance(dynamics, dynamics.com[:2] + 0.2 * np.array([left + 0.5 * stance, 0.0]), left, stance, wanted)
    assert np.abs(below[1]) > 6.0, "kg m^2/s, were the foot where the centre of mass passes at its present speed"
    assert _after_stance(dynamics, edge, left, stance, wanted)[:2] == pytest.approx([0.0, 0.0], abs=0.05)


def test_a_jump_lands_on_both_sides_of_where_the_body_will_be(standing_state):
    plan, yaw = _flying(Gait.JUMPING, 0.1), 0.7
    turned = dataclasses.replace(standing_state, orientation=rotations.from_yaw_pitch_roll(yaw, 0.0, 0.0))
    dynamics = _dynamics(turned, plan.remaining, plan.step_time, (0.3, 0.4), (0.0, 0.0, 0.0))
    commanded = rotations.rotation_z(-yaw)[:2, :2] @ np.array([0.3, 0.4])
    feet = [_foothold(dynamics, Gait.JUMPING, plan, commanded, foot, yaw) for foot in range(2)]
    passed = dynamics.com[:2] + np.array([0.3, 0.4]) * (plan.remaining + 0.125)
    assert (feet[0] + feet[1]) / 2.0 == pytest.approx(passed)
    assert feet[0] - feet[1] == pytest.approx(PARAMS.leap_width * np.array([-np.sin(yaw), np.cos(yaw)]))


def test_the_feet_of_a_jump_push_for_whole_periods(standing_state):
    """Half a stride of 2.7 Hz lasts for 92.6 of them: the forces of a plan must end with the 93rd, and not before."""
    plan, dynamics = GaitPlan(), Dynamics(load_robot())
    dynamics.update(standing_state)
    leap = Leap(PARAMS, plan, References(PARAMS, plan, Ground()), load_robot())
    command, ends = _command(Gait.JUMPING), []
    for tick in range(500):
        if plan.advance(Gait.JUMPING, 2.7, DT, may_start=True, may_stop=False):
            break
        if plan.legs and plan.remaining > PARAMS.mpc_shortest_stance:
            leap.release()
            leap.push(Tick(dynamics, command, np.zeros(2), DT))
            ends.append(tick * DT + leap._force_plan.interval * PARAMS.mpc_intervals)
    assert len(ends) > 50 and ends == pytest.approx([tick * DT] * len(ends))


@pytest.mark.parametrize("gait", [Gait.JUMPING, Gait.HOPPING_RIGHT])
def test_the_single_body_has_the_angular_momentum_of_the_robot_on_feet_that_stay(standing_state, gait):
    """Any motion of the pelvis, the legs following so that the soles' line contacts do not move."""
    plan = GaitPlan()
    while not plan.legs:
        plan.advance(gait, 2.0, DT, may_start=True, may_stop=False)
    yaw, rng, dynamics = 0.5, np.random.default_rng(0), Dynamics(load_robot())
    bent = standing_state.q.copy()
    for side in ("left", "right"):
        bent[ROBOT.indices([f"{side}_{part}_joint" for part in ("hip_pitch", "knee", "ankle")])] += [-0.3, 0.6, -0.3]
    still = dataclasses.replace(standing_state, q=bent, orientation=rotations.from_yaw_pitch_roll(yaw, 0.1, 0.0))
    dynamics.update(still)
    to_heading = rotations.rotation_z(-yaw)
    leap = Leap(PARAMS, plan, References(PARAMS, plan, Ground()), load_robot())
    body = leap._body(dynamics, to_heading, np.zeros(3))
    for _ in range(3):
        velocity, spin = rng.uniform(-0.5, 0.5, (2, 3))  # world, pelvis
        dynamics.update(dataclasses.replace(still, velocity=velocity, angular_velocity=spin))
        joints = np.zeros(19)
        for foot in plan.legs:
            side = ("left", "right")[foot]
            leg = ROBOT.indices([f"{side}_{part}_joint" for part in LEG])
            sole = dynamics.frame(f"{side}_sole")
            rows = np.vstack((sole.jacobian[:3], sole.rotation[:, 1:].T @ sole.jacobian[3:]))
            joints[leg] = -np.linalg.solve(rows[:, dynamics.columns[leg]], rows @ dynamics.v)
        dynamics.update(dataclasses.replace(still, velocity=velocity, angular_velocity=spin, dq=joints))
        turning = to_heading @ rotations.rotate(still.orientation, spin)
        expected = body.inertia @ turning + body.coupling @ to_heading @ dynamics.com_velocity
        assert to_heading @ dynamics.momentum == pytest.approx(expected, abs=0.05)
        assert np.abs(dynamics.momentum).max() > 0.5

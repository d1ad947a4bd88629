"""The fitted limits of reach against inverse kinematics of the model itself."""

import dataclasses
import math

import numpy as np
import pytest

from hugwbc import load_robot, rotations
from hugwbc.kinematics import Kinematics
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.reach import (
    balance_point,
    cop_reach,
    fastest_walk,
    highest_clearance,
    highest_fall,
    highest_leap_clearance,
    highest_lift,
    leap_lean,
    leap_rise,
    lowest_leaping_height,
    lowest_walking_height,
    toe_down,
)
from hugwbc.mbc.swing import BRISKNESS, SwingTrajectory

# The limits are fitted to the lighter robot; the heavier legs of the other one leave a centimetre more.
FITTED, HEAVIER = load_robot("h1-2023"), load_robot("h1")
PARAMS = ControllerParams()


def _squat(robot, standing_state, h, p):
    """Foremost centre of mass ahead of the ankles with soles level and the ankle 0.02 rad short of its limit [m]."""
    kinematics = Kinematics(robot)
    ankle = robot.lower[robot.index("left_ankle_joint")] + 0.02
    # Of the family of leg poses with that ankle and level soles, find the knee that gives the height, by bisection.
    low, high = 0.9, 2.03
    for _ in range(60):
        knee = (low + high) / 2.0
        hip = -knee - ankle - p
        q = standing_state.q.copy()
        for side in ("left", "right"):
            names = [f"{side}_{part}_joint" for part in ("hip_roll", "hip_pitch", "knee", "ankle")]
            q[robot.indices(names)] = 0.0, hip, knee, ankle
        state = dataclasses.replace(standing_state, q=q, orientation=rotations.from_yaw_pitch_roll(0.0, p, 0.0))
        kinematics.update(state)
        height = kinematics.position("pelvis")[2] - kinematics.position("left_sole")[2] - 0.98
        low, high = (knee, high) if height > h else (low, knee)
    ankle_x = kinematics.position("left_ankle_link")[0]
    return kinematics.centre_of_mass()[0] - ankle_x


@pytest.mark.parametrize(("h", "p"), [(-0.3, 0.0), (-0.25, 0.0), (-0.2, 0.0), (-0.2, 0.2), (-0.25, 0.2)])
def test_balance_point_keeps_its_margin_from_the_foremost_one(standing_state, h, p):
    foremost, heavier = _squat(FITTED, standing_state, h, p), _squat(HEAVIER, standing_state, h, p)
    for walking in (False, True):
        point = balance_point(PARAMS, h, p, walking=walking, robot=FITTED)
        assert foremost - point == pytest.approx(PARAMS.balance_margin[walking], abs=0.012)
        assert 0.0 < heavier - foremost < 0.01


def _centre_of_mass(robot, standing_state, up, back):
    """Centre of mass ahead of the pelvis with both feet pulled up and back from the nominal pose [m]."""
    kinematics, q = Kinematics(robot), standing_state.q.copy()
    hip, knee, ankle = (robot.pair(part) for part in ("hip_pitch", "knee", "ankle_pitch"))
    down = robot.leg_length * math.cos(0.5 * q[knee[0]]) - up
    bent = 2.0 * math.acos(math.hypot(down, back) / robot.leg_length)
    q[hip] = math.atan2(back, down) - 0.5 * bent
    q[knee], q[ankle] = bent, -q[hip] - bent
    kinematics.update(dataclasses.replace(standing_state, q=q))
    return kinematics.centre_of_mass()[0] - kinematics.position("pelvis")[0]


@pytest.mark.parametrize("apex", [0.1, 0.2])
def test_feet_that_go_back_as_they_are_pulled_up_leave_the_pelvis_in_its_place(standing_state, apex):
    up = apex - leap_rise(2.0)  # relative to the body
    lean = leap_lean(PARAMS, 0.0, 2.0, apex, 0.0, HEAVIER)
    still, straight, leaning = (
        _centre_of_mass(HEAVIER, standing_state, *way) for way in ((0.0, 0.0), (up, 0.0), (up, lean * apex))
    )
    assert straight - still > 0.002
    assert abs(leaning - still) < 0.35 * (straight - still)
    assert leap_lean(PARAMS, 0.0, 2.0, apex, 5.0, HEAVIER) == 0.0, "legs that swing as fast as they can"
    assert leap_lean(PARAMS, -5.0, 2.0, apex, 0.0, HEAVIER) == 0.0, "an absurd height"


def test_the_ankle_holds_the_weight_less_far_away_the_heavier_the_robot():
    # 0.95 of 38 N m, over 59.338 kg and 51.65 kg times 9.81 m/s^2.
    assert cop_reach(PARAMS, HEAVIER) == pytest.approx(0.0620, abs=1e-4)
    assert cop_reach(PARAMS, FITTED) == pytest.approx(0.0712, abs=1e-4)


def test_walking_needs_more_height_the_faster_and_more_so_backwards():
    still, forward, backward = (
        lowest_walking_height(PARAMS, v, 0.25, 0.0, robot=load_robot()) for v in (0.0, 0.5, -0.5)
    )
    assert -0.3 < still < forward < backward <= 0.0
    assert lowest_walking_height(PARAMS, 0.0, 0.25, 0.3, robot=load_robot()) < still


def test_clearance_shrinks_with_height_frequency_and_speed_but_a_foot_is_always_lifted():
    upright = highest_clearance(PARAMS, 0.0, 2.0, 0.0, robot=load_robot())
    assert upright - highest_clearance(PARAMS, -0.1, 2.0, 0.0, robot=load_robot()) == pytest.approx(0.1)
    assert highest_clearance(PARAMS, -0.3, 2.0, 0.0, robot=load_robot()) == PARAMS.min_clearance
    assert highest_clearance(PARAMS, 0.0, 2.5, 0.0, robot=load_robot()) >= 0.15
    assert highest_clearance(PARAMS, 0.0, 3.5, 0.0, robot=load_robot()) == pytest.approx(
        0.083, abs=1e-3
    )  # documented in docs/mbc.md
    assert highest_clearance(PARAMS, 0.0, 2.5, 1.2, robot=load_robot()) < 0.22, "the hips swing the leg as well"
    assert highest_clearance(PARAMS, -0.06, 2.0, 1.5, robot=load_robot()) >= 0.15, "it lowers no single command of v_x"
    assert highest_clearance(PARAMS, 0.0, 3.0, 0.0, robot=load_robot()) < upright


def test_lighter_legs_and_a_lower_frequency_walk_faster():
    heavy, light = (fastest_walk(PARAMS, 2.0, robot) for robot in (HEAVIER, FITTED))
    assert fastest_walk(PARAMS, 1.0, HEAVIER) == pytest.approx(2.0 * heavy)
    # By hand: the inertia about the hip with the armature is 1.40 kg m^2 and 0.92 kg m^2 in the nominal pose.
    assert light / heavy == pytest.approx(1.403 / 0.915, rel=0.01)
    torque = 4.0 * 4.65 * heavy * 2.0 * 1.403 / 0.8
    assert torque == pytest.approx(PARAMS.swing_torque * PARAMS.torque_fraction * 180.0, rel=0.01)


def test_a_leg_is_lifted_as_high_as_the_hip_bends_it_in_half_a_step():
    """By hand, of the heavier legs: the hip takes 0.2857 N m per rad/s^2 of the knee, and starts 0.738 m up."""
    acceleration = PARAMS.lift_torque * PARAMS.torque_fraction * 180.0 / 0.2857
    for f in (2.0, 2.75, 3.5):
        knee = 2.0 * math.acos(0.7381 / 0.8) + acceleration * (0.25 / f) ** 2 / 6.0
        assert highest_lift(PARAMS, 0.0, f, HEAVIER) == pytest.approx(0.7381 - 0.8 * math.cos(knee / 2.0), abs=1e-3)
    assert highest_lift(PARAMS, 0.0, 2.0, HEAVIER) > 0.31, "it lowers no single command of l"
    assert highest_lift(PARAMS, -0.1, 3.0, HEAVIER) > highest_lift(PARAMS, 0.0, 3.0, HEAVIER), "a bent leg lifts faster"
    assert highest_lift(PARAMS, 0.0, 3.0, FITTED) > highest_lift(PARAMS, 0.0, 3.0, HEAVIER)
    assert highest_lift(PARAMS, 0.0, 0.1, HEAVIER) == pytest.approx(0.7381, abs=1e-3), "a knee bends no further than π"
    assert highest_lift(PARAMS, -5.0, 2.0, HEAVIER) == pytest.approx(0.0, abs=1e-9), "an absurd height raises nothing"


@pytest.mark.parametrize(("f", "speed", "share"), [(2.0, 0.0, 1.3), (2.0, 0.9, 0.95), (2.5, -0.6, 0.95)])
def test_a_foot_falls_no_faster_than_the_knee_stretches_the_leg(f, speed, share):
    """The trajectory itself, seen from a hip that moves evenly: its fastest knee is the one that was allowed."""
    velocity = HEAVIER.velocity_limit.copy()
    velocity[list(HEAVIER.pair("knee"))] = 10.0
    slow, duration, dt = dataclasses.replace(HEAVIER, velocity_limit=velocity), 0.5 / f, 1e-4
    step = speed * duration
    apex = highest_fall(PARAMS, 0.3, 0.0, f, step, slow, speed=speed)
    assert apex < highest_fall(PARAMS, 0.3, 0.0, f, step, HEAVIER, speed=speed)
    swing, knee = SwingTrajectory(PARAMS), []
    swing.start(np.array([-step, 0.0, 0.0]))
    for k in range(round(duration / dt)):
        swing.advance(np.array([step, 0.0]), apex, 0.0, k * dt, duration - k * dt, dt, briskness=BRISKNESS)
        x, z = swing.position[0] - speed * ((k + 1) * dt - 0.5 * duration), 0.7381 - swing.position[2]
        knee.append(2.0 * math.acos(math.hypot(x, z) / 0.8))
    assert np.max(-np.diff(knee)) / dt == pytest.approx(share * 10.0, rel=0.05)


def test_an_absurd_step_or_height_lowers_the_foot_and_raises_nothing():
    assert 0.0 <= highest_fall(PARAMS, 0.3, 5.0, 3.0, 9.0, HEAVIER, speed=1.0) < 0.1
    assert math.isfinite(highest_fall(PARAMS, 0.3, -5.0, 2.0, 0.0, HEAVIER))


def test_a_leap_rises_as_a_ballistic_flight_of_half_a_stride():
    # f = 2 Hz: 0.25 s of flight, 1.22625 m/s at take-off, and an apex after v^2 / (2 g).
    assert leap_rise(2.0) == pytest.approx(1.22625**2 / (2.0 * 9.81))
    assert lowest_leaping_height(PARAMS, 1.5, 2) - lowest_leaping_height(PARAMS, 3.5, 2) == pytest.approx(
        leap_rise(1.5) - leap_rise(3.5)
    )
    assert lowest_leaping_height(PARAMS, 2.0, 1) > lowest_leaping_height(PARAMS, 2.0, 2)


def test_feet_rise_with_the_body_and_are_drawn_in_less_the_faster_the_leap():
    assert highest_leap_clearance(PARAMS, 0.0, 1.5, HEAVIER) == pytest.approx(0.31 + leap_rise(1.5))
    assert highest_leap_clearance(PARAMS, -0.1, 1.5, HEAVIER) < highest_leap_clearance(PARAMS, 0.0, 1.5, HEAVIER)
    assert highest_leap_clearance(PARAMS, 0.0, 3.5, HEAVIER) == pytest.approx(
        leap_rise(3.5) + PARAMS.leap_tuck / 3.5**2
    )


def test_a_sole_is_level_or_on_the_slope_as_far_as_the_ankle_allows():
    assert toe_down(0.7, 0.0, 0.0, load_robot()) == 0.0
    assert toe_down(0.5, 0.0, -0.1, load_robot()) == -0.1
    assert toe_down(0.75, 0.0, -0.1, load_robot()) == pytest.approx(-0.05)


def test_a_wide_ankle_allows_the_lowest_squat_at_every_speed():
    """Where every squat reaches as far ahead, no height is the nearest: the interpolation has no slope there."""
    robot = dataclasses.replace(FITTED, squat_reach=(0.44,) * len(FITTED.squat_reach))
    for speed in (0.0, 1.0, 9.0):
        lowest = lowest_walking_height(PARAMS, speed, 0.25, 0.0, robot)
        assert lowest == robot.squat_heights[0]

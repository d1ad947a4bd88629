import math

import numpy as np
import pytest

from hugwbc import Gait, RobotState, rotations
from hugwbc.errors import ConfigError
from hugwbc.evaluation.navigation import LIMITS, Navigator, Tour, Waypoint


def seen(x: float, y: float, yaw: float) -> RobotState:
    orientation = rotations.from_yaw_pitch_roll(yaw, 0.0, 0.0)
    return RobotState(np.zeros(19), np.zeros(19), orientation, np.zeros(3), position=np.array([x, y, 0.98]))


def test_commands_are_in_the_heading_frame_and_limited():
    navigator = Navigator(Tour((Waypoint(1.0, 2.0, math.pi),), 5.0))
    navigator.follow(seen(1.0, 1.8, math.pi / 2))  # looks along y, the goal 0.2 m ahead and a quarter turn to the left
    command = navigator.command_at(0.0)
    assert (command.v_x, command.v_y) == pytest.approx((0.2, 0.0)) and command.gait is Gait.WALKING
    assert command.omega == LIMITS["omega"][1]
    navigator.follow(seen(-9.0, 9.0, 0.0))
    command = navigator.command_at(0.0)
    assert (command.v_x, command.v_y) == (LIMITS["v_x"][1], LIMITS["v_y"][0])


def test_a_state_that_is_not_finite_is_not_followed():
    navigator = Navigator(Tour((Waypoint(0.5, 0.0, 0.0),), 5.0))
    navigator.follow(seen(0.25, 0.0, 0.0))
    navigator.follow(seen(float("nan"), 0.0, 0.0))
    assert navigator.command_at(0.0).v_x == pytest.approx(0.25)


def test_a_robot_that_executes_the_commands_arrives_everywhere():
    tour = Tour((Waypoint(1.5, 0.5, 1.0), Waypoint(1.8, 1.9, 2.0), Waypoint(0.8, 1.9, -2.9)), 5.0)
    navigator, pose, dt = Navigator(tour), np.zeros(3), 0.02
    for step in range(750):
        t = step * dt
        navigator.follow(seen(*pose))
        command = navigator.command_at(t)
        pose[:2] += dt * rotations.rotation_z(pose[2])[:2, :2] @ [command.v_x, command.v_y]
        pose[2] += dt * command.omega
        if (step + 1) % 250 == 0:
            goal = tour.waypoint_at(t)
            assert math.hypot(goal.x - pose[0], goal.y - pose[1]) < 0.12, t
            assert abs(rotations.wrap_angle(goal.yaw - pose[2])) < 0.05, t


def test_the_last_waypoint_holds():
    tour = Tour((Waypoint(1.0, 0.0, 0.0), Waypoint(2.0, 0.0, 0.0)), 5.0)
    assert [tour.waypoint_at(t).x for t in (0.0, 4.99, 5.0, 9.0, 99.0)] == [1.0, 1.0, 2.0, 2.0, 2.0]
    with pytest.raises(ConfigError, match="0 waypoints"):
        Tour((), 5.0)

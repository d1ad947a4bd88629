"""Which states no controller is given, and the limits of joint commands."""

import dataclasses

import numpy as np
import pytest

from hugwbc import JointCommand, load_robot, rotations
from hugwbc.learned.policy.contract import load_contract
from hugwbc.runtime.safety import SafetyFilter, StateCheck, gain_limits
from hugwbc.runtime.safety_report import SafetyLog
from tests.conftest import make_state

ROBOT = load_robot()
CHECK = StateCheck(ROBOT)
STAND = JointCommand.position(ROBOT, ROBOT.nominal)


@pytest.fixture
def limited():
    """Return a function that limits a joint command whose vectors are replaced, and one that reports."""
    log = SafetyLog()
    limit = SafetyFilter(ROBOT, log)
    return lambda **vectors: limit(dataclasses.replace(STAND, **vectors)), log.report


def test_targets_and_torques_stay_within_limits(limited):
    limit, report = limited
    output = limit(q=np.full(19, 100.0), tau=-1e4 * np.ones(19))
    knee = ROBOT.index("left_knee_joint")
    # limit 2.05 rad; 280 N*m at 300 N*m/rad is another 0.9333 rad
    assert output.q[knee] == pytest.approx(2.05 + 280 / 300)
    assert output.tau[knee] == -280.0
    assert (report().positions_limited, report().torques_limited) == (1, 1)


def test_velocity_targets_are_limited_to_the_joints_speeds(limited):
    limit, report = limited
    fast = ROBOT.velocity_limit * np.where(np.arange(19) % 2, -1.5, 0.5)
    np.testing.assert_allclose(limit(dq=fast).dq, np.clip(fast, -ROBOT.velocity_limit, ROBOT.velocity_limit))
    assert report().speeds_limited == 1
    assert any("speeds limited, first at" in message for message in report().messages)
    limit(dq=ROBOT.velocity_limit)
    assert report().speeds_limited == 1


@pytest.mark.parametrize("name", ["kp", "kd"])
@pytest.mark.parametrize("factor", [-1.0, -1e-3, 1e6])
def test_gains_that_drive_joints_away_or_chatter_are_clamped_and_counted(limited, name, factor):
    limit, report = limited
    output = limit(**{name: factor * getattr(ROBOT, name)})
    highest = gain_limits(ROBOT)[("kp", "kd").index(name)]
    np.testing.assert_array_equal(getattr(output, name), np.zeros(19) if factor < 0.0 else highest)
    assert report().gains_limited == 1 and "gains limited, first at" in report().messages[0]


@pytest.mark.parametrize("name", ["unitree-h1", "leggedlab-h1"])
def test_other_projects_gains_are_within_the_limits(name):
    contract = load_contract(name)
    stiffest, most_damped = (limit[ROBOT.indices(contract.joints)] for limit in gain_limits(ROBOT))
    assert (np.array(contract.kp) <= 0.6 * stiffest).all() and (np.array(contract.kd) <= 0.6 * most_damped).all()


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({"q": np.full(19, np.nan)}, "not finite"),
        ({"dq": np.full(19, 1e7)}, "not finite"),
        ({"orientation": np.zeros(4)}, "no orientation"),
        ({"orientation": np.array([0.9, 0.0, 0.0, 0.0])}, "no orientation"),
        ({"orientation": rotations.from_yaw_pitch_roll(0.0, 1.4, 0.0)}, "leans"),
        ({"angular_velocity": np.array([0.0, 16.0, 0.0])}, "turns"),
        ({"velocity": np.array([7.0, 0.0, 0.0])}, "pelvis moves"),
        ({"dq": np.full(19, 80.0)}, "joint moves"),
        ({"q": ROBOT.upper + 0.6}, "range"),
    ],
)
def test_what_no_balanced_robot_does_is_a_fault(values, why):
    assert why in CHECK.fault(make_state(**values))


def test_a_fast_walk_and_a_hard_landing_are_none():
    fast = {"velocity": np.array([3.0, 0.0, 0.5]), "angular_velocity": np.array([0.0, 5.0, 0.0])}
    assert CHECK.fault(make_state(pitch=0.8, dq=2.0 * ROBOT.velocity_limit, **fast)) == ""
    assert CHECK.fault(make_state(ROBOT.lower - 0.3)) == ""

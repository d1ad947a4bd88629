"""Which states no controller is given, and the limits of joint commands."""

import dataclasses

import numpy as np
import pytest

from hugwbc import JointCommand, load_robot
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


@pytest.mark.parametrize(("sign", "end"), [(1.0, 2.05), (-1.0, -0.26)])
def test_targets_and_torques_stay_within_limits(limited, sign, end):
    limit, report = limited
    output = limit(q=np.full(19, sign * 100.0), tau=np.full(19, sign * 1e4))
    knee = ROBOT.index("left_knee_joint")
    # limits 2.05 and -0.26 rad; 280 N*m at 300 N*m/rad is another 0.9333 rad
    assert output.q[knee] == pytest.approx(end + sign * 280 / 300)
    assert output.tau[knee] == sign * 280.0
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
    # The full torque at 0.05 rad, and at a tenth of the highest speed.
    highest = ROBOT.torque_limit / (0.05 if name == "kp" else 0.1 * ROBOT.velocity_limit)
    np.testing.assert_allclose(getattr(output, name), np.zeros(19) if factor < 0.0 else highest)
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
        ({"pitch": 1.35}, "leans"),
        ({"roll": -1.35}, "leans"),
        ({"angular_velocity": np.array([0.0, 16.0, 0.0])}, "turns"),
        ({"velocity": np.array([-6.5, 0.0, 0.0])}, "pelvis moves"),
        ({"dq": 3.1 * ROBOT.velocity_limit}, "joint moves"),
        ({"dq": -3.1 * ROBOT.velocity_limit}, "joint moves"),
        ({"q": ROBOT.upper + 0.6}, "range"),
        ({"q": ROBOT.lower - 0.6}, "range"),
    ],
)
def test_what_no_balanced_robot_does_is_a_fault(values, why):
    assert why in CHECK.fault(make_state(**values))


def test_what_is_just_possible_is_none():
    fast = {"velocity": np.array([5.5, 0.0, 0.5]), "angular_velocity": np.array([0.0, -14.0, 0.0])}
    assert CHECK.fault(make_state(pitch=1.25, dq=-2.9 * ROBOT.velocity_limit, **fast)) == ""
    assert CHECK.fault(make_state(ROBOT.lower - 0.4, roll=1.25)) == ""

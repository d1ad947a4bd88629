"""Dead motors of the legs: what is found, how soon, and what is not a fault."""

import numpy as np
import pytest

from hugwbc import load_robot
from hugwbc.controller import JointCommand
from hugwbc.runtime.motor_watch import MotorWatch
from tests.conftest import make_state

H1 = load_robot()
PERIOD = 0.002
KNEE = H1.index("left_knee_joint")


def watched(torque, *, asked=12.0, seconds=0.1, noise=1.0, speed=0.0, joint=KNEE):
    """Return a watch that has seen a joint asked for a torque and measuring another, both [N*m] of time [s]."""
    watch, rng = MotorWatch(H1), np.random.default_rng(0)
    for tick in range(round(seconds / PERIOD)):
        time = tick * PERIOD
        tau, measured = np.zeros(19), rng.normal(0.0, noise, 19)
        tau[joint] = (asked(time) if callable(asked) else asked) + speed * H1.kd[joint]
        measured[joint] += torque(time) if callable(torque) else torque
        watch.see(make_state(torque=measured, time=time, dq=speed * (np.arange(19) == joint)), time)
        watch.note(JointCommand(H1.nominal, np.zeros(19), H1.kp, H1.kd, tau))
    return watch


def test_a_dead_motor_is_found_within_a_tenth_of_a_second():
    assert watched(0.0).dead == watched(0.0, asked=-12.0).dead == "left_knee_joint"
    assert watched(0.0, seconds=0.02).dead == "", "not at once"
    assert watched(0.0, asked=-25.0, speed=13.9).dead == "left_knee_joint", "at any speed it could brake"


@pytest.mark.parametrize(("asked", "seconds"), [(7.05, 0.048), (12.0, 0.030), (20.0, 0.020), (40.0, 0.020)])
def test_a_dead_motor_is_found_once_what_it_owes_adds_up(asked, seconds):
    """0.3 N m s, of which 20 N m count at most: 43 ms at 7 N m, 15 ms from 20 N m on, after the delay of a command."""
    assert watched(0.0, asked=asked, seconds=seconds).dead == "left_knee_joint"
    assert watched(0.0, asked=asked, seconds=seconds - 0.004).dead == ""


def test_what_a_motor_owes_fades_between_short_requests():
    assert watched(0.0, asked=6.9, seconds=3.0).dead == "", "less than 7 N m is never asked for enough"
    for every, dead in ((0.7, ""), (0.1, "left_knee_joint")):
        assert watched(0.0, asked=lambda t: 12.0 * (t % every < 0.02), seconds=3.0 * every + 0.7).dead == dead  # noqa: B023


@pytest.mark.parametrize(
    "case",
    [
        {"torque": 12.0},
        {"torque": 8.0},  # a weak motor
        {"torque": 0.0, "asked": 25.0, "speed": 13.9},  # near the joint's highest speed no motor drives it
        {"torque": 0.0, "joint": H1.index("left_elbow_joint")},  # an arm, without which it stays up
        {"torque": 0.0, "asked": 3.0, "seconds": 10.0},  # a motor that is hardly asked for anything
        {"torque": 6.5, "asked": 7.5, "seconds": 10.0},
        {"torque": lambda t: 40.0 * np.sin(30.0 * t), "asked": lambda t: 40.0 * np.sin(30.0 * (t + 0.01))},
        {"torque": lambda t: 25.0 * (t > 0.127), "asked": lambda t: 25.0 * (t > 0.1)},  # a command that comes late
    ],
)
def test_working_motors_raise_no_alarm(case):
    assert watched(**{"seconds": 0.3, **case}).dead == ""


def test_neither_a_gap_between_readings_nor_the_same_reading_again_is_evidence():
    watch, quiet = watched(0.0, seconds=0.004), make_state(torque=np.zeros(19))
    watch.see(quiet, 0.2)
    assert watch.dead == "", "one reading after a gap"
    for tick in range(100):
        watch.see(quiet, 0.2 + tick * PERIOD)
    assert watch.dead == "", "frozen readings"


@pytest.mark.parametrize(("behind", "dead"), [(True, ""), (False, "left_knee_joint")])
def test_a_command_still_being_computed_is_not_missed_by_the_readings_that_wait(behind, dead):
    watch, rng = MotorWatch(H1), np.random.default_rng(0)
    for tick in range(50):
        quiet = make_state(torque=rng.normal(0.0, 1.0, 19), time=tick * PERIOD)
        watch.see(quiet, tick * PERIOD, behind=behind and 10 <= tick < 40)
        if tick < 10:  # the last of these commands takes 60 ms
            tau = np.zeros(19)
            tau[KNEE] = 25.0 * (tick == 9)
            watch.note(JointCommand(H1.nominal, np.zeros(19), H1.kp, H1.kd, tau))
        if tick == 40:
            assert watch.dead == dead

"""The source of arm targets: its watch on the stream of hand targets, and what it gives a control loop."""

import dataclasses
import math

import numpy as np
import pytest

from hugwbc.arm_servo import ArmServo
from hugwbc.commands import Command
from hugwbc.controller import JointCommand, UpperBody, override_arms
from hugwbc.robot import load_robot
from hugwbc.scripts.script import load_script
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import BodyReach, TargetWatch, UpperBodySource
from hugwbc.upper_ik.takeover import ACCELERATION
from tests.conftest import make_state
from tests.upper_ik.conftest import ARMS, LIMIT

DT = 0.02
HANDS = HandTargets.of((0.35, 0.2, 0.15), (0.3, -0.25, 0.25))
GOOD = HandTargets.of((0.3, 0.2, 0.1), (0.3, -0.2, 0.1))
BAD = HandTargets(np.array([math.nan, 0.2, 0.1]), GOOD.right)


def arms_of(source, state, hands, commanded=None):
    """The arms of one tick of the standing robot."""
    return source.update(state, hands, Command(), DT, commanded)[0]


def message(number, time):
    return dataclasses.replace(GOOD, stamp=time, sequence=number)


@pytest.fixture
def watch():
    return TargetWatch(load_robot())


@pytest.fixture
def source():
    return UpperBodySource(load_robot())


def test_targets_without_a_stamp_are_always_new(watch):
    assert all(watch.admit(GOOD, 0.0, DT) is GOOD for _ in range(100))
    assert not +watch.tally.counts


@pytest.mark.parametrize("number", [int, np.uint32])  # unsigned differences wrap around
def test_what_goes_wrong_on_the_way_is_counted_by_kind(watch, number):
    first, second, fourth, fifth = (message(number(n), 0.02 * n) for n in (1, 2, 4, 5))
    for now, arrived, followed in (
        (0.03, first, first),
        (0.05, first, first),  # repeated
        (0.09, fourth, fourth),  # number 3, and so far 2, dropped
        (0.10, second, fourth),  # late
        (0.11, BAD, fourth),
        (0.13, fifth, fifth),
    ):
        assert watch.admit(arrived, now, DT) is followed
    assert +watch.tally.counts == {"bad": 1, "late": 1, "repeated": 1, "missing": 2}


def test_the_age_counts_from_when_a_target_was_made(watch):
    assert watch.admit(message(1, 0.0), 0.3, DT) is not None
    assert watch.age == pytest.approx(0.3)
    assert watch.admit(message(1, 0.0), 0.5, 0.19) is not None
    assert watch.admit(message(1, 0.0), 0.52, DT) is None
    assert watch.tally.counts["stale"] == 1
    future = message(2, 9.0)
    assert watch.admit(future, 0.6, DT) is future, "a clock that runs ahead does not make a target stale"
    assert watch.age == 0.0


@pytest.mark.parametrize("stamp", [math.nan, math.inf])
def test_a_stamp_that_is_not_finite_is_bad_and_shuts_out_nothing(watch, stamp):
    assert watch.admit(message(1, stamp), 0.0, DT) is None
    good = message(2, 0.1)
    assert watch.admit(good, 0.1, DT) is good
    assert +watch.tally.counts == {"bad": 1}


def test_a_loop_that_stood_still_finds_its_target_stale(watch):
    assert watch.admit(message(1, 0.0), 0.0, DT) is not None
    assert watch.admit(message(1, 0.0), math.nan, math.nan) is not None, "a step of NaN counts as none"
    assert watch.admit(message(1, 0.0), 0.6, 0.6) is None


def test_a_stream_goes_on_after_one_message_from_a_wrong_clock(watch):
    def numbers_of(counted):
        watch.reset()
        watch.admit(message(1, 100.0), 0.0, DT)
        for tick in range(1, 41):
            hands = message(1 + tick, tick * DT)
            followed = watch.admit(hands if counted else dataclasses.replace(hands, sequence=None), tick * DT, DT)
            yield followed and (followed.sequence or round(followed.stamp / DT) + 1)

    assert list(numbers_of(counted=True)) == list(range(2, 42))
    numbers = list(numbers_of(counted=False))
    # Without numbers, late until the wrong one is stale, half a second later.
    assert numbers[:24] == [1] * 24
    assert numbers[26:] == list(range(28, 42))
    assert watch.tally.counts["stale"] == 1


@pytest.mark.parametrize("shape", [(2,), (3, 1), ()])
def test_numbers_that_stay_bad_are_no_update(watch, shape):
    watch.admit(GOOD, 0.0, DT)
    bad = HandTargets(np.zeros(shape), GOOD.right)
    followed = [watch.admit(bad, 0.0, 0.03) for _ in range(30)]
    assert followed == [GOOD] * 16 + [None] * 14
    assert +watch.tally.counts == {"bad": 30, "stale": 1}


def test_a_stream_that_is_ended_on_purpose_may_start_anew_with_any_stamp(watch):
    watch.admit(message(7, 5.0), 5.0, DT)
    watch.forget()
    again = message(1, 0.0)
    assert watch.admit(again, 0.1, DT) is again
    assert not +watch.tally.counts


def test_source_leaves_the_arms_alone_without_targets(source, nominal_state):
    assert not arms_of(source, nominal_state, None).indicator
    assert source.solution is None


def test_source_never_jumps(source, robot):
    """Random targets, gaps, lost numbers, takeovers that start elsewhere: the command stream keeps its speed."""
    rng = np.random.default_rng(0)
    command = robot.nominal[robot.arms].copy()
    hands = None
    for tick in range(1500):
        if tick % 40 == 0:
            hands = None if rng.random() < 0.3 else HandTargets(*rng.uniform(-0.8, 0.8, (2, 3)))
            if hands is not None and rng.random() < 0.2:
                hands = HandTargets(np.full(3, math.nan), hands.right)
        q = robot.nominal + rng.normal(0.0, 0.05, 19)
        body = arms_of(source, make_state(q), hands, command)
        assert np.all(np.isfinite(body.q))
        assert np.all(np.isfinite(body.dq))
        assert source.solution is None or source.solution.ok
        if body.indicator:
            assert np.all(np.abs(body.q - command) <= 0.5 * LIMIT * DT + 1e-9)
            assert np.all(np.abs(body.dq) <= 0.5 * LIMIT + 1e-9)
            command = body.q
    assert source.watch.tally.counts["bad"] > 0


def test_arms_follow_joint_targets_and_change_to_hand_targets_without_a_jump(source, robot, nominal_state):
    wanted = robot.nominal[robot.arms] + 0.4
    joints = HandTargets(None, None, joints=wanted, joint_velocity=np.zeros(8))
    path = []
    for tick in range(150):
        path.append(arms_of(source, nominal_state, joints if tick < 75 else HANDS).q)
        if tick == 74:
            assert source.solution is None
            assert path[-1] == pytest.approx(wanted, abs=1e-6)
    assert source.solution is not None and source.solution.reachable.all()
    assert path[-1] == pytest.approx(source.solution.q, abs=1e-3)
    speed = np.diff(path, axis=0) / DT
    assert np.all(np.abs(speed) <= source.takeover.velocity_limit + 1e-9)
    assert np.abs(np.diff(speed, axis=0)).max() <= ACCELERATION * DT + 1e-9


def test_targets_that_are_not_finite_are_held_off(source, robot, nominal_state):
    bad = HandTargets(None, None, joints=np.full(8, np.nan))
    for first in (bad, HandTargets(np.full(3, math.nan), np.zeros(3))):
        assert not arms_of(source, nominal_state, first, ARMS).indicator
    good = HandTargets(None, None, joints=robot.nominal[robot.arms])
    arms_of(source, nominal_state, good)
    assert np.isfinite(arms_of(source, nominal_state, bad).q).all()
    assert source.watch.tally.counts["bad"] == 3


def test_a_stream_that_dries_up_holds_then_returns_to_the_controller(nominal_state):
    source, own = UpperBodySource(load_robot()), np.full(8, 0.2)
    state, body = nominal_state, UpperBody.targets(own)
    for tick in range(100):
        state = dataclasses.replace(nominal_state, time=tick * DT)
        last = dataclasses.replace(HANDS, stamp=state.time, sequence=tick)
        body = arms_of(source, state, last, body.q)
    bodies = []
    for tick in range(100, 300):
        state = dataclasses.replace(nominal_state, time=tick * DT)
        bodies.append(arms_of(source, state, last, bodies[-1].q if bodies else body.q))
    taken = [b.indicator for b in bodies]
    # The last target is from tick 99: older than 0.5 s from tick 125, back 1 s later.
    assert taken.index(False) == pytest.approx(25 + 50, abs=2)
    assert not any(taken[80:])
    assert np.abs(bodies[23].q - body.q).max() < 1e-3, "held"
    assert bodies[taken.index(False) - 1].q == pytest.approx(own)
    assert source.watch.tally.counts["stale"] == 1
    assert source.watch.tally.counts["repeated"] == 200
    fresh = dataclasses.replace(HANDS, stamp=state.time, sequence=101)
    assert arms_of(source, state, fresh, own).indicator, "a stream that comes back takes the arms again"


def test_soft_arms_follow_the_script_within_a_centimetre(robot, hanging):
    """Pelvis held: 1 cm with the servo, more than 2 cm with the paper's gains alone."""
    script = load_script("loco_manipulation")
    mean = {}
    for servo in (None, ArmServo(robot)):
        rig, source = hanging(), UpperBodySource(robot)
        errors = []
        command = JointCommand.position(robot, robot.nominal)
        state = rig.step(command, 1.0)
        for tick in range(250):
            t = 2.0 + tick * DT
            body = arms_of(source, state, script.hands_at(t), command.q[robot.arms])
            driven = body if servo is None else servo(body, state, DT)
            command = override_arms(JointCommand.position(robot, robot.nominal), driven, robot)
            state = rig.step(command, DT)
            target = script.hands_at(t + DT)
            assert target is not None
            if tick >= 50:
                errors.append(np.linalg.norm(rig.hands() - target.array(), axis=1))
        mean[servo is not None] = float(np.mean(errors))
    assert mean[True] < 0.01
    assert mean[False] > 0.02


def test_the_command_comes_back_as_the_body_reach_alone_would_give_it(robot):
    """The arms' source asks the virtual robot once a tick, with the targets that the arms follow."""
    state = make_state(robot.nominal, position=(0.0, 0.0, 0.98))
    low = HandTargets.of((0.45, 0.2, 0.5), (0.45, -0.2, 0.5), "world", whole_body=True)
    lost = dataclasses.replace(low, left=np.full(3, math.nan))
    source, reach = UpperBodySource(robot), BodyReach(robot)
    for tick in range(60):
        hands = (None, low, lost, low, None, None)[tick // 10]
        command = Command(w=0.01 * tick)
        assert source.update(state, hands, command, DT)[1] == reach.update(
            low if hands is lost else hands, state, command, DT
        ), "while the numbers are lost, all follow the last good target"
    assert source.watch.tally.counts["bad"] == 10


def test_targets_of_the_arms_alone_leave_the_command_as_it_is(nominal_state):
    source, command = UpperBodySource(load_robot()), Command(h=-0.1)
    assert source.update(nominal_state, None, command, DT)[1] is command
    assert source.update(nominal_state, HANDS, command, DT)[1] is command


def test_an_arm_without_wrists_refuses_an_orientation_and_goes_back(robot):
    """It is counted in every period, with the robot, its arm and the joints in the reason; nothing raises."""
    source, state = UpperBodySource(robot), make_state(time=1.0)
    good = HandTargets.of((0.35, 0.2, 0.15), None)
    level = HandTargets.of((0.35, 0.2, 0.15), None, left_orientation="level")
    for hands, ticks in ((good, 5), (level, 60)):
        for _ in range(ticks):
            arms, _ = source.update(state, hands, Command(), 0.02)
    assert source.takeover.phase.name == "RETURNING" and arms.indicator
    assert source.watch.tally.counts["bad"] == 60
    for word in ("left_orientation", "h1", "has 4", "left_elbow_joint", "5 joints"):
        assert word in source.refusal
    source.reset()
    assert source.refusal == "", "that of the episode before"
    source.update(state, good, Command(), 0.02)
    assert source.watch.refusal == "" and source.takeover.phase.name == "TAKEN"

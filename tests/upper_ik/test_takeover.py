import dataclasses
import math

import numpy as np
import pytest

from hugwbc.controller import JointCommand, UpperBody, override_arms
from hugwbc.errors import ConfigError
from hugwbc.scripts.script_file import load_script
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import Takeover, TakeoverConfig, UpperBodySource
from hugwbc.upper_ik.takeover import Phase

DT = 0.02
HANDS = HandTargets.of((0.35, 0.2, 0.15), (0.3, -0.25, 0.25))
ARMS = np.array([-0.5, 0.2, 0.1, 0.3, -0.4, -0.3, -0.1, 0.2])
LIMIT = np.array([9.0, 9.0, 20.0, 20.0] * 2)  # the maker's joint speeds [rad/s], from h1.yaml


def run(takeover, target, seconds, start=None, dt=DT):
    return [takeover.follow(target, np.zeros(8), dt, start) for _ in range(round(seconds / dt))]


def test_takeover_blends_from_the_start_to_the_target():
    takeover = Takeover()
    bodies = run(takeover, ARMS, 0.5, start=np.full(8, 0.1))
    assert all(body.mask.all() for body in bodies)
    # Half of the blend time: half of the way.
    assert Takeover().follow(ARMS, np.zeros(8), 0.25, np.full(8, 0.1)).q == pytest.approx(0.05 + ARMS / 2)
    assert not np.any(np.abs(bodies[0].q - 0.1) > 0.001)
    assert takeover.settled
    assert bodies[-1].q == pytest.approx(ARMS)


def test_velocity_is_the_derivative_of_position():
    takeover = Takeover()
    fine = 1e-3
    bodies = run(takeover, ARMS, 0.5, start=np.zeros(8), dt=fine)
    q = np.array([body.q for body in bodies])
    dq = np.array([body.dq for body in bodies])
    assert dq[1:] == pytest.approx(np.diff(q, axis=0) / fine, abs=0.02)


def test_a_jump_of_the_target_becomes_a_ramp_within_the_limits():
    takeover = Takeover()
    run(takeover, np.zeros(8), 0.5, start=np.zeros(8))
    bodies = [takeover.follow(np.full(8, 1.0), np.zeros(8), DT) for _ in range(40)]
    dq = np.array([np.zeros(8), *(body.dq for body in bodies)])
    assert np.abs(dq).max(axis=0)[:2] == pytest.approx(0.5 * LIMIT[:2]), "the slow joints get to half of their speed"
    assert np.all(np.abs(np.diff(dq, axis=0)) <= 100.0 * DT + 1e-9)
    assert bodies[-1].q == pytest.approx(np.ones(8))
    assert max(body.q.max() for body in bodies) < 1.0 + 1e-9, "no overshoot"


def test_hand_back_returns_before_the_mask_clears():
    takeover = Takeover()
    own = np.full(8, 0.2)
    run(takeover, ARMS, 1.0, start=own)
    last, ticks = takeover.follow(ARMS, np.zeros(8), DT), 0
    while (body := takeover.release(own, DT)).indicator:
        assert np.all(np.abs(body.q - last.q) <= 0.5 * LIMIT * DT + 1e-12)
        last, ticks = body, ticks + 1
    assert ticks == 50
    assert last.q == pytest.approx(own)
    assert takeover.phase is Phase.RELEASED
    assert not takeover.release(own, DT).indicator


def test_targets_that_return_during_a_hand_back_are_taken_up_from_there():
    takeover = Takeover()
    run(takeover, ARMS, 1.0, start=np.zeros(8))
    for _ in range(20):
        half_way = takeover.release(None, DT)
    body = takeover.follow(ARMS, np.zeros(8), DT)
    assert np.all(np.abs(body.q - half_way.q) < 0.01)
    assert takeover.phase is Phase.TAKEN


@pytest.mark.parametrize(("q", "dt"), [(np.full(8, math.nan), DT), (ARMS, 0.0), (ARMS, math.nan)])
def test_unusable_targets_hold_and_are_counted(q, dt):
    takeover = Takeover()
    last = run(takeover, ARMS, 0.3, start=np.zeros(8))[-1]
    body = takeover.follow(q, np.zeros(8), dt)
    assert body.q == pytest.approx(last.q + body.dq * (DT if dt == DT else 0.0))
    assert np.all(np.abs(body.dq) <= np.maximum(np.abs(last.dq) - 100.0 * DT, 0.0) + 1e-9), "on its way to rest"
    assert takeover.held == 1


def test_source_leaves_the_arms_alone_without_targets(nominal_state):
    source = UpperBodySource(gravity_compensation=True)
    assert not source.update(nominal_state, None, DT).indicator
    assert source.solution is None


@pytest.mark.parametrize("compensated", [False, True])
def test_source_never_jumps(robot, make_state, compensated):
    """Random targets, gaps, lost numbers, takeovers that start elsewhere: the command stream keeps its speed."""
    source = UpperBodySource(gravity_compensation=compensated)
    rng = np.random.default_rng(0)
    command = robot.nominal[robot.arms].copy()
    hands = None
    for tick in range(3000):
        if tick % 40 == 0:
            hands = None if rng.random() < 0.3 else HandTargets(*rng.uniform(-0.8, 0.8, (2, 3)))
            if hands is not None and rng.random() < 0.2:
                hands = HandTargets(np.full(3, math.nan), hands.right)
        q = robot.nominal + rng.normal(0.0, 0.05, 19)
        body = source.update(make_state(q), hands, DT, commanded=command)
        assert np.all(np.isfinite(body.q))
        assert np.all(np.isfinite(body.dq))
        if body.indicator:
            assert np.all(np.abs(body.q - command) <= 0.5 * LIMIT * DT + 1e-9)
            assert np.all(np.abs(body.dq) <= 0.5 * LIMIT + 1e-9)
            command = body.q
    assert source.watch.counts.bad > 0
    assert source.ik.failures == 0


def test_arms_follow_joint_targets_and_change_to_hand_targets_without_a_jump(robot, nominal_state):
    source = UpperBodySource(gravity_compensation=False)
    wanted = robot.nominal[robot.arms] + 0.4
    joints = HandTargets(None, None, joints=wanted, joint_velocity=np.zeros(8))
    path = []
    for tick in range(150):
        path.append(source.update(nominal_state, joints if tick < 75 else HANDS, DT).q)
        if tick == 74:
            assert source.solution is None
            assert path[-1] == pytest.approx(wanted, abs=1e-6)
    assert source.solution is not None and source.solution.reachable.all()
    assert path[-1] == pytest.approx(source.solution.q, abs=1e-3)
    speed = np.diff(path, axis=0) / DT
    assert np.all(np.abs(speed) <= source.takeover.velocity_limit + 1e-9)
    assert np.abs(np.diff(speed, axis=0)).max() <= source.takeover.acceleration_limit * DT + 1e-9


def test_joint_targets_that_are_not_finite_are_held_off(robot, nominal_state):
    source = UpperBodySource(gravity_compensation=True)
    bad = HandTargets(None, None, joints=np.full(8, np.nan))
    assert not source.update(nominal_state, bad, DT).indicator
    good = HandTargets(None, None, joints=robot.nominal[robot.arms])
    source.update(nominal_state, good, DT)
    assert np.isfinite(source.update(nominal_state, bad, DT).q).all()
    assert source.watch.counts.bad == 2


def test_a_first_target_of_nan_leaves_the_arms_alone(nominal_state):
    source = UpperBodySource(gravity_compensation=False)
    assert not source.update(nominal_state, HandTargets(np.full(3, math.nan), np.zeros(3)), DT, ARMS).indicator
    assert source.watch.counts.bad == 1


def test_a_stream_that_dries_up_holds_then_returns_to_the_controller(robot, nominal_state):
    source, own = UpperBodySource(gravity_compensation=False), np.full(8, 0.2)
    state, body = nominal_state, UpperBody.targets(own)
    for tick in range(100):
        state = dataclasses.replace(nominal_state, time=tick * DT)
        last = dataclasses.replace(HANDS, stamp=state.time, sequence=tick)
        body = source.update(state, last, DT, body.q)
    bodies = []
    for tick in range(100, 300):
        state = dataclasses.replace(nominal_state, time=tick * DT)
        bodies.append(source.update(state, last, DT, bodies[-1].q if bodies else body.q))
    taken = [b.indicator for b in bodies]
    # The last target is from tick 99: older than 0.5 s from tick 125, back 1 s later.
    assert taken.index(False) == pytest.approx(25 + 50, abs=2)
    assert not any(taken[80:])
    assert np.abs(bodies[23].q - body.q).max() < 1e-3, "held"
    assert bodies[taken.index(False) - 1].q == pytest.approx(own)
    assert source.watch.counts.stale == 1
    assert source.watch.counts.repeated == 200
    fresh = dataclasses.replace(HANDS, stamp=state.time, sequence=101)
    assert source.update(state, fresh, DT, own).indicator, "a stream that comes back takes the arms again"


def test_takeover_starts_where_the_command_was_and_ends_there(nominal_state):
    source = UpperBodySource(gravity_compensation=True)
    first = source.update(nominal_state, HANDS, DT, commanded=ARMS)
    assert first.q == pytest.approx(ARMS, abs=1e-3)
    for _ in range(100):
        body = source.update(nominal_state, HANDS, DT)
    assert np.abs(body.q - ARMS).max() > 0.1
    while (body := source.update(nominal_state, None, DT)).indicator:
        last = body
    assert last.q == pytest.approx(ARMS)


def test_soft_arms_follow_the_script_within_a_centimetre(robot, hanging):
    """PD arms with the paper's gains, pelvis held: 1 cm with gravity compensation, more than 2 cm without."""
    script = load_script("loco_manipulation")
    mean = {}
    for compensated in (False, True):
        rig, source = hanging(), UpperBodySource(gravity_compensation=compensated)
        errors = []
        command = JointCommand.position(robot, robot.nominal)
        state = rig.step(command, 1.0)
        for tick in range(250):
            t = 2.0 + tick * DT
            body = source.update(state, script.hands_at(t), DT, command.q[robot.arms])
            command = override_arms(JointCommand.position(robot, robot.nominal), body, robot)
            state = rig.step(command, DT)
            target = script.hands_at(t + DT)
            assert target is not None
            if tick >= 50:
                errors.append(np.linalg.norm(rig.hands() - target.array(), axis=1))
        mean[compensated] = float(np.mean(errors))
    assert mean[True] < 0.01
    assert mean[False] > 0.02


def test_config_refuses_nonsense():
    with pytest.raises(ConfigError, match="take_time is 0"):
        TakeoverConfig(take_time=0)
    with pytest.raises(ConfigError, match="speed_fraction is 2"):
        TakeoverConfig(speed_fraction=2)


def test_a_takeover_after_a_reset_begins_where_the_first_one_did(robot):
    takeover, q = Takeover(), robot.nominal[robot.arms] + 0.3
    first = takeover.follow(q, np.zeros(8), 0.02).q
    for _ in range(50):
        takeover.follow(q, np.zeros(8), 0.02)
    takeover.reset()
    assert takeover.follow(q, np.zeros(8), 0.02).q == pytest.approx(first)

"""What the IK says of the targets' own acceleration, which the arm servo feeds forward."""

import math

import numpy as np
import pytest

from hugwbc.scripts.hand_paths import Circle
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import ArmIK
from tests.conftest import make_state

DT = 0.002
CIRCLE = Circle((0.35, 0.2, 0.15), 0.08, "x", period=2.0)
STILL = HandTargets.of((0.35, 0.2, 0.15), (0.3, -0.25, 0.25))


def solutions(robot, targets, seconds, waist=lambda t: 0.0):
    """The IK's solutions at DT; `targets` and `waist` are functions of time."""
    ik, found = ArmIK(robot), []
    for tick in range(round(seconds / DT)):
        q = robot.nominal.copy()
        q[robot.waist] = waist(tick * DT)
        found.append(ik.solve(targets(tick * DT), make_state(q, position=(0.0, 0.0, 1.0)), DT))
    return found


def circling(t, frame="pelvis"):
    lift = np.array([0.0, 0.0, 1.0 if frame == "world" else 0.0])
    return HandTargets.of(CIRCLE.at(t) + lift, (0.3, -0.25, 0.25 + lift[2]), frame)


@pytest.mark.parametrize("frame", ["pelvis", "world"])
def test_on_a_body_at_rest_it_is_that_of_the_arm_command(robot, frame):
    found = solutions(robot, lambda t: circling(t, frame), 3.0)
    dq, ddq = (np.array([getattr(s, name) for s in found]) for name in ("dq", "ddq"))
    # Over 0.1 s the acceleration adds up to the change of the command's velocity, which lags behind by a few ticks.
    window, last = 50, 800
    change = (dq[window:] - dq[:-window])[-last:, :4]
    added = DT * (np.cumsum(ddq, axis=0)[window:] - np.cumsum(ddq, axis=0)[:-window])[-last:, :4]
    assert np.abs(change).max() > 0.1
    assert np.abs(added - change).max() < 0.15 * np.abs(change).max()


def test_a_swaying_body_moves_the_arms_but_is_not_fed_forward(robot):
    found = solutions(robot, lambda t: STILL, 3.0, waist=lambda t: 0.1 * math.sin(6.0 * t))
    settled = found[-500:]
    assert max(np.abs(s.dq).max() for s in settled) > 0.2
    assert max(np.abs(s.ddq).max() for s in settled) == 0.0


def test_noise_of_the_waist_angle_does_not_reach_it(robot):
    noise = np.random.default_rng(0).normal(0.0, 0.002, 2000)
    calm, shaken = (
        solutions(robot, circling, 2.5, waist=lambda t, by=by: by * noise[round(t / DT) % 2000]) for by in (0.0, 1.0)
    )
    difference = np.array([a.ddq - b.ddq for a, b in zip(calm, shaken, strict=True)])[-800:]
    commanded = np.array([s.dq for s in shaken])[-801:]
    noisy = np.abs(np.diff(commanded, axis=0)).max() / DT
    assert noisy > 30.0, "the command itself is noisy"
    assert np.abs(difference).max() < 0.1 * noisy


def test_targets_that_jump_or_come_in_a_stream_have_none(robot):
    def stepwise(t):
        return HandTargets.of((0.35, 0.2 + 0.05 * (round(t / 0.5) % 2), 0.15), (0.3, -0.25, 0.25))

    def stream(t):
        held = 0.02 * math.floor(t / 0.02)
        target = circling(held)
        return HandTargets(target.left, target.right, stamp=held)

    for targets in (stepwise, stream):
        assert max(np.abs(s.ddq).max() for s in solutions(robot, targets, 2.0)) == 0.0


def test_unusable_targets_end_it(robot):
    ik = ArmIK(robot)
    for tick in range(1500):
        ik.solve(circling(tick * DT), make_state(robot.nominal), DT)
    bad = ik.solve(HandTargets(np.full(3, math.nan), None), make_state(robot.nominal), DT)
    assert bad.ddq.tolist() == [0.0] * 8
    after = ik.solve(circling(3.0), make_state(robot.nominal), DT)
    assert after.ddq.tolist() == [0.0] * 8

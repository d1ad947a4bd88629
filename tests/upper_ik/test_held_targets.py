"""Targets that are held between messages: even motion, little delay, and nothing done to targets that are not."""

import dataclasses

import numpy as np
import pytest

from hugwbc import Command, load_robot
from hugwbc.runtime import ControlLoop, Simulation, load_controller
from hugwbc.scripts.view import Constant
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import UpperBodySource
from hugwbc.upper_ik.held_targets import FASTEST, HeldTargets
from tests.conftest import make_state

RADIUS, TURN = 0.1, 1.57  # [m], [rad/s]
SPEED, ACCELERATION = RADIUS * TURN, RADIUS * TURN**2


def circle(t):
    return np.array([0.35 + RADIUS * np.sin(TURN * t), 0.25, 0.1 + RADIUS * np.cos(TURN * t)])


def arrivals(rate, jitter=0.0, loss=0.0, duration=8.0):
    """Times of arrival, numbers and positions of a client's messages."""
    rng = np.random.default_rng(0)
    sent = [(n / rate + jitter * rng.random(), n, circle(n / rate)) for n in range(int(duration * rate))]
    return [message for message in sorted(sent, key=lambda m: m[0]) if not message[1] or rng.random() >= loss]


def follow(held, messages, tick, numbered, duration=8.0):
    """What comes of the newest message in every tick."""
    newest, out = -1, []
    for k in range(round(duration / tick)):
        while newest + 1 < len(messages) and messages[newest + 1][0] <= k * tick + 1e-6:
            newest += 1
        _, number, point = messages[max(newest, 0)]
        out.append(held.follow(HandTargets(point, None, sequence=number if numbered else None), tick).left)
    return np.array(out)


def motion(points, tick):
    """Speeds and accelerations after the first quarter, in which a stream is found out."""
    velocity = np.diff(points[len(points) // 4 :], axis=0) / tick
    return np.linalg.norm(velocity, axis=1), np.linalg.norm(np.diff(velocity, axis=0), axis=1) / tick


@pytest.mark.parametrize("tick", [0.004, 0.02])
@pytest.mark.parametrize("rate", [10, 20, 30, 60, 72])
def test_a_held_circle_is_followed_as_evenly_as_a_continuous_one(rate, tick):
    points = follow(HeldTargets(), arrivals(rate), tick, numbered=False)
    speed, acceleration = motion(points, tick)
    assert speed.min() > SPEED / 1.2 and speed.max() < 1.2 * SPEED
    assert np.sqrt(np.mean(acceleration**2)) < 3.0 * ACCELERATION  # of a held one: more than 20 times
    late = np.linalg.norm(points[-1] - circle(8.0 - tick)) / SPEED
    assert late < 1.5 / rate + 2.0 * tick


@pytest.mark.parametrize("tick", [0.004, 0.02])
@pytest.mark.parametrize("rate", [20, 50])
def test_jitter_and_loss_of_numbered_messages_do_not_show(rate, tick):
    points = follow(HeldTargets(), arrivals(rate, jitter=0.012, loss=0.03), tick, numbered=True)
    speed, _ = motion(points, tick)
    assert speed.min() > SPEED / 1.5 and speed.max() < 1.5 * SPEED


def test_joint_targets_are_interpolated_with_their_velocity():
    held, out = HeldTargets(), []
    for k in range(400):
        joints = np.full(8, 0.5 * np.floor(k / 5) * 0.1)  # 0.5 rad/s at 10 Hz
        out.append(held.follow(HandTargets(None, None, joints=joints), 0.02))
    speeds = np.diff([hands.joints for hands in out[200:]], axis=0) / 0.02
    np.testing.assert_allclose(speeds, 0.5, rtol=0.02)
    np.testing.assert_allclose([hands.joint_velocity for hands in out[200:]], 0.5, rtol=0.02)


def test_an_orientation_becomes_level_at_once():
    """Level is no quaternion: on the way to it, the old orientation would stay."""
    held, side = HeldTargets(), np.array([0.7, 0.7, 0.1, 0.1])
    for k in range(400):
        turn = side / np.linalg.norm(side) if k < 200 else np.zeros(4)
        hands = HandTargets(circle(k // 4 / 25), None, sequence=k // 4, left_orientation=turn)
        followed = held.follow(hands, 0.01).left_orientation
        assert followed == pytest.approx(turn, abs=1e-9)


@pytest.mark.parametrize("tick", [0.004, 0.01])
def test_messages_that_come_in_bursts_are_not_run_through_backwards(tick):
    """Joints at 0.5 rad/s, by messages at 50 Hz that a network holds up for 60 ms in the mean."""
    sent = np.arange(1000) / 50
    arrived = np.maximum.accumulate(sent + np.random.default_rng(0).exponential(0.06, sent.size))
    held, speeds = HeldTargets(), []
    for now in np.arange(1.0, 18.0, tick):
        number = int(np.searchsorted(arrived, now)) - 1
        joints = np.full(8, 0.5 * sent[number])
        followed = held.follow(HandTargets(None, None, joints=joints, sequence=number), tick)
        speeds.append(0.0 if followed.joint_velocity is None else followed.joint_velocity[0])
    assert min(speeds) > -1.0, "where a message is late, it returns"
    assert max(speeds) < 1.5 * FASTEST[1], "a cubic that catches up with as much as is no jump"


def test_an_orientation_is_the_same_by_either_of_its_quaternions():
    """A hand that turns at 0.5 rad/s, by messages at 50 Hz whose quaternions change their signs, lags by 60 ms."""
    held = HeldTargets()
    for tick in range(1500):
        number = tick // 10
        half = 0.5 * 0.5 * number / 50
        turn = np.array([np.cos(half), 0.0, 0.0, np.sin(half)])
        targets = HandTargets(circle(number / 50), None, sequence=number, left_orientation=turn * (-1) ** (number // 3))
        followed = held.follow(targets, 0.002).left_orientation
        assert 2.0 * np.arccos(min(abs(followed @ turn), 1.0)) < 0.03


def test_what_is_not_held_passes_at_once_and_unchanged():
    rng, held = np.random.default_rng(1), HeldTargets()
    path = [HandTargets(circle(0.02 * k), circle(-0.03 * k)) for k in range(200)]
    pauses = [HandTargets(circle(0.02 * (k if k % 40 < 20 else k - k % 40 + 19)), None) for k in range(200)]
    noise = [HandTargets(circle(0.0) + rng.normal(0.0, 0.003, 3), None) for _ in range(400)]
    seen = [HandTargets(circle(0.0) + np.random.default_rng(k // 3).normal(0.0, 0.003, 3), None) for k in range(400)]
    poses = [HandTargets(circle(k // 50), None) for k in range(300)]
    for name, targets in {"path": path, "pauses": pauses, "noise": noise, "seen": seen, "poses": poses}.items():
        assert all(held.follow(hands, 0.02) is hands for hands in targets), name


def test_a_stream_that_stops_ends_at_its_last_target_and_a_jump_is_not_slowed_down():
    held = HeldTargets()
    messages = [(0.1 * n, n, circle(0.1 * n)) for n in range(20)]
    points = follow(held, messages, 0.02, numbered=False, duration=3.5)
    np.testing.assert_array_equal(points[-1], messages[-1][2])
    beyond = np.linalg.norm(points - messages[-1][2], axis=1)[round(2.05 / 0.02) :]
    assert beyond.max() < 0.1 * SPEED  # of the way of one message
    held = HeldTargets()
    follow(held, messages, 0.02, numbered=True, duration=2.0)
    far = HandTargets(circle(1.9) + np.array([0.0, 0.4, 0.0]), None, sequence=20)
    np.testing.assert_array_equal(held.follow(far, 0.02).left, far.left)


def test_the_hand_of_a_robot_accelerates_as_on_a_continuous_path():
    def acceleration(rate):
        """RMS of the left hand's acceleration in the last second [m/s^2]; rate 0 for a path that is not held."""
        simulation = Simulation()

        class Source(Constant):
            def hands_at(self, t):
                return HandTargets(circle(np.floor(t * rate + 1e-9) / rate if rate else t), None)

        loop = ControlLoop(load_controller("learned"), Source(Command()), simulation, UpperBodySource(load_robot()))
        loop.reset()
        hand = []
        for k in range(100):
            command = loop.decide(k * loop.period)
            for _ in range(loop.substeps):
                loop.step(command, simulation.timestep)
                hand.append(simulation.hand_position("left"))
        return np.sqrt(np.mean((np.diff(hand[len(hand) // 2 :], n=2, axis=0) / simulation.timestep**2) ** 2))

    assert acceleration(30) < 1.5 * acceleration(0)


@pytest.mark.parametrize("clock", [lambda t: t, lambda t: t + 1.7642e9, lambda t: t + 3600.0 * (1.5 < t < 3.0)])
def test_the_stamps_of_a_stream_may_be_of_any_clock(robot, clock):
    """Targets at 20 Hz, with a clock that is right, that counts from 1970, and that jumps ahead and back."""
    source, points = UpperBodySource(robot), []
    for k in range(200):
        t = 0.02 * k
        n = int(20 * t + 1e-9)
        hands = dataclasses.replace(HandTargets.of(circle(n / 20), None), stamp=clock(n / 20), sequence=n)
        source.update(dataclasses.replace(make_state(robot.nominal), time=t), hands, Command(), 0.02)
        points.append(source.ik.hands(source.ik.q, 0.0)[0])
    speed = np.linalg.norm(np.diff(points[-45:], axis=0), axis=1) / 0.02
    assert speed.min() > SPEED / 1.5 and speed.max() < 1.5 * SPEED
    assert not source.watch.tally.counts["stale"] and not source.watch.tally.counts["late"]

"""A motion capture is believed while it says what the robot's IMU and odometry say, whatever its world's heading."""

import dataclasses

import numpy as np
import pytest

from hugwbc import rotations
from hugwbc.runtime.capture_check import CaptureCheck
from hugwbc.sim.scenes.objects import Picture
from tests.conftest import make_state

AXES = {"x": [1.0, 0, 0], "y": [0, 1.0, 0], "z": [0, 0, 1.0]}


def quarter(axis: str, turns: float = 1.0) -> np.ndarray:
    return rotations.from_axis_angle(np.array(AXES[axis]), turns * np.pi / 2)


def in_order_xyzw(p):
    return p[[0, 1, 2, 4, 5, 6, 3]]


def y_up(p):
    return np.array([p[0], p[2], -p[1], *rotations.multiply(quarter("x", -1.0), p[3:])])


def y_up_and_xyzw(p):
    return in_order_xyzw(y_up(p))


def millimetres(p):
    return p * [1e3, 1e3, 1e3, 1, 1, 1, 1]


def left_handed(p):
    return p * [1, -1, 1, 1, -1, 1, -1]


def mirrored(p):
    return p * [1, -1, 1, 1, 1, 1, 1]


def body_turned(axis, turns=1.0):
    return lambda p: np.array([*p[:3], *rotations.multiply(p[3:], quarter(axis, turns))])


def of_a_table(p):
    return np.array([1.5, 0.0, 0.8, 1.0, 0.0, 0.0, 0.0])


def watched(sent, *, delay=0.03, world_yaw=0.0, drift=1.0, seconds=5.0, noise=True, start=1.0, latency=0.0):
    """Stand for a second, then walk a curve with side steps; return the check, and when it refused after the start."""
    rng, check, admitted = np.random.default_rng(3), CaptureCheck(), None
    scatter = float(noise)

    def pose(t):
        walked = max(t - start, 0.0)
        yaw, sway = 0.4 * walked, 0.02 * np.sin(8.0 * t)
        position = np.array([0.4 * np.sin(yaw), 0.5 - 0.4 * np.cos(yaw) + 0.15 * walked + sway, 0.98])
        return np.concatenate((position, rotations.from_yaw_pitch_roll(yaw, 0.03 + 0.01 * np.sin(3 * t), sway)))

    for tick in range(round(seconds / 0.01)):
        t = 0.01 * tick
        then = max(t - latency, 0.0)
        own, seen = pose(then), pose(max(t - delay, 0.0))
        state = make_state(position=own[:3] * drift, time=then, age=t - then, orientation=own[3:])
        turn = rotations.from_yaw_pitch_roll(*(scatter * rng.normal(0.0, 0.0087, 3)))
        seen[:3] = rotations.rotation_z(world_yaw) @ seen[:3] + scatter * rng.normal(0.0, 0.003, 3) + [4.0, -2.0, 0.1]
        seen[3:] = rotations.multiply(rotations.multiply(quarter("z", world_yaw / np.pi * 2), seen[3:]), turn)
        picture = Picture(max(t - delay, 0.0), min(delay, t), np.zeros((0, 7)), sent(seen))
        admitted = check.admitted(picture, state)
        if check.refusal:
            return check, t - start
    assert admitted is not None and admitted.time > seconds - 0.1
    return check, None


@pytest.mark.parametrize("world_yaw", [0.0, 1.0, np.pi])
@pytest.mark.parametrize("drift", [0.9, 1.0, 1.1])
def test_a_world_of_any_heading_and_an_odometry_that_drifts_are_fine(world_yaw, drift):
    check, when = watched(lambda p: p, world_yaw=world_yaw, drift=drift)
    assert when is None, check.refusal


@pytest.mark.parametrize(
    ("sent", "words"),
    [
        (in_order_xyzw, "order x, y, z, w"),
        (y_up, "y up"),
        (y_up_and_xyzw, "order x, y, z, w and its world has y up"),
        (millimetres, "millimetres"),
        (left_handed, "left-handed"),
        (mirrored, "y of its positions has the wrong sign"),
        *((body_turned(axis), f"turned by 90 degrees about the pelvis' {axis}") for axis in "xyz"),
        (body_turned("z", 2.0), "turned by 180 degrees about the pelvis' z"),
        (body_turned("x", -1.0), "turned by 270 degrees about the pelvis' x"),
        (of_a_table, "another object's"),
    ],
)
@pytest.mark.parametrize("world_yaw", [0.0, 0.7])
def test_a_wrong_convention_is_refused_and_named_within_a_second_of_motion(sent, words, world_yaw):
    check, when = watched(sent, world_yaw=world_yaw)
    assert when is not None and when < 1.0 and words in check.refusal, (when, check.refusal)


def test_frozen_and_late_pictures_are_refused():
    first = []
    check, when = watched(lambda p: first[0] if first else first.append(p) or p, noise=False)
    assert when is not None and when < 0.0 and "frozen" in check.refusal, "it stands, but it sways"
    check, when = watched(lambda p: p, delay=0.5)
    assert when is not None and "too late" in check.refusal
    check, when = watched(lambda p: p, delay=-0.3)
    assert when is not None and "clock is ahead" in check.refusal
    check, when = watched(lambda p: p, latency=0.15)
    assert when is None, "the readings are late, not the pictures ahead"


def test_single_wrong_pictures_are_passed_over():
    count = iter(range(10**6))
    check, when = watched(lambda p: p[[0, 1, 2, 4, 5, 6, 3]] if next(count) % 10 == 9 else p)
    assert when is None, check.refusal


def test_one_picture_with_a_time_to_come_does_not_hide_the_next_ones():
    check, state = CaptureCheck(), make_state(position=np.array([0.0, 0.0, 0.98]), velocity=np.zeros(3))
    still = np.array([0.0, 0.0, 0.98, 1.0, 0.0, 0.0, 0.0])
    scatter = np.random.default_rng(0)
    for tick in range(300):
        time = 0.01 * tick + (3600.0 if tick == 120 else 0.0)
        picture = Picture(time, 0.03, np.zeros((0, 7)), still + np.r_[1e-4 * scatter.normal(size=3), np.zeros(4)])
        admitted = check.admitted(picture, dataclasses.replace(state, time=0.01 * tick + 0.03))
        assert admitted is not None and (admitted is picture) == (tick != 120), tick
    assert not check.refusal

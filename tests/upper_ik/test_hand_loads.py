"""Loads of the hands: turned to the world, ramped, kept within range, and carried by the source of the arms."""

import math

import numpy as np
import pytest

from hugwbc.commands import Command
from hugwbc.controller import UpperBody
from hugwbc.robot import load_robot
from hugwbc.targets import HEAVIEST, HandTargets
from hugwbc.upper_ik import UpperBodySource
from hugwbc.upper_ik.hand_loads import FORCE_RATE, HandLoads
from tests.conftest import make_state

DT = 0.02
ARMS = UpperBody.targets(np.zeros(8))


def targets(frame="pelvis", **loads):
    return HandTargets.of((0.3, 0.2, 0.1), (0.3, -0.2, 0.1), frame, **loads)


@pytest.mark.parametrize(
    "frame, expected", [("world", [15, 0, 0]), ("heading", [0, 15, 0]), ("pelvis", [0, 15 * math.cos(0.2), None])]
)
def test_forces_are_turned_from_the_frame_of_the_targets(frame, expected):
    loads, state = HandLoads(), make_state(yaw=math.pi / 2, pitch=0.2)
    for _ in range(50):
        arms = loads.apply(ARMS, targets(frame, left_force=(15, 0, 0)), state, DT)
    for value, wanted in zip(arms.hand_force[0], expected, strict=True):
        assert wanted is None or value == pytest.approx(wanted, abs=1e-9)
    assert np.linalg.norm(arms.hand_force[0]) == pytest.approx(15.0)
    assert not arms.hand_force[1].any()


def test_a_force_comes_and_goes_at_a_limited_rate():
    loads, state, last = HandLoads(), make_state(), np.zeros(3)
    for hands in [targets(left_force=(30, 0, 0))] * 20 + [targets()] * 20:
        force = loads.apply(ARMS, hands, state, DT).hand_force[0]
        assert np.linalg.norm(force - last) <= FORCE_RATE * DT + 1e-9
        last = force
    assert not last.any()


def test_payload_is_unknown_until_it_is_told_and_after_it_has_gone():
    loads, state = HandLoads(), make_state()
    assert loads.apply(ARMS, targets(), state, DT).payload is None
    for _ in range(50):
        arms = loads.apply(ARMS, targets(payload=(3, 0)), state, DT)
    assert arms.payload is not None and arms.payload.tolist() == [3.0, 0.0]
    first = loads.apply(ARMS, targets(), state, DT).payload
    assert first is not None and 2.0 < first[0] < 3.0
    for _ in range(50):
        arms = loads.apply(ARMS, targets(), state, DT)
    assert arms.payload is None


def test_absurd_loads_stay_within_their_ranges():
    hands = HandTargets(np.zeros(3), np.zeros(3), left_force=np.full(3, 1e300), payload=np.array([1e300, -5.0]))
    loads = HandLoads()
    for _ in range(200):
        arms = loads.apply(ARMS, hands, make_state(), DT)
    assert np.isfinite(arms.hand_force).all()
    assert arms.payload is not None and arms.payload.tolist() == [HEAVIEST, 0.0]


def test_the_source_of_the_arms_carries_the_loads():
    source = UpperBodySource(load_robot())
    hands = targets("world", right_force=(0, 0, -20), stiffness=300.0, payload=(1, 2))
    state = make_state(position=(0.0, 0.0, 0.98))
    for _ in range(50):
        arms, _ = source.update(state, hands, Command(), DT)
    assert np.allclose(arms.hand_force, [[0, 0, 0], [0, 0, -20]])
    assert arms.stiffness == 300.0
    assert arms.payload is not None and np.allclose(arms.payload, [1, 2])
    for _ in range(200):
        arms, _ = source.update(state, None, Command(), DT)
    assert not arms.indicator
    assert not arms.hand_force.any() and arms.payload is None

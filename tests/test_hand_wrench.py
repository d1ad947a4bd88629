"""What acts on the hands: turned to the world, ramped, and kept within range, from the targets to the arms' drives."""

import dataclasses
import math

import numpy as np
import pytest

from hugwbc.commands import Command
from hugwbc.controller import UpperBody
from hugwbc.hand_wrench import FREE, HEAVIEST, STRONGEST, HandWrench
from hugwbc.robot import load_robot
from hugwbc.runtime.arms import ArmDrive
from hugwbc.runtime.safety_report import SafetyLog
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import UpperBodySource
from tests.conftest import make_state

DT = 0.02


def targets(frame="pelvis", **loads):
    return HandTargets.of((0.3, 0.2, 0.1), (0.3, -0.2, 0.1), frame, **loads)


@pytest.mark.parametrize(
    "frame, expected", [("world", [15, 0, 0]), ("heading", [0, 15, 0]), ("pelvis", [0, 15 * math.cos(0.2), None])]
)
def test_forces_are_turned_from_the_frame_of_the_targets(frame, expected):
    source, state = UpperBodySource(load_robot()), make_state(yaw=math.pi / 2, pitch=0.2, position=(0.0, 0.0, 0.98))
    arms, _ = source.update(state, targets(frame, left_force=(15, 0, 0)), Command(), DT)
    for value, wanted in zip(arms.wrench.force[0], expected, strict=True):
        assert wanted is None or value == pytest.approx(wanted, abs=1e-9)
    assert np.linalg.norm(arms.wrench.force[0]) == pytest.approx(15.0)
    assert not arms.wrench.force[1].any()


def test_a_force_comes_and_goes_at_a_limited_rate():
    wrench, pressing = FREE, HandWrench.of(left=(18, 0, -24))
    forces = []
    for goal in [pressing] * 20 + [FREE] * 20:
        wrench = wrench.towards(goal, DT)
        forces.append(wrench.force[0])
    steps = np.linalg.norm(np.diff(forces, axis=0, prepend=0.0), axis=1)
    assert forces[19] == pytest.approx([18, 0, -24]) and wrench is FREE
    # 30 N at 100 N/s, up and down
    assert steps == pytest.approx(([2.0] * 15 + [0.0] * 5) * 2, abs=1e-9)


def test_one_stiffness_becomes_another_at_a_limited_rate():
    wrench = FREE.towards(HandWrench.of(stiffness=200.0), DT)
    assert wrench.stiffness == 200.0, "from the servo's own, the drives are blended"
    later = [wrench := wrench.towards(HandWrench.of(stiffness=290.0), DT) for _ in range(3)]
    assert [one.stiffness for one in later] == pytest.approx([260.0, 290.0, 290.0])
    assert wrench.towards(FREE, DT) is FREE


def test_payload_is_unknown_until_it_is_told_and_after_it_has_gone():
    wrench = FREE.towards(FREE, DT)
    assert wrench.payload is None
    for _ in range(50):
        wrench = wrench.towards(HandWrench.of(payload=(3, 0)), DT)
    assert wrench.payload is not None and wrench.payload.tolist() == [3.0, 0.0]
    np.testing.assert_allclose(wrench.total, [[0.0, 0.0, -29.43], [0.0, 0.0, 0.0]])
    first = wrench.towards(FREE, DT).payload
    assert first is not None and 2.0 < first[0] < 3.0
    for _ in range(50):
        wrench = wrench.towards(FREE, DT)
    assert wrench.payload is None


def test_absurd_loads_stay_within_their_ranges():
    absurd, wrench = HandWrench(np.outer((1e300, -1e300), np.ones(3)), np.array([1e300, -5.0]), 1e9), FREE
    for _ in range(200):
        wrench = wrench.towards(absurd.limited(), DT)
    np.testing.assert_allclose(wrench.force, np.outer((STRONGEST, -STRONGEST), np.ones(3)) / math.sqrt(3.0))
    assert wrench.stiffness == 5000.0
    assert wrench.payload is not None and wrench.payload.tolist() == [HEAVIEST, 0.0]


def test_a_force_that_is_too_strong_keeps_its_direction_and_is_reported():
    """As of a behaviour for a larger robot, which does not pass `HandWrench.of`."""
    drive, arms = ArmDrive(load_robot(), log := SafetyLog()), UpperBody.targets(np.zeros(8))
    strong = dataclasses.replace(arms, wrench=HandWrench(np.array([[240.0, 0.0, 180.0], [0.0, -200.0, 0.0]])))
    for _ in range(150):
        told = drive(strong, make_state(), DT).wrench
    np.testing.assert_allclose(told.force, [[160.0, 0.0, 120.0], [0.0, -200.0, 0.0]])
    assert log.report().wrench_limited == 150 and "above 200 N" in log.report().messages[0]
    within = HandWrench.of(left=(160, 0, 120), payload=(HEAVIEST, 0), stiffness=50.0)
    assert within.limited() is within and FREE.limited() is FREE


def test_the_drive_of_the_arms_carries_the_wrench_until_they_are_back():
    source, drive = UpperBodySource(load_robot()), ArmDrive(load_robot(), SafetyLog())
    hands = targets("world", right_force=(0, 0, -20), stiffness=300.0, payload=(1, 2))
    state = make_state(position=(0.0, 0.0, 0.98))
    for _ in range(50):
        arms = drive(source.update(state, hands, Command(), DT)[0], state, DT)
    assert np.allclose(arms.wrench.force, [[0, 0, 0], [0, 0, -20]])
    assert arms.wrench.stiffness == 300.0
    assert arms.wrench.payload is not None and np.allclose(arms.wrench.payload, [1, 2])
    for _ in range(200):
        arms = drive(source.update(state, None, Command(), DT)[0], state, DT)
        assert np.isfinite(arms.tau).all()
    assert not arms.indicator and arms.wrench is FREE

"""Arms under external control: which targets are admitted, and how the arms change hands."""

import dataclasses

import numpy as np
import pytest

from hugwbc import JointCommand, UpperBody, load_robot
from hugwbc.controller import override_arms
from hugwbc.hand_wrench import FREE, HandWrench
from hugwbc.runtime.arms import BAND, LEARNED, ArmDrive, Handover, PayloadObserver
from hugwbc.runtime.safety_report import SafetyLog
from tests.conftest import make_state

ROBOT = load_robot()
DT = 0.02


def test_external_arm_targets_are_checked():
    log = SafetyLog()
    drive = ArmDrive(ROBOT, log)

    def driven(arms):
        return drive(arms, make_state(), DT).q

    driven(UpperBody.targets(np.full(8, 0.1)))
    bad = UpperBody(np.full(8, np.nan), np.zeros(8), np.ones(8, dtype=bool))
    np.testing.assert_array_equal(driven(bad), 0.1)
    np.testing.assert_array_equal(driven(UpperBody(np.zeros(7), np.zeros(8), np.ones(8, dtype=bool))), 0.1)
    np.testing.assert_array_equal(driven(UpperBody.targets(np.zeros(14))), 0.1)
    np.testing.assert_array_equal(driven(UpperBody.targets(np.full(8, 9.0))), ROBOT.upper[ROBOT.arms])
    np.testing.assert_array_equal(driven(UpperBody.targets(np.full(8, -9.0))), ROBOT.lower[ROBOT.arms])
    assert (log.report().upper_body_rejected, log.report().upper_body_limited) == (3, 2)
    again = UpperBody.targets(np.full(8, 0.2))
    driven(again)
    again.q[0] = again.dq[0] = np.nan
    np.testing.assert_array_equal(driven(again), 0.2)
    assert log.report().upper_body_rejected == 4


def test_free_arms_have_as_many_targets_as_joints():
    """A controller may mix them with its own by the mask: `np.where(upper_body.mask, upper_body.q, own)`."""
    free = ArmDrive(ROBOT, SafetyLog())(UpperBody.none(), make_state(), 0.02)
    assert not free.indicator
    assert free.q.shape == free.dq.shape == free.mask.shape == free.ddq.shape == ROBOT.arms.shape


def test_the_arm_command_does_not_jump_and_the_rest_is_untouched():
    handover = Handover(ROBOT.arms)
    swing = 0.3 * np.sin(np.arange(100) * 0.1)
    external = UpperBody.targets(np.full(8, 0.5))
    streams = []
    for tick in range(100):
        q = ROBOT.nominal + swing[tick]
        q[ROBOT.arms] = 0.5 if tick < 40 else q[ROBOT.arms]
        command = JointCommand.position(ROBOT, q)
        smooth = handover(command, external if tick < 40 else UpperBody.none(), DT)
        assert smooth.q[ROBOT.legs] == pytest.approx(command.q[ROBOT.legs])
        if tick < 40 or tick >= 40 + 25:
            assert smooth.q == pytest.approx(q)
        streams.append(smooth.q[ROBOT.arms])
    steps = np.abs(np.diff(streams, axis=0)).max(axis=1)
    assert np.abs(0.5 - (ROBOT.nominal[ROBOT.arms] + swing[40])).max() > 0.3, "it would have jumped"
    assert steps.max() < 0.1


def test_a_second_arm_that_is_taken_over_does_not_jump():
    handover, half = Handover(ROBOT.arms), np.arange(8) < 4
    commands = []
    for tick in range(60):
        mask = half if tick < 30 else np.ones(8, dtype=bool)
        q = ROBOT.nominal.copy()
        q[ROBOT.arms[mask]] = 0.5
        commands.append(handover(JointCommand.position(ROBOT, q), UpperBody(np.full(8, 0.5), np.zeros(8), mask), DT))
    steps = np.abs(np.diff([command.q[ROBOT.arms] for command in commands], axis=0)).max(axis=1)
    assert steps.max() < 0.1 and commands[-1].q[ROBOT.arms] == pytest.approx(0.5)


def test_neither_takeover_nor_hand_back_changes_the_torque_at_once():
    """The servo has other gains and another torque than the controller, and fades in and out."""
    own = JointCommand.position(ROBOT, ROBOT.nominal)
    nominal, tau, kp, kd = ROBOT.nominal[ROBOT.arms], np.full(8, 5.0), np.full(8, 140.0), np.full(8, 8.0)
    targets = dataclasses.replace(UpperBody.targets(nominal), tau=tau, kp=kp, kd=kd)
    handover, measured, speed = Handover(ROBOT.arms), ROBOT.nominal - 0.1, np.full(19, 0.5)
    torques = []
    for tick in range(120):
        arms = targets if 40 <= tick < 80 else UpperBody.none()
        command = handover(override_arms(own, arms, ROBOT), arms, DT)
        torques.append((command.tau + command.kp * (command.q - measured) + command.kd * (command.dq - speed))[11])
    before, taken = 20.0 * 0.1 - 0.5 * 0.5, 5.0 + 140.0 * 0.1 - 8.0 * 0.5
    assert [torques[t] for t in (39, 40, 79, 80, 119)] == pytest.approx([before, before, taken, taken, before])
    assert np.abs(np.diff(torques)).max() < 1.5


def test_softer_and_stiffer_hands_do_not_change_the_torque_at_once():
    """A wanted stiffness changes the gains, and ends what was learned of a payload."""
    drive, handover, measured, torques = ArmDrive(ROBOT, SafetyLog()), Handover(ROBOT.arms), ROBOT.nominal - 0.1, []
    state, own = dataclasses.replace(pulled(-30.0), q=measured), JointCommand.position(ROBOT, ROBOT.nominal)
    for stiffness in (None, 200.0, 2000.0, None):
        targets = UpperBody.targets(ROBOT.nominal[ROBOT.arms])
        targets = dataclasses.replace(targets, wrench=HandWrench(stiffness=stiffness))
        for _ in range(50):
            arms = drive(targets, state, DT)
            command = handover(override_arms(own, arms, ROBOT), arms, DT)
            torques.append((command.tau + command.kp * (command.q - measured))[ROBOT.arms])
    assert np.abs(np.diff(torques, axis=0)).max() < 2.5
    assert np.abs(torques[50] - torques[99]).max() > 8.0, "it would have jumped"


# The learned payload: from the vertical force, slowly, beyond the friction; and where nothing is learned.
BODY = UpperBody.targets(np.zeros(8))


def pulled(left, right=0.0):
    state = make_state(load_robot().nominal)
    return dataclasses.replace(state, hand_force=np.array([[0.0, 0.0, left], [3.0, 0.0, right]]))


def learn(observer, body, state, time=4.0):
    for _ in range(round(time / DT)):
        body_now = (observer if isinstance(observer, ArmDrive) else observer.complete)(body, state, DT)
    return body_now


def test_a_weight_is_learned_up_to_the_friction():
    observer = PayloadObserver()
    first = observer.complete(BODY, pulled(-30.0), DT)
    assert first.wrench.payload is not None and 0.0 < first.wrench.payload[0] < 0.5, "not at once"
    body = learn(observer, BODY, pulled(-30.0))
    assert body.wrench.payload is not None
    assert body.wrench.payload[0] == pytest.approx((30.0 - BAND) / 9.81, abs=0.01)
    assert body.wrench.payload[1] == 0.0
    learn(observer, BODY, pulled(0.0))
    assert observer.payload[0] == pytest.approx(BAND / 9.81, abs=0.01)


def test_a_reset_forgets_what_the_hands_carry_and_meet():
    drive, pushing = ArmDrive(ROBOT, SafetyLog()), dataclasses.replace(BODY, wrench=HandWrench.of(left=(9.0, 0.0, 0.0)))
    carried = learn(drive, pushing, pulled(-30.0)).wrench
    assert carried.payload is not None and carried.force[0, 0] == 9.0
    drive.reset()
    assert drive(BODY, pulled(0.0), DT).wrench is FREE


def test_friction_and_upward_forces_are_no_payload_and_the_rest_is_bounded():
    observer = PayloadObserver()
    for force in (-1.4, 1.4, 25.0):
        assert learn(observer, BODY, pulled(force)) is BODY
    body = learn(observer, BODY, pulled(-500.0), 10.0)
    assert body.wrench.payload is not None and body.wrench.payload[0] == LEARNED


def test_a_wanted_force_is_no_payload():
    pressing = dataclasses.replace(BODY, wrench=HandWrench.of(left=(0.0, 0.0, -20.0)))
    observer = PayloadObserver()
    assert learn(observer, pressing, pulled(-20.0)) is pressing
    down = dataclasses.replace(BODY, wrench=HandWrench.of((0.0, 0.0, 40.0), (0.0, -60.0, 0.0)))
    body = learn(observer, down, pulled(0.0, -30.0))
    assert body.wrench.payload is not None and body.wrench.payload[0] == 0.0, "a hand that meets nothing would float"
    assert body.wrench.payload[1] == pytest.approx((30.0 - BAND) / 9.81, abs=0.01), (
        "what both hands squeeze has a weight"
    )


def test_a_told_payload_counts_and_a_soft_hand_gives_way():
    observer, told = PayloadObserver(), dataclasses.replace(BODY, wrench=HandWrench.of(payload=(1.0, 2.0)))
    assert observer.complete(told, pulled(-40.0), DT) is told
    assert observer.payload.tolist() == [1.0, 2.0]
    soft = dataclasses.replace(BODY, wrench=HandWrench.of(stiffness=200.0))
    assert learn(observer, soft, pulled(-40.0)) is soft
    learn(observer, BODY, pulled(-40.0))

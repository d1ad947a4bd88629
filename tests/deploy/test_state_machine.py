"""The modes and their joint commands."""

import dataclasses

import numpy as np
import pytest

from hugwbc import load_robot
from hugwbc.deploy.state_machine import START_TIME, Mode, StateMachine, damping

H1 = load_robot()


@pytest.fixture
def machine() -> StateMachine:
    return StateMachine(H1)


def test_idle_sends_nothing_and_a_run_is_the_controllers(machine, still) -> None:
    assert machine.command(0.0) is None
    machine.enter(Mode.RUN, "test", still)
    assert machine.command(0.0) is None


def test_the_start_pose_is_reached_in_its_time_with_ramped_gains(machine, still) -> None:
    machine.enter(Mode.START_POSE, "test", still)
    begin = machine.command(still.time)
    assert begin is not None
    np.testing.assert_allclose(begin.q, still.q)
    assert not np.any((begin.kp, begin.kd))
    times = still.time + np.arange(0.0, START_TIME + 0.01, 0.002)
    commands = [machine.command(time) for time in times]
    q, kp, kd = (np.array([getattr(c, name) for c in commands]) for name in ("q", "kp", "kd"))
    assert np.all(np.diff(kp, axis=0) >= 0.0) and np.all(np.diff(kd, axis=0) >= 0.0)
    np.testing.assert_allclose(q[-1], H1.nominal)
    np.testing.assert_allclose((kp[-1], kd[-1]), (H1.kp, H1.kd))
    assert np.abs(np.diff(q, axis=0)).max() / 0.002 < 2.0 * np.abs(H1.nominal - still.q).max() / START_TIME
    assert not machine.in_start_pose(still.time + 4.99)
    assert machine.in_start_pose(still.time + 5.0)


def test_damping_only_slows(machine, still) -> None:
    machine.enter(Mode.DAMPING, "test", still)
    command = machine.command(0.0)
    assert command is not None and not np.any((command.kp, command.tau, command.dq))
    assert set(command.kd) == {8.0} == set(damping(H1).kd)


def test_every_event_is_told_with_its_reason(still) -> None:
    told = []
    machine = StateMachine(H1, lambda event: told.append(str(event)))
    machine.enter(Mode.ZERO_TORQUE, "the robot sends states", still)
    machine.refuse("too early", 1.5)
    machine.refuse("too early", 1.6)
    machine.refuse("too late", 1.7)
    assert "idle -> zero torque: the robot sends states" in told[0]
    assert [line.partition("] ")[2] for line in told[1:]] == [
        "zero torque: refused: too early",
        "zero torque: refused: too late",
    ]


def test_a_posture_that_is_not_a_number_is_no_start(machine, still) -> None:
    machine.enter(Mode.START_POSE, "test", dataclasses.replace(still, q=np.full(19, np.nan)))
    command = machine.command(0.0)
    assert command is not None and command.is_finite

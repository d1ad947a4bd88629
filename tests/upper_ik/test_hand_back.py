import dataclasses

import numpy as np
import pytest

from hugwbc.controller import JointCommand, UpperBody
from hugwbc.upper_ik import HandBack

DT = 0.02


def test_the_arm_command_does_not_jump_and_the_rest_is_untouched(robot):
    hand_back = HandBack()
    swing = 0.3 * np.sin(np.arange(100) * 0.1)
    external = UpperBody.targets(np.full(8, 0.5))
    streams = []
    for tick in range(100):
        q = robot.nominal + swing[tick]
        q[robot.arms] = 0.5 if tick < 40 else q[robot.arms]
        command = JointCommand.position(robot, q)
        smooth = hand_back(command, external if tick < 40 else UpperBody.none(), DT)
        assert smooth.q[robot.legs] == pytest.approx(command.q[robot.legs])
        if tick < 40 or tick >= 40 + 25:
            assert smooth.q == pytest.approx(q)
        streams.append(smooth.q[robot.arms])
    steps = np.abs(np.diff(streams, axis=0)).max(axis=1)
    assert np.abs(0.5 - (robot.nominal[robot.arms] + swing[40])).max() > 0.3, "it would have jumped"
    assert steps.max() < 0.1


def test_a_bad_command_passes_for_the_filter_to_see(robot):
    hand_back = HandBack()
    command = JointCommand.position(robot, robot.nominal)
    hand_back(command, UpperBody.targets(np.zeros(8)), DT)
    bad = dataclasses.replace(command, q=np.full(19, np.nan))
    assert hand_back(bad, UpperBody.none(), DT) is bad

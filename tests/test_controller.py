"""Joint commands, the external upper body and the takeover of the arms."""

import dataclasses

import numpy as np
import pytest

from hugwbc import JointCommand, UpperBody, load_robot
from hugwbc.controller import override_arms
from hugwbc.errors import HugwbcError, TargetError

ROBOT = load_robot()


def test_position_command_holds_with_the_nominal_gains() -> None:
    command = JointCommand.position(ROBOT, ROBOT.nominal)
    np.testing.assert_array_equal(command.q, ROBOT.nominal)
    np.testing.assert_array_equal(command.kp, ROBOT.kp)
    np.testing.assert_array_equal(command.kd, ROBOT.kd)
    assert not command.dq.any() and not command.tau.any()


@pytest.mark.parametrize("field", [f.name for f in dataclasses.fields(JointCommand)])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_one_bad_number_anywhere_is_noticed(field: str, bad: float) -> None:
    command = JointCommand.position(ROBOT, ROBOT.nominal)
    assert command.is_finite
    values = getattr(command, field).copy()
    values[7] = bad
    assert not dataclasses.replace(command, **{field: values}).is_finite


@pytest.mark.parametrize(
    ("targets", "message"),
    [
        ({"q": np.full(8, np.nan)}, "arm positions .*nan.* Robot.arm_names, in radians"),
        ({"dq": np.full(8, np.inf)}, "arm velocities .* in radians per second"),
        ({"ddq": np.full(8, np.nan)}, "arm accelerations .* in radians per second squared"),
        ({"tau": np.zeros(3)}, "arm torques .* in newton metres"),
    ],
)
def test_bad_arm_targets_are_refused(targets: dict, message: str) -> None:
    with pytest.raises(TargetError, match=message) as caught:
        UpperBody.targets(**({"q": np.zeros(8)} | targets))
    assert isinstance(caught.value, HugwbcError)


def test_override_replaces_the_masked_arm_joints_only() -> None:
    rng = np.random.default_rng(0)
    given = JointCommand(*(rng.normal(size=19) for _ in range(5)))
    before = {f.name: getattr(given, f.name).copy() for f in dataclasses.fields(given)}
    mask = np.array([True, False, False, True, False, True, False, False])
    upper = UpperBody(np.linspace(0.1, 0.8, 8), np.linspace(-0.4, 0.3, 8), mask)
    result = override_arms(given, upper, ROBOT)

    taken = [11, 14, 16]  # left shoulder pitch, left elbow, right shoulder roll
    kept = np.setdiff1d(np.arange(19), taken)
    np.testing.assert_allclose(result.q[taken], [0.1, 0.4, 0.6])
    np.testing.assert_allclose(result.dq[taken], [-0.4, -0.1, 0.1])
    np.testing.assert_array_equal(result.kp[taken], 20.0)
    np.testing.assert_array_equal(result.kd[taken], 0.5)
    np.testing.assert_array_equal(result.tau[taken], 0.0)
    for name, values in before.items():
        np.testing.assert_array_equal(getattr(result, name)[kept], values[kept])
        np.testing.assert_array_equal(getattr(given, name), values)  # the input is not modified


def test_override_passes_the_torque_and_the_gains_of_the_targets() -> None:
    mask = np.arange(8) < 4
    upper = dataclasses.replace(
        UpperBody.targets(np.zeros(8), tau=np.linspace(1.0, 8.0, 8)), mask=mask, kp=np.full(8, 99.0), kd=np.full(8, 7.0)
    )
    result = override_arms(JointCommand.position(ROBOT, ROBOT.nominal), upper, ROBOT)
    taken, kept = ROBOT.arms[mask], ROBOT.arms[~mask]
    np.testing.assert_allclose(result.tau[taken], [1.0, 2.0, 3.0, 4.0])
    np.testing.assert_array_equal(result.tau[kept], 0.0)
    np.testing.assert_array_equal([result.kp[taken], result.kp[kept]], [[99.0] * 4, [20.0] * 4])
    np.testing.assert_array_equal([result.kd[taken], result.kd[kept]], [[7.0] * 4, [0.5] * 4])


def test_override_without_takeover_is_the_command_itself() -> None:
    command = JointCommand.position(ROBOT, ROBOT.nominal)
    assert override_arms(command, UpperBody.none(), ROBOT) is command

"""Parameters for robots of other sizes: what physics has no unit for must not change."""

import dataclasses

import pytest

from hugwbc import load_robot
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.mbc import WholeBodyController
from hugwbc.mbc.params import ControllerParams


def test_parameters_of_another_size_are_similar():
    h1, g1 = (load_robot(name) for name in ("h1", "g1"))
    params = ControllerParams()
    assert params.of_size(h1) == params
    small = params.of_size(dataclasses.replace(g1, qp={}))

    def without_units(robot, params):
        return (
            params.step_width / robot.leg_length,
            params.lowering_from**2 / (9.81 * robot.leg_length),  # the Froude number
            params.max_normal_force / (9.81 * robot.mass),
            params.force_regularisation * robot.mass**2,
            params.momentum_weight[0] * (robot.mass * robot.leg_length**2) ** 2,
            params.cop_gain,
        )

    assert without_units(g1, small) == pytest.approx(without_units(h1, params))


def test_a_controllers_parameters_are_of_the_size_of_the_robot_once():
    g1, given = load_robot("g1"), ControllerParams(step_width=0.26)
    first = WholeBodyController(g1, given)
    assert first.params is given
    assert WholeBodyController(g1, first.params)._params == first._params == given.of_size(g1)
    assert WholeBodyController(g1).params == ControllerParams()


def test_a_robots_table_has_the_last_word_on_defaults_only():
    robot = dataclasses.replace(load_robot("g1"), qp={"arm_weight": 0.3, "velocity_rate": [0.7, 1.0, 2.0]})
    params = ControllerParams().of_size(robot)
    assert (params.arm_weight, params.velocity_rate) == (0.3, (0.7, 1.0, 2.0))
    assert ControllerParams(arm_weight=0.9).of_size(robot).arm_weight == 0.9, "a user's own"
    with pytest.raises(UnknownNameError, match="arm_weight"):
        ControllerParams().of_size(dataclasses.replace(robot, qp={"arm_wait": 0.3}))
    with pytest.raises(ConfigError, match=r"arm_weight is -0\.3; it should be greater than or equal to 0"):
        ControllerParams().of_size(dataclasses.replace(robot, qp={"arm_weight": -0.3}))


def test_a_reach_forward_before_the_one_backward_is_refused():
    with pytest.raises(ConfigError, match=r"max_step\.0 is 0\.75; it should be less than or equal to 0"):
        ControllerParams(max_step=(0.75, -0.6))

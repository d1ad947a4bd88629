import dataclasses
import math
import pathlib
from typing import Any

import numpy as np
import pytest
import torch

from hugwbc.commands import COMMAND_NAMES, Command, default_command
from hugwbc.controller import UpperBody
from hugwbc.errors import HugwbcError
from hugwbc.gait import Gait
from hugwbc.learned.config import EnvConfig
from hugwbc.learned.policy import load_policy, save_policy
from hugwbc.learned.policy.feed_forward import FeedForward
from hugwbc.learned.policy.networks import Actor
from hugwbc.state import RobotState

V_X = COMMAND_NAMES.index("v_x")
CURVES = {"walking": {"v_x": [[0.0, 0.0], [1.0, 0.9], [2.0, 2.0]]}}
STATE = RobotState(np.zeros(19), np.zeros(19), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))


def asked(v_x: float, gait: Gait = Gait.WALKING, curves: Any = CURVES) -> float:
    command = np.zeros((1, 8))
    command[0, V_X] = v_x
    return float(FeedForward(curves).asked(command, np.array([int(gait)]))[0, V_X])


def test_it_is_linear_between_its_knots_and_constant_beyond() -> None:
    assert [asked(v) for v in (0.0, 0.5, 1.0, 1.5, 2.0)] == pytest.approx([0.0, 0.45, 0.9, 1.45, 2.0])
    assert asked(-0.3) == pytest.approx(-0.3) and asked(2.2) == pytest.approx(2.2)


def test_other_gaits_and_commands_stay_as_they_are() -> None:
    assert asked(1.0, Gait.JUMPING) == 1.0 and asked(1.0, curves={}) == 1.0


def test_the_commands_of_the_caller_are_not_changed() -> None:
    command = np.ones((2, 8))
    result = FeedForward(CURVES).asked(command, np.array([int(Gait.WALKING), int(Gait.STANDING)]))
    assert (command == 1.0).all() and result[0, V_X] == 0.9 and result[1, V_X] == 1.0


def test_a_policy_with_it_acts_as_one_that_is_asked_for_more(tmp_path: pathlib.Path) -> None:
    torch.manual_seed(0)
    actor = Actor(63, 18, 19)
    save_policy(tmp_path / "plain.safetensors", actor, EnvConfig().contract(), {})
    save_policy(
        tmp_path / "fed.safetensors", actor, dataclasses.replace(EnvConfig().contract(), feed_forward=CURVES), {}
    )
    plain, fed = load_policy(tmp_path / "plain.safetensors"), load_policy(tmp_path / "fed.safetensors")

    def act(controller: Any, v_x: float) -> np.ndarray:
        controller.reset(STATE)
        command: Command = default_command(Gait.WALKING)
        return controller.act(STATE, dataclasses.replace(command, v_x=v_x), UpperBody.none()).q

    np.testing.assert_array_equal(act(fed, 1.0), act(plain, 0.9))
    assert np.abs(act(fed, 1.0) - act(plain, 1.0)).max() > 1e-4


def knots(*points: object) -> dict[str, Any]:
    return {"walking": {"v_x": list(points)}}


@pytest.mark.parametrize(
    "curves",
    [
        *(3, {"strolling": {}}, {"walking": 3}, {"walking": {"f": [[1.0, 1.0], [2.0, 2.0]]}}),
        *(knots([0.0, 0.0]), knots(*[[0.0, 0.0]] * 101), knots([0.0, 0.0], [0.0, 0.0]), knots([1.0, 1.0], [0.0, 0.0])),
        *(knots([0.0, 0.0], [1.0, 1.4]), knots([0.0, 0.0], [1.0, math.nan]), knots([0.0, "a"], [1.0, 1.0])),
        knots([0.0], [1.0, 1.0]),
    ],
)
def test_a_malformed_one_is_refused(curves: Any) -> None:
    with pytest.raises(HugwbcError):
        dataclasses.replace(EnvConfig().contract(), feed_forward=curves)

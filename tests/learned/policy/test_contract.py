import dataclasses
import json
import math
import pathlib
import re
import shutil
from typing import Any

import numpy as np
import pytest
import torch

import hugwbc
from hugwbc.commands import COMMAND_NAMES, Command, default_command
from hugwbc.controller import UpperBody
from hugwbc.errors import ConfigError, HugwbcError, PolicyFileError, UnknownNameError
from hugwbc.gait import Gait
from hugwbc.learned.config import EnvConfig, TrainConfig
from hugwbc.learned.policy import load_policy, save_policy, shipped_contracts
from hugwbc.learned.policy.contract import Contract, History, Term, contract_of, load_contract
from hugwbc.learned.policy.networks import Actor
from hugwbc.learned.policy.records import settings_record
from hugwbc.robot import load_robot
from hugwbc.robot_tables import models_dir
from hugwbc.state import RobotState

PLACE = pathlib.Path("the_file")
V_X = COMMAND_NAMES.index("v_x")
CURVES = {"walking": {"v_x": [[0.0, 0.0], [1.0, 0.9], [2.0, 2.0]]}}
STATE = RobotState(np.zeros(19), np.zeros(19), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
GOOD = """\
policy: net.onnx
period: 0.01
joints: [left_knee_joint, torso_joint]
default_pose: [0.3, 0]
kp: 100
kd: [2, 3]
action_scale: [0.25, 0.5]
action_clip: 10
observation_clip: 100
clock_period: 0.7
history: {frames: 3, order: newest_first, layout: by_term, start: zeros}
held_pose: {left_elbow_joint: 0.5}
state: {h_in: h_out}
observation:
  - gravity
  - command: {names: [h, v_x], scale: [2, 1]}
  - absolute_joint_position: {joints: [torso_joint]}
  - joint_velocity: {scale: 0.05}
  - last_action
  - phase_sin: {offset: 0.5}
  - constant: {value: [1, 2]}
"""


def read(tmp_path: pathlib.Path, text: str) -> Contract:
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    return load_contract(path)


def test_a_contract_is_what_the_file_says(tmp_path):
    contract = read(tmp_path, GOOD)
    assert contract.name == "mine" and contract.policy == tmp_path / "net.onnx" and contract.period == 0.01
    assert contract.joints == ("left_knee_joint", "torso_joint") and contract.default_pose == (0.3, 0.0)
    assert contract.kp == (100.0, 100.0) and contract.kd == (2.0, 3.0) and contract.action_scale == (0.25, 0.5)
    assert contract.action_clip == 10.0 and contract.observation_clip == 100.0 and contract.clock_period == 0.7
    assert contract.history == History(3, "newest_first", "by_term", "zeros")
    assert contract.held_pose == {"left_elbow_joint": 0.5} and contract.state == {"h_in": "h_out"}
    assert contract.observation == (
        Term("gravity"),
        Term("command", scale=(2.0, 1.0), names=("h", "v_x")),
        Term("absolute_joint_position", joints=("torso_joint",)),
        Term("joint_velocity", scale=0.05),
        Term("last_action"),
        Term("phase_sin", offset=0.5),
        Term("constant", value=(1.0, 2.0)),
    )
    assert contract.input_sizes == (3 * 13,)
    assert (
        contract_of({"contract": json.loads(json.dumps(dataclasses.asdict(contract), default=str))}, PLACE) == contract
    )


def test_the_shipped_contracts_are_those_of_public_policies():
    g1 = {"holosoma": 100, "leggedlab": 96, "playground": 103, "unitree": 47, "unitree-lab": 5 * 96}  # their inputs
    assert shipped_contracts() == sorted([*(f"{name}-g1" for name in g1), "leggedlab-h1", "unitree-h1"])
    for name, size in g1.items():
        contract = load_contract(f"{name}-g1")
        assert contract.robot == "g1" and contract.input_sizes == (size,)
    contract = load_contract("unitree-h1")
    assert contract.input_sizes == (41,) and len(contract.joints) == 10 and contract.policy is None
    assert contract.name == "unitree-h1" and contract.period == 0.02 and contract.clock_period == 0.8
    assert contract.action_clip is None and not contract.follows_gait


@pytest.mark.parametrize(
    ("old", "new", "place", "message"),
    [
        ("period: 0.01", "period: 5", 2, "period is 5"),
        ("period: 0.01", "period: fast", 2, "period is 'fast'"),
        ("period: 0.01", "perod: 0.01", 2, "unknown Contract field 'perod'. Did you mean 'period'"),
        ("period: 0.01\n", "", 1, "period is missing"),
        ("torso_joint]\ndef", "torso]\ndef", 3, "unknown joint 'torso'. Did you mean 'torso_joint'"),
        ("torso_joint]\ndef", "left_knee_joint]\ndef", 3, "'left_knee_joint' is listed twice"),
        ("[0.3, 0]", "[0.3, 0, 0]", 4, "found 3 numbers; give 2, one per joint, or a single one for all"),
        ("[0.3, 0]", "[17.2, 0]", 4, "left_knee_joint is at 17.2 rad, and turns from -0.26 to 2.05 rad"),
        ("left_elbow_joint: 0.5", "left_elbow_joint: 28.6", 12, "left_elbow_joint is at 28.6 rad, and turns from"),
        ("kp: 100", "kp: .nan", 5, "kp"),
        ("kd: [2, 3]", "kd: [2, -1]", 6, "kd.1 is -1"),
        ("action_clip: 10", "action_clip: 0", 8, "action_clip is 0"),
        ("frames: 3", "frames: 0", 11, "frames is 0"),
        ("by_term", "by_turm", 11, "'by_turm'. Did you mean 'by_term'"),
        ("left_elbow_joint: 0.5", "torso_joint: 0.5", 12, "the policy moves 'torso_joint'"),
        ("{h_in: h_out}", "h_in", 13, "state is 'h_in'"),
        ("- gravity", "- gravty", 15, "unknown observation term 'gravty'. Did you mean 'gravity'"),
        ("[h, v_x]", "[h, vx]", 16, "unknown command 'vx'. Did you mean 'v_x'"),
        ("scale: [2, 1]", "scale: [2, 1, 1]", 16, "command has 3 scales; give 2"),
        ("{scale: 0.05}", "{factor: 0.05}", 18, "unknown Term field 'factor'"),
        ("- constant: {value: [1, 2]}", "- constant", 21, "a constant, and nothing else, has a value"),
        ("- gravity", "- gravity: {joints: [torso_joint]}", 15, "gravity takes no joints"),
        ("- gravity", "- gravity: {offset: 0.25}", 15, "gravity reads no clock; leave the offset out"),
        ("{offset: 0.5}", "{offset: 180}", 20, "offset is 180"),
    ],
)
def test_a_malformed_contract_is_refused_with_its_line(tmp_path, old, new, place, message):
    assert old in GOOD
    with pytest.raises(ConfigError) as caught:
        read(tmp_path, GOOD.replace(old, new, 1))
    assert str(caught.value).startswith(f"{tmp_path / 'mine.yaml'}:{place}:")
    assert message in str(caught.value)


def test_a_contract_that_is_not_there_is_refused():
    with pytest.raises(UnknownNameError, match="Did you mean 'unitree-h1'"):
        load_contract("unitree-h2")


def test_the_contract_in_the_docs_is_the_shipped_one(tmp_path):
    page = pathlib.Path(hugwbc.__file__).parent.parent / "docs" / "evaluation.md"
    (text,) = re.findall(r"```yaml\n(.*?)```", page.read_text(), re.DOTALL)
    shown, shipped = read(tmp_path, text), load_contract("unitree-h1")
    assert dataclasses.replace(shown, name=shipped.name, policy=None) == shipped


def test_ours_has_the_sizes_of_the_networks_and_the_settings_of_the_training():
    env = EnvConfig(substeps=2, action_scale=0.3, yaw_action_factor=0.5, waist_rate=0.0, robot="h1-2023")
    robot, contract = load_robot("h1-2023"), env.contract()
    assert contract.input_sizes == (315, 18) and contract.follows_gait
    assert (contract.period, contract.waist_rate, contract.robot) == (0.01, 0.0, "h1-2023")
    scale, kd = np.full(19, 0.3), robot.kd.copy()
    scale[robot.yaw_joints] *= 0.5
    kd[robot.yaw_joints] *= env.yaw_damping_factor
    assert contract.action_scale == tuple(scale) and contract.kd == tuple(kd)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(("action_scale", float("nan")), ("action_scale", "far"), ("period", None), ("waist_rate", "fast")),
        *(("kp", [1.0]), ("kd", [-1.0] * 19), ("default_pose", None), ("robot", "g9"), ("layout", 2)),
    ],
)
def test_what_cannot_be_run_is_refused(key, value):
    with pytest.raises(PolicyFileError, match="the contract of the_file is not valid"):
        contract_of({"contract": dataclasses.asdict(EnvConfig().contract()) | {key: value}}, PLACE)
    with pytest.raises(PolicyFileError, match="has no contract that this hugwbc reads"):
        contract_of({"contract": 2}, PLACE)


def test_the_record_of_the_settings_holds_no_folder_of_a_machine():
    here = pathlib.Path("/home/somebody/runs")
    config = TrainConfig(out=here / "mine", start_from=here / "first" / "snapshot.safetensors")
    record = settings_record(config)
    assert "out" not in record and record["start_from"] == "first/snapshot.safetensors"
    assert "somebody" not in json.dumps(record)


def asked(v_x: float, gait: Gait = Gait.WALKING, curves: Any = CURVES) -> float:
    command = np.zeros((1, 8))
    command[0, V_X] = v_x
    contract = dataclasses.replace(EnvConfig().contract(), feed_forward=curves)
    return float(contract.asked(command, np.array([int(gait)]))[0, V_X])


def test_a_curve_is_linear_between_its_knots_and_constant_beyond() -> None:
    assert [asked(v) for v in (0.0, 0.5, 1.0, 1.5, 2.0)] == pytest.approx([0.0, 0.45, 0.9, 1.45, 2.0])
    assert asked(-0.3) == pytest.approx(-0.3) and asked(2.2) == pytest.approx(2.2)
    at_most_one = {"walking": {"v_x": [[-1.0, 0.0], [1.0, 1.0], [2.0, 1.0]]}}
    assert [asked(v, curves=at_most_one) for v in (-1.0, 1.0, 1.5, 2.0)] == pytest.approx([0.0, 1.0, 1.0, 1.0])


def test_other_gaits_and_commands_and_those_of_the_caller_stay_as_they_are():
    command = np.ones((2, 8))
    contract = dataclasses.replace(EnvConfig().contract(), feed_forward=CURVES)
    result = contract.asked(command, np.array([int(Gait.WALKING), int(Gait.STANDING)]))
    assert (command == 1.0).all() and result[0, V_X] == 0.9 and result[1, V_X] == 1.0
    assert asked(1.0, curves={}) == 1.0


def test_a_policy_with_curves_acts_as_one_that_is_asked_for_more(tmp_path: pathlib.Path) -> None:
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
        *(knots([0.0], [1.0, 1.0]), knots([0.0, 0.0], [1.0, -0.4])),
    ],
)
def test_malformed_curves_are_refused(curves: Any) -> None:
    with pytest.raises(HugwbcError):
        dataclasses.replace(EnvConfig().contract(), feed_forward=curves)


def test_the_robot_of_a_policy_may_lie_beside_it(tmp_path):
    fields = dataclasses.asdict(EnvConfig(robot="g1").contract()) | {"robot": "/of/a/server/mine/mine.yaml"}
    with pytest.raises(PolicyFileError, match=r"unknown robot .* in its folder, beside the policy"):
        contract_of({"contract": fields}, tmp_path / "policy.safetensors")
    (tmp_path / "mine").mkdir()
    table = models_dir() / "g1" / "g1.yaml"
    shutil.copy(table, tmp_path / "mine" / "mine.yaml")
    found = contract_of({"contract": fields}, tmp_path / "policy.safetensors")
    assert (
        found.robot == str(tmp_path / "mine" / "mine.yaml")
        and found.described.joint_names == load_robot("g1").joint_names
    )

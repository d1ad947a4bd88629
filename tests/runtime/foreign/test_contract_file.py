import dataclasses
import math
import pathlib
import re

import pytest

import hugwbc
from hugwbc.errors import ContractError, UnknownNameError
from hugwbc.runtime.foreign.contract import History, Term
from hugwbc.runtime.foreign.contract_file import CONTRACT_NAMES, load_contract

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
clock: {period: command}
history: {frames: 3, order: newest_first, layout: by_term, start: zeros}
held_pose: {left_elbow_joint: 0.5}
state: {h_in: h_out}
observation:
  - gravity
  - command: {names: [h, v_x], scale: [2, 1]}
  - joint_position: {joints: [torso_joint], absolute: true}
  - joint_velocity: {scale: 0.05}
  - last_action
  - phase_sin: {offset: 0.5}
  - constant: {value: [1, 2]}
"""


def read(tmp_path: pathlib.Path, text: str):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    return load_contract(path)


def test_a_contract_is_what_the_file_says(tmp_path):
    contract = read(tmp_path, GOOD)
    assert contract.name == "mine" and contract.policy == tmp_path / "net.onnx" and contract.period == 0.01
    assert contract.joints == ("left_knee_joint", "torso_joint") and contract.default_pose == (0.3, 0.0)
    assert contract.kp == (100.0, 100.0) and contract.kd == (2.0, 3.0) and contract.action_scale == (0.25, 0.5)
    assert contract.action_clip == 10.0 and contract.observation_clip == 100.0 and contract.clock_period is None
    assert contract.history == History(3, "newest_first", "by_term", "zeros")
    assert contract.held_pose == (("left_elbow_joint", 0.5),) and contract.state == (("h_in", "h_out"),)
    joints = ("left_knee_joint", "torso_joint")
    assert contract.observation == (
        Term("gravity", 3, (1.0, 1.0, 1.0)),
        Term("command", 2, (2.0, 1.0), ("h", "v_x")),
        Term("joint_position", 1, (1.0,), ("torso_joint",), absolute=True),
        Term("joint_velocity", 2, (0.05, 0.05), joints),
        Term("last_action", 2, (1.0, 1.0)),
        Term("phase_sin", 1, (1.0,), offset=0.5),
        Term("constant", 2, (1.0, 1.0), value=(1.0, 2.0)),
    )
    assert contract.input_size == 3 * 13


def test_the_shipped_contract_is_unitrees():
    assert CONTRACT_NAMES == ("unitree-h1",)
    contract = load_contract("unitree-h1")
    assert contract.input_size == 41 and len(contract.joints) == 10 and contract.policy is None
    assert contract.period == 0.02 and contract.clock_period == 0.8 and math.isinf(contract.action_clip)


@pytest.mark.parametrize(
    ("old", "new", "place", "message"),
    [
        ("period: 0.01", "period: 5", 2, "5 is not valid; give a number from 0.001 to 1"),
        ("period: 0.01", "period: fast", 2, "'fast' is not a number"),
        ("period: 0.01", "perod: 0.01", 2, "unknown contract field 'perod'. Did you mean 'period'"),
        ("period: 0.01\n", "", 1, "contract field 'period' is missing"),
        ("torso_joint]\ndef", "torso]\ndef", 3, "unknown joint 'torso'. Did you mean 'torso_joint'"),
        ("torso_joint]\ndef", "left_knee_joint]\ndef", 3, "joint 'left_knee_joint' is listed twice"),
        ("[0.3, 0]", "[0.3, 0, 0]", 4, "found 3 numbers; give 2, one per joint, or a single one for all"),
        ("kp: 100", "kp: .nan", 5, "'.nan' is not a number"),
        ("kd: [2, 3]", "kd: [2, inf]", 6, "'inf' is not a finite number"),
        ("action_clip: 10", "action_clip: 0", 8, "0 is not above 0"),
        ("period: command", "period: 0", 10, "0 is not above 0"),
        ("frames: 3", "frames: 0", 11, "history has 0 frames; give 1 to 1000"),
        ("by_term", "by_turm", 11, "unknown history layout 'by_turm'. Did you mean 'by_term'"),
        ("left_elbow_joint: 0.5", "torso_joint: 0.5", 12, "unknown held_pose field 'torso_joint'"),
        ("{h_in: h_out}", "h_in", 13, "as in state: {h_in: h_out}"),
        ("- gravity", "- gravty", 15, "unknown observation term 'gravty'. Did you mean 'gravity'"),
        ("[h, v_x]", "[h, vx]", 16, "unknown command 'vx'. Did you mean 'v_x'"),
        ("scale: [2, 1]", "scale: [2, 1, 1]", 16, "give 2, one per number of command"),
        ("absolute: true", "absolute: yes", 17, "'yes' is neither true nor false"),
        ("{scale: 0.05}", "{factor: 0.05}", 18, "unknown joint_velocity field 'factor'"),
        ("- constant: {value: [1, 2]}", "- constant", 21, "constant needs value"),
        ("- gravity", "- gravity: [1]", 15, "expected a gravity with fields: scale"),
    ],
)
def test_a_malformed_contract_is_refused_with_its_line(tmp_path, old, new, place, message):
    assert old in GOOD
    with pytest.raises(ContractError) as caught:
        read(tmp_path, GOOD.replace(old, new, 1))
    assert str(caught.value).startswith(f"{tmp_path / 'mine.yaml'}:{place}:")
    assert message in str(caught.value)


def test_a_contract_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(UnknownNameError, match="Did you mean 'unitree-h1'"):
        load_contract("unitree-h2")
    with pytest.raises(UnknownNameError, match="path of a contract file"):
        load_contract(tmp_path)


def test_the_contract_in_the_docs_is_the_shipped_one(tmp_path):
    page = pathlib.Path(hugwbc.__file__).parent.parent / "docs" / "evaluation.md"
    (text,) = re.findall(r"```yaml\n(.*?)```", page.read_text(), re.DOTALL)
    shown, shipped = read(tmp_path, text), load_contract("unitree-h1")
    assert dataclasses.replace(shown, name=shipped.name, policy=None) == shipped

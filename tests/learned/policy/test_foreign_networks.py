"""Networks as other projects export them: which output drives the joints, what else they read, and wild gains."""

import dataclasses
import logging

import numpy as np
import onnx
import pytest
import torch
from onnx import TensorProto, helper, numpy_helper

from hugwbc.errors import PolicyFileError
from hugwbc.learned.policy.contract import Term, load_contract
from hugwbc.learned.policy.network_files import load_network
from hugwbc.learned.policy.network_policy import tried

CONTRACT = dataclasses.replace(load_contract("unitree-h1"), observation=(Term("constant", value=(1.0, 2.0, 3.0)),))
ACTION, VALUE = np.full((1, 10), 0.5, np.float32), np.full((1, 10), -7.0, np.float32)
NUMBERS = {TensorProto.FLOAT: np.float32, TensorProto.DOUBLE: np.float64, TensorProto.FLOAT16: np.float16}


def onnx_file(path, outputs, inputs=("obs",), shape=("n", 3), kind=TensorProto.FLOAT):
    """Write a network whose outputs are constants, plus zero times its first input."""
    nodes, constants = [], [numpy_helper.from_array(np.zeros((3, 1), NUMBERS[kind]), "zeros")]
    nodes.append(helper.make_node("MatMul", [inputs[0], "zeros"], ["nothing"]))
    for name, value in outputs.items():
        constants.append(numpy_helper.from_array(value.astype(NUMBERS[kind]), f"{name}_value"))
        nodes.append(helper.make_node("Add", ["nothing", f"{name}_value"], [name]))
    given = [helper.make_tensor_value_info(name, kind, shape if name == "obs" else [1, 1]) for name in inputs]
    found = [helper.make_tensor_value_info(name, kind, None) for name in outputs]
    graph = helper.make_graph(nodes, "g", given, found, constants)
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), str(path))
    return path


def first_action(path, **changes):
    contract = dataclasses.replace(CONTRACT, **changes)
    return tried(load_network(path, {}), contract, path)([np.ones(3, np.float32)])


@pytest.mark.parametrize(
    ("outputs", "changes"),
    [
        ({"value": VALUE, "action": ACTION}, {}),
        ({"value": VALUE, "Actions": ACTION}, {}),
        ({"value": VALUE[:, :1], "mu": ACTION}, {}),
        ({"value": VALUE, "mu": ACTION}, {"action": "mu"}),
        ({"mu": ACTION}, {}),
    ],
)
def test_the_action_is_found_by_its_name_its_size_or_the_contract(tmp_path, outputs, changes):
    path = onnx_file(tmp_path / "a.onnx", outputs)
    np.testing.assert_array_equal(first_action(path, **changes), ACTION[0])


def test_several_outputs_that_could_be_the_action_are_refused(tmp_path):
    path = onnx_file(tmp_path / "a.onnx", {"value": VALUE, "mu": ACTION})
    with pytest.raises(PolicyFileError, match=r"outputs value \(10\), mu \(10\), and 2 of them .*: action: NAME"):
        first_action(path)
    with pytest.raises(PolicyFileError, match=r"outputs value \(10\), mu \(10\), and mean could be"):
        first_action(path, action="mean")
    path = onnx_file(tmp_path / "b.onnx", {"value": VALUE[:, :1], "mu": ACTION[:, :9]})
    with pytest.raises(PolicyFileError, match=r"outputs value \(1\), mu \(9\), and 0 of them"):
        first_action(path)


class ValueFirst(torch.nn.Module):
    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        return 0 * x[:, :1] - 7 + torch.zeros(1, 10), 0 * x[:, :1] + 0.5 + torch.zeros(1, 10)


class ByName(torch.nn.Module):
    def forward(self, x: torch.Tensor) -> dict[str, torch.Tensor]:
        return {"value": 0 * x[:, :1] - 7 + torch.zeros(1, 10), "action": 0 * x[:, :1] + 0.5 + torch.zeros(1, 10)}


def test_torchscript_may_return_a_tuple_or_a_dictionary(tmp_path):
    torch.jit.script(ValueFirst()).save(str(tmp_path / "tuple.pt"))
    with pytest.raises(PolicyFileError, match=r"outputs 0 \(10\), 1 \(10\), and 2 of them"):
        first_action(tmp_path / "tuple.pt")
    np.testing.assert_array_equal(first_action(tmp_path / "tuple.pt", action="1"), ACTION[0])
    torch.jit.script(ByName()).save(str(tmp_path / "named.pt"))
    np.testing.assert_array_equal(first_action(tmp_path / "named.pt"), ACTION[0])
    torch.jit.script(torch.nn.Linear(3, 10).double()).save(str(tmp_path / "double.pt"))
    assert first_action(tmp_path / "double.pt").shape == (10,)


@pytest.mark.parametrize("kind", NUMBERS)
@pytest.mark.parametrize("shape", [("n", 3), (1, 3), (3,)])
def test_every_kind_of_number_and_batches_of_one_run(tmp_path, kind, shape):
    path = onnx_file(tmp_path / "a.onnx", {"action": ACTION}, shape=shape, kind=kind)
    np.testing.assert_array_equal(first_action(path), ACTION[0])


def test_inputs_that_cannot_be_given_are_refused_by_name(tmp_path):
    path = onnx_file(tmp_path / "a.onnx", {"action": ACTION}, inputs=("obs", "time_step"))
    with pytest.raises(PolicyFileError, match=r"reads obs, time_step, and the contract gives 1 .* state"):
        first_action(path)
    stepped = dataclasses.replace(CONTRACT, command=(Term("constant", value=(0.0,)),))
    assert tried(load_network(path, {}), stepped, path).action == "action"
    for shape in ((4096, 3), (1, 1, 3)):
        path = onnx_file(tmp_path / "b.onnx", {"action": ACTION}, shape=shape)
        with pytest.raises(PolicyFileError, match=r"reads obs as tensor\(float\) of shape .*; export it for one robot"):
            first_action(path)


@pytest.mark.parametrize(
    ("changes", "said"),
    [({"kp": 1e4}, "kp = 10000"), ({"kd": 0.0}, "kd = 0"), ({"kd": 5000.0}, "kd = 5000"), ({"kp": 150}, "")],
)
def test_gains_with_which_the_drives_would_shake_are_logged(tmp_path, caplog, changes, said):
    path = onnx_file(tmp_path / "a.onnx", {"action": ACTION})
    with caplog.at_level(logging.WARNING):
        first_action(path, **changes)
    assert len(caplog.messages) == (10 if said else 0) and all(said in message for message in caplog.messages)

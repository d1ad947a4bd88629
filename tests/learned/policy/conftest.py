"""Stand-ins for the policies of others: made here, with random weights."""

import pathlib

import numpy as np
import onnx
import pytest
import torch
from onnx import TensorProto, helper, numpy_helper

from hugwbc.robot import load_robot
from hugwbc.state import RobotState


class LegLstm(torch.nn.Module):
    """Shaped as Unitree's walking policy for the H1: 41 observations, an LSTM that keeps its state, 10 actions."""

    def __init__(self) -> None:
        super().__init__()
        self.memory = torch.nn.LSTM(41, 64)
        self.actor = torch.nn.Sequential(torch.nn.Linear(64, 32), torch.nn.ELU(), torch.nn.Linear(32, 10))
        self.register_buffer("hidden_state", torch.zeros(1, 1, 64))
        self.register_buffer("cell_state", torch.zeros(1, 1, 64))

    def forward(self, x):
        output, (hidden, cell) = self.memory(x.unsqueeze(0), (self.hidden_state, self.cell_state))
        self.hidden_state[:] = hidden
        self.cell_state[:] = cell
        return self.actor(output.squeeze(0))

    @torch.jit.export
    def reset_memory(self):
        self.hidden_state[:] = 0.0
        self.cell_state[:] = 0.0


@pytest.fixture(scope="session")
def leg_lstm() -> LegLstm:
    torch.manual_seed(0)
    return LegLstm().eval()


@pytest.fixture(scope="session")
def leg_lstm_file(leg_lstm: LegLstm, tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """The network as a TorchScript file, saved with a memory that is not empty."""
    path = tmp_path_factory.mktemp("unitree") / "motion.pt"
    with torch.no_grad():
        leg_lstm(torch.ones(1, 41))
    torch.jit.script(leg_lstm).save(str(path))
    return path


@pytest.fixture(scope="session")
def counting_onnx(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """An ONNX network with memory: next = memory + 1, action = (sum of the observation, next), two actions."""
    shape = {"observation": [1, 3], "memory": ["batch", 1], "action": [1, 2], "next": ["batch", 1]}
    values = {name: helper.make_tensor_value_info(name, TensorProto.FLOAT, size) for name, size in shape.items()}
    nodes = [
        helper.make_node("Add", ["memory", "one"], ["next"]),
        helper.make_node("ReduceSum", ["observation", "axes"], ["sum"], keepdims=1),
        helper.make_node("Concat", ["sum", "next"], ["action"], axis=1),
    ]
    constants = [
        numpy_helper.from_array(np.ones((1, 1), np.float32), "one"),
        numpy_helper.from_array(np.array([1], np.int64), "axes"),
    ]
    graph = helper.make_graph(
        nodes, "counting", [values["observation"], values["memory"]], [values["action"], values["next"]], constants
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    path = tmp_path_factory.mktemp("onnx") / "counting.onnx"
    onnx.save(model, str(path))
    return path


@pytest.fixture
def state() -> RobotState:
    """A robot that leans forward by 0.2 rad, turns, and bends its left knee by 0.1 rad more than nominal."""
    robot = load_robot()
    q, dq = robot.nominal.copy(), np.zeros(19)
    q[robot.index("left_knee_joint")] += 0.1
    dq[robot.index("right_ankle_joint")] = 2.0
    return RobotState(q, dq, np.array([np.cos(0.1), 0.0, np.sin(0.1), 0.0]), np.array([0.4, -0.8, 1.2]))

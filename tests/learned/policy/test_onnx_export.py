import pathlib

import numpy as np
import onnxruntime
import pytest
import torch

from hugwbc.errors import ConfigError, PolicyFileError
from hugwbc.learned.config import EnvConfig
from hugwbc.learned.policy import LearnedController, load_policy
from hugwbc.learned.policy.networks import Actor
from hugwbc.learned.policy.onnx_export import export_onnx


def test_any_number_of_robots(exported_h1: pathlib.Path) -> None:
    session = onnxruntime.InferenceSession(exported_h1, providers=["CPUExecutionProvider"])
    for count in (1, 7):
        inputs = {"history": np.zeros((count, 315), np.float32), "command": np.zeros((count, 18), np.float32)}
        assert session.run(["action"], inputs)[0].shape == (count, 19)


def test_a_network_that_onnx_cannot_follow_is_refused(tmp_path: pathlib.Path) -> None:
    actor = Actor(63, 18, 19)
    with torch.no_grad():
        actor.policy[-1].bias[3] = float("nan")
    with pytest.raises(PolicyFileError, match="differs"):
        export_onnx(LearnedController(actor, EnvConfig().contract()), tmp_path / "x.onnx")
    assert not (tmp_path / "x.onnx").exists()


def test_a_path_that_cannot_be_written_is_refused(tmp_path: pathlib.Path) -> None:
    with pytest.raises(ConfigError, match="cannot write"):
        export_onnx(load_policy("h1"), tmp_path)

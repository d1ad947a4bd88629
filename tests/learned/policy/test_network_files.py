import numpy as np
import pytest
import torch

from hugwbc.errors import PolicyFileError
from hugwbc.learned.policy.network_files import load_network


def test_torchscript_keeps_its_memory_until_it_is_reset(leg_lstm_file, leg_lstm):
    network = load_network(leg_lstm_file, {})
    inputs = np.random.default_rng(0).normal(size=(3, 41)).astype(np.float32)
    for _ in range(2):
        network.reset()
        leg_lstm.reset_memory()
        for row in inputs:
            with torch.no_grad():
                expected = leg_lstm(torch.as_tensor(row)[None])[0]
            np.testing.assert_allclose(network([row]), expected, atol=1e-6)


def test_torchscript_without_a_reset_method_starts_as_it_was_saved(tmp_path):
    class Counter(torch.nn.Module):
        def __init__(self):
            super().__init__()
            self.register_buffer("count", torch.full((1, 1), 5.0))
            self.attribute = torch.zeros(1, 1)

        def forward(self, x):
            self.count += 1.0
            self.attribute += 10.0
            x *= 0.0
            return self.count + self.attribute + x

    torch.jit.script(Counter()).save(str(tmp_path / "counter.pt"))
    network = load_network(tmp_path / "counter.pt", {})
    given = np.ones(1, np.float32)
    assert [network([given])[0] for _ in range(2)] == [16.0, 27.0]
    network.reset()
    assert network([given])[0] == 16.0
    assert given == 1.0, "the history of observations stays as it is"


def test_onnx_with_memory(counting_onnx):
    network = load_network(counting_onnx, {"memory": "next"})
    inputs = np.array([1.0, 2.0, 3.0], np.float32)
    np.testing.assert_array_equal([network([inputs]), network([2 * inputs])], [[6.0, 1.0], [12.0, 2.0]])
    network.reset()
    np.testing.assert_array_equal(network([inputs]), [6.0, 1.0])


def test_files_that_are_no_networks_are_refused(tmp_path, counting_onnx, leg_lstm_file):
    with pytest.raises(PolicyFileError, match="there is no policy file"):
        load_network(tmp_path / "missing.pt", {})
    torch.save({"a": torch.zeros(1)}, tmp_path / "checkpoint.pt")
    with pytest.raises(PolicyFileError, match=r"is not a TorchScript file .* is a pickle and is not loaded"):
        load_network(tmp_path / "checkpoint.pt", {})
    for name, message in (("bad.onnx", "is not an ONNX network"), ("bad.bin", "valid is TorchScript or ONNX")):
        (tmp_path / name).write_bytes(b"nothing of the kind")
        with pytest.raises(PolicyFileError, match=message):
            load_network(tmp_path / name, {})
    with pytest.raises(PolicyFileError, match="cell is missing"):
        load_network(counting_onnx, {"memory": "cell"})
    with pytest.raises(PolicyFileError, match="keeps its state itself"):
        load_network(leg_lstm_file, {"memory": "next"})

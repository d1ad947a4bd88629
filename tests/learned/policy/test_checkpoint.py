import os
import pathlib
import pickle

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save, save_file

from hugwbc.errors import PolicyFileError
from hugwbc.learned.policy import checkpoint

TENSORS = {"a": torch.arange(6.0).reshape(2, 3), "b": torch.tensor([1, 2, 3], dtype=torch.uint8)}


@pytest.fixture
def saved(tmp_path: pathlib.Path) -> pathlib.Path:
    path = tmp_path / "x.safetensors"
    checkpoint.save_file(path, TENSORS, "policy", {"steps": 7, "name": "é"})
    return path


def test_round_trip(saved: pathlib.Path) -> None:
    tensors, metadata = checkpoint.load_file(saved, "policy")
    assert metadata == {"steps": 7, "name": "é"}
    assert set(tensors) == set(TENSORS)
    for name, tensor in TENSORS.items():
        assert torch.equal(tensors[name], tensor)


def test_every_truncation_is_refused(saved: pathlib.Path) -> None:
    data = saved.read_bytes()
    for length in (0, 1, 7, 8, 9, 50, len(data) // 2, len(data) - 1):
        saved.write_bytes(data[:length])
        with pytest.raises(PolicyFileError, match="truncated"):
            checkpoint.load_file(saved, "policy")


def test_flipped_weights_are_refused(saved: pathlib.Path) -> None:
    data = bytearray(saved.read_bytes())
    data[-5] ^= 0x10
    saved.write_bytes(data)
    with pytest.raises(PolicyFileError, match="checksum"):
        checkpoint.load_file(saved, "policy")


def test_another_kind_is_refused(saved: pathlib.Path) -> None:
    with pytest.raises(PolicyFileError, match="checkpoint file is needed"):
        checkpoint.load_file(saved, "checkpoint")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"metadata": '{"steps": 8, "name": "\\u00e9"}'}, "checksum"),
        ({"format": "hugwbc-37"}, "has hugwbc-37, this hugwbc reads hugwbc-2"),
    ],
)
def test_a_changed_header_is_refused(saved: pathlib.Path, changes: dict[str, str], message: str) -> None:
    with safe_open(saved, "pt") as file:
        header = file.metadata()
    save_file(TENSORS, saved, header | changes)
    with pytest.raises(PolicyFileError, match=message):
        checkpoint.load_file(saved, "policy")


def test_foreign_safetensors_are_refused(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "foreign.safetensors"
    save_file({"w": torch.zeros(2)}, path)
    with pytest.raises(PolicyFileError, match="no format mark"):
        checkpoint.load_file(path, "policy")


class _Planted:
    fired = False

    def __reduce__(self) -> tuple:
        return (setattr, (_Planted, "fired", True))


def test_a_pickle_is_refused_and_never_run(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "evil.pt"
    path.write_bytes(pickle.dumps(_Planted()))
    with pytest.raises(PolicyFileError):
        checkpoint.load_file(path, "policy")
    assert not _Planted.fired


def test_missing_file_says_what_to_give(tmp_path: pathlib.Path) -> None:
    with pytest.raises(PolicyFileError, match="give the path"):
        checkpoint.load_file(tmp_path / "nothing.safetensors", "policy")


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ({"format": "hugwbc-" + "9" * 5000, "kind": "policy"}, "this hugwbc reads"),
        ({"format": checkpoint.FORMAT, "kind": "policy", "metadata": "[" * 100_000}, "not JSON"),
    ],
)
def test_absurd_headers_are_refused(header: dict[str, str], message: str, tmp_path: pathlib.Path) -> None:
    if "metadata" in header:
        header["sha256"] = checkpoint.tensor_digest(TENSORS, header["metadata"])
    (tmp_path / "x.safetensors").write_bytes(save(TENSORS, header))
    with pytest.raises(PolicyFileError, match=message) as caught:
        checkpoint.load_file(tmp_path / "x.safetensors", "policy")
    assert len(str(caught.value)) < 500


def test_a_header_nested_too_deeply_is_refused(tmp_path: pathlib.Path) -> None:
    header = b"[" * 100_000
    (tmp_path / "x.safetensors").write_bytes(len(header).to_bytes(8, "little") + header)
    with pytest.raises(PolicyFileError, match="safetensors"):
        checkpoint.load_file(tmp_path / "x.safetensors", "policy")


def test_what_has_no_end_is_not_read(tmp_path: pathlib.Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (pathlib.Path("/dev/zero"), tmp_path / "pipe", tmp_path):
        with pytest.raises(PolicyFileError, match="it is no file"):
            checkpoint.load_file(path, "policy")

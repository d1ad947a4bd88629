"""Policy files that are broken in every way, on the command line."""

import dataclasses
import json

import pytest
import torch
from safetensors.torch import save

from hugwbc.cli import main
from hugwbc.learned.config import EnvConfig
from hugwbc.learned.policy import checkpoint, save_policy
from hugwbc.learned.policy.networks import Actor

PLAY = ["play", "--viewer", "none", "--duration", "0.1", "--policy"]


@pytest.fixture
def policy(tmp_path):
    path = tmp_path / "policy.safetensors"
    save_policy(path, Actor(), EnvConfig().contract(), {})
    return path


def test_a_sound_policy_file_plays(policy, capsys):
    assert main([*PLAY, str(policy)]) == 0
    assert "learned: 0.1 s simulated" in capsys.readouterr().out


def refused(path, capsys):
    assert main([*PLAY, str(path)]) == 2
    error = capsys.readouterr().err
    assert str(path) in error
    return error


@pytest.mark.parametrize("kept", [0, 4, 100, 5000])
def test_a_truncated_file_is_refused(policy, capsys, kept):
    policy.write_bytes(policy.read_bytes()[:kept])
    assert "truncated" in refused(policy, capsys)


def test_a_flipped_bit_is_noticed(policy, capsys):
    data = bytearray(policy.read_bytes())
    data[-10] ^= 1
    policy.write_bytes(bytes(data))
    assert "checksum" in refused(policy, capsys)


def test_a_foreign_file_is_refused(policy, capsys):
    policy.write_bytes(save({"weight": torch.zeros(3)}))
    assert "this hugwbc reads" in refused(policy, capsys)
    policy.write_text(json.dumps({"weights": [1, 2, 3]}))
    assert "not a readable safetensors file" in refused(policy, capsys)


def test_another_robots_policy_is_refused(policy, capsys):
    contract = dataclasses.asdict(EnvConfig().contract()) | {"robot": "g1"}
    checkpoint.save_file(policy, Actor().state_dict(), "policy", {"contract": contract})
    assert "unknown robot 'g1'" in refused(policy, capsys)


def test_a_missing_file_is_refused(tmp_path, capsys):
    assert main([*PLAY, str(tmp_path / "nothing.safetensors")]) == 2
    assert "unknown policy" in capsys.readouterr().err

"""What a checkpoint must hold, and what of it is refused; that a resumed run goes on bit for bit is in test_train."""

import dataclasses
import pathlib

import pytest
import torch

from hugwbc.errors import PolicyFileError
from hugwbc.learned.config import EnvConfig, PPOConfig, TrainConfig
from hugwbc.learned.policy import checkpoint
from hugwbc.learned.rl.trainer import CHECKPOINT_NAME, SNAPSHOT_NAME, Trainer, train

ENV = EnvConfig(count=16)


def config(out: pathlib.Path, iterations: int, **changes: object) -> TrainConfig:
    ppo = PPOConfig(horizon=4, epochs=2, minibatches=2)
    return TrainConfig(out=out, steps=iterations * 64, threads=1, env=ENV, ppo=ppo, evaluation_interval=0, **changes)


def run(settings: TrainConfig) -> Trainer:
    return train(settings, lambda row, gates: None)


def test_another_number_of_robots_is_refused(tmp_path: pathlib.Path) -> None:
    run(config(tmp_path, 1))
    other = dataclasses.replace(config(tmp_path, 2, resume=True), env=dataclasses.replace(ENV, count=8))
    with pytest.raises(PolicyFileError, match=r"--env\.count 16"):
        Trainer(other)


def test_truncated_checkpoint_is_refused(tmp_path: pathlib.Path) -> None:
    run(config(tmp_path, 1))
    path = tmp_path / CHECKPOINT_NAME
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(PolicyFileError, match="truncated"):
        Trainer(config(tmp_path, 2, resume=True))


@pytest.mark.parametrize("damage", ["drop iteration", "seconds is text"])
def test_a_checkpoint_without_its_counters_is_refused(tmp_path: pathlib.Path, damage: str) -> None:
    run(config(tmp_path, 1))
    tensors, metadata = checkpoint.load_file(tmp_path / CHECKPOINT_NAME, "checkpoint")
    if damage == "drop iteration":
        del metadata["iteration"]
    else:
        metadata["seconds"] = "soon"
    checkpoint.save_file(tmp_path / CHECKPOINT_NAME, tensors, "checkpoint", metadata)
    with pytest.raises(PolicyFileError, match="lacks a readable"):
        Trainer(config(tmp_path, 2, resume=True))


def test_a_snapshot_without_its_curriculum_is_refused(tmp_path: pathlib.Path) -> None:
    run(config(tmp_path, 1))
    tensors, metadata = checkpoint.load_file(tmp_path / SNAPSHOT_NAME, "checkpoint")
    del metadata["curriculum"]
    checkpoint.save_file(tmp_path / "cut", tensors, "checkpoint", metadata)
    with pytest.raises(PolicyFileError, match="lacks a readable 'curriculum'"):
        Trainer(config(tmp_path, 2, start_from=tmp_path / "cut"))


def test_a_checkpoint_of_other_state_is_refused(tmp_path: pathlib.Path) -> None:
    run(config(tmp_path, 1))
    tensors, metadata = checkpoint.load_file(tmp_path / CHECKPOINT_NAME, "checkpoint")
    tensors["env.qpos"] = tensors["env.qpos"][:, 1:]
    checkpoint.save_file(tmp_path / CHECKPOINT_NAME, tensors, "checkpoint", metadata)
    with pytest.raises(PolicyFileError, match="Continue from its snapshot"):
        Trainer(config(tmp_path, 2, resume=True))


def test_a_checkpoint_from_before_the_evaluations_resumes(tmp_path: pathlib.Path) -> None:
    run(config(tmp_path, 1))
    tensors, metadata = checkpoint.load_file(tmp_path / CHECKPOINT_NAME, "checkpoint")
    del metadata["best"], metadata["evaluation"]
    checkpoint.save_file(tmp_path / CHECKPOINT_NAME, tensors, "checkpoint", metadata)
    assert run(config(tmp_path, 2, resume=True)).iteration == 2


def test_tensors_of_a_part_that_is_unknown_are_refused(tmp_path: pathlib.Path) -> None:
    run(config(tmp_path, 1))
    tensors, metadata = checkpoint.load_file(tmp_path / SNAPSHOT_NAME, "checkpoint")
    checkpoint.save_file(tmp_path / "odd", tensors | {"memory.rows": torch.zeros(1)}, "checkpoint", metadata)
    with pytest.raises(PolicyFileError, match=r"odd holds 'memory'"):
        Trainer(config(tmp_path, 2, start_from=tmp_path / "odd"))

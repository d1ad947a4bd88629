from hugwbc.cli import main


def test_train_saves_a_policy_that_plays(tmp_path, capsys):
    words = [
        "train",
        "--env.count",
        "4",
        "--ppo.horizon",
        "8",
        "--steps",
        "64",
        "--threads",
        "1",
        "--out",
        str(tmp_path),
    ]
    assert main(words) == 0
    text = capsys.readouterr().out
    assert "iteration 1" in text and "stopped after 2 iterations, 64 steps" in text
    before = (tmp_path / "checkpoint.safetensors").read_bytes()
    assert main(words) == 2
    assert "already holds a run; --resume continues it" in capsys.readouterr().err
    assert (tmp_path / "checkpoint.safetensors").read_bytes() == before
    assert main(["play", "--headless", "--duration", "0.1", "--policy", str(tmp_path)]) == 0

import pytest

from hugwbc.cli import main
from hugwbc.files import sole_writer


def test_train_saves_a_policy_that_plays(tmp_path, capsys):
    words = ["train", "--env.count", "4", "--ppo.horizon", "8", "--steps", "64", "--threads", "1"]
    words += ["--evaluation-robots", "4", "--evaluation-seconds", "0.1", "--out", str(tmp_path)]
    assert main(words) == 0
    text = capsys.readouterr().out
    assert "iteration 1" in text and "stopped after 2 iterations, 64 steps" in text
    before = (tmp_path / "checkpoint.safetensors").read_bytes()
    assert main(words) == 2
    assert "already holds a run; --resume continues it" in capsys.readouterr().err
    assert (tmp_path / "checkpoint.safetensors").read_bytes() == before
    assert main(["play", "--viewer", "none", "--duration", "0.1", "--policy", str(tmp_path)]) == 0
    start = ["--start-from", str(tmp_path / "checkpoint.safetensors")]
    assert main([*words[:-1], str(tmp_path / "next"), *start]) == 0
    again = capsys.readouterr().out
    assert "stopped after 2 iterations, 64 steps, after 2 iterations, 64 steps of another run" in again


def test_two_trainings_do_not_share_a_folder(tmp_path, capsys):
    with sole_writer(tmp_path):
        assert main(["train", "--env.count", "2", "--threads", "1", "--out", str(tmp_path)]) == 2
    assert f"another process is working on {tmp_path}" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["run.lock"]


def test_a_refused_training_leaves_no_folder(tmp_path, capsys):
    none = str(tmp_path / "none.safetensors")
    refused = {"no run to resume": ["--resume"], "none.safetensors": ["--start-from", none]}
    for message, words in refused.items():
        assert main(["train", "--env.count", "2", "--threads", "1", "--out", str(tmp_path / "a" / "b"), *words]) == 2
        assert message in capsys.readouterr().err
        assert not any(tmp_path.iterdir())


def test_help_shows_the_defaults_of_a_file(tmp_path, capsys):
    (tmp_path / "mine.py").write_text(
        "from hugwbc.learned.config import TrainConfig\nCONFIG = TrainConfig(steps=123456.0, seed=2077)\n"
    )
    with pytest.raises(SystemExit):
        main(["train", "--config", str(tmp_path / "mine.py"), "--help"])
    shown = capsys.readouterr().out
    assert "(default: 123456.0)" in shown and "(default: 2077)" in shown and "--env.*" in shown


def test_help_shows_the_common_options_and_lists_the_groups(capsys):
    with pytest.raises(SystemExit) as info:
        main(["train", "--help"])
    assert info.value.code == 0
    short = capsys.readouterr().out
    assert len(short.splitlines()) < 80
    assert all(f"--{name} " in short for name in ("out", "steps", "hours", "device", "evaluation-robots"))
    assert short.index("--out ") < short.index("--device ") < short.index("--critic-warm-up ")
    assert "--env.*" in short and "--env.command.*" in short and "--ppo.*" in short and "--ppo.gamma" not in short
    with pytest.raises(SystemExit) as info:
        main(["train", "--help-all"])
    assert info.value.code == 0
    full = capsys.readouterr().out
    assert "--ppo.gamma" in full and len(full.splitlines()) > 300

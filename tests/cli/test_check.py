import pytest

from hugwbc.cli import main
from hugwbc.errors import ConfigError, ModelError
from hugwbc.evaluation import installation
from hugwbc.learned.policy import checkpoint, policy_file
from hugwbc.learned.recipe.ancestry import KEY
from hugwbc.robot_tables import models_dir


@pytest.mark.parametrize("error", [ConfigError("too heavy"), ModelError("no model"), ImportError("no placo")])
def test_a_failure_is_named_and_the_exit_code_tells(error, monkeypatch, capsys):
    def fails():
        raise error

    monkeypatch.setattr(installation, "CHECKS", {"first": lambda: "fine", "second": fails})
    assert main(["check"]) == 1
    text = capsys.readouterr().out
    assert "ok    first: fine" in text and f"FAIL  second: {error}" in text and "1 of 2 checks failed" in text


def test_a_recipe_that_has_changed_since_is_a_remark(tmp_path, capsys):
    path, (tensors, metadata) = tmp_path / "policy.safetensors", checkpoint.load_file(policy_file("g1"), "policy")
    made, shipped = metadata["training"][KEY], (models_dir() / "g1" / "recipes" / "g1.yaml").read_text()
    for text, changed in ((f"# a comment\n{shipped}", False), (shipped.replace("0.9", "0.8"), True)):
        checkpoint.save_file(path, tensors, "policy", metadata | {"training": {KEY: made | {"recipe": text}}})
        assert main(["check", "--policy", str(path)]) == 0
        assert ("g1.yaml has changed since it made this policy" in capsys.readouterr().out) == changed

import pytest

from hugwbc.cli import main
from hugwbc.errors import ConfigError, ModelError
from hugwbc.evaluation import installation


@pytest.mark.parametrize("error", [ConfigError("too heavy"), ModelError("no model"), ImportError("no placo")])
def test_a_failure_is_named_and_the_exit_code_tells(error, monkeypatch, capsys):
    def fails():
        raise error

    monkeypatch.setattr(installation, "CHECKS", {"first": lambda: "fine", "second": fails})
    assert main(["check"]) == 1
    text = capsys.readouterr().out
    assert "ok    first: fine" in text and f"FAIL  second: {error}" in text and "1 of 2 checks failed" in text

import pytest

from hugwbc.cli import check, main
from hugwbc.errors import ModelError


@pytest.mark.parametrize("name", check.CHECKS)
def test_each_check_passes_here(name):
    assert check.CHECKS[name]()


@pytest.mark.parametrize("error", [check.CheckError("too heavy"), ModelError("no model"), ImportError("no placo")])
def test_a_failure_is_named_and_the_exit_code_tells(error, monkeypatch, capsys):
    def fails():
        raise error

    monkeypatch.setattr(check, "CHECKS", {"first": lambda: "fine", "second": fails})
    assert main(["check"]) == 1
    text = capsys.readouterr().out
    assert "ok    first: fine" in text and f"FAIL  second: {error}" in text and "1 of 2 checks failed" in text


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setattr(check, "PACKAGES", ("numpy", "no-such-package-as-this"))
    with pytest.raises(check.CheckError, match="no-such-package-as-this is not installed"):
        check._versions()


def test_different_masses_are_noticed(monkeypatch):
    from hugwbc import kinematics

    heavier = kinematics.pinocchio_model().copy()
    heavier.inertias[1] = heavier.inertias[1] + heavier.inertias[1]
    monkeypatch.setattr(kinematics, "pinocchio_model", lambda: heavier)
    with pytest.raises(check.CheckError, match=r"h1\.urdf weighs"):
        check._masses()

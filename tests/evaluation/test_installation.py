import pytest

from hugwbc import kinematics, load_robot
from hugwbc.errors import ConfigError
from hugwbc.evaluation import installation
from hugwbc.sim.arena import Arena


@pytest.mark.parametrize("name", installation.CHECKS)
def test_each_check_passes_here(name):
    assert installation.CHECKS[name]()


def test_the_arena_and_its_version_are_named():
    text = installation.check_arena()
    assert f"h1, real drives, sensors robot, firm ground, version {Arena().version}" in text
    assert "engines mujoco" in text


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setattr(installation, "PACKAGES", ("numpy", "no-such-package-as-this"))
    with pytest.raises(ConfigError, match="no-such-package-as-this is not installed"):
        installation.check_versions()


def test_different_masses_are_noticed(monkeypatch):
    heavier = kinematics.pinocchio_model(load_robot()).copy()
    heavier.inertias[1] = heavier.inertias[1] + heavier.inertias[1]
    monkeypatch.setattr(kinematics, "pinocchio_model", lambda robot: heavier)
    with pytest.raises(ConfigError, match="differ by up to"):
        installation.check_agreement()

import dataclasses
import re
import shutil

import pytest

from hugwbc import Command, kinematics, load_robot
from hugwbc.errors import ConfigError
from hugwbc.evaluation import installation
from hugwbc.robot_tables import models_dir
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


def test_a_robot_squats_as_low_as_its_table_says(tmp_path):
    shutil.copytree(models_dir() / "g1", tmp_path / "mine", ignore=shutil.ignore_patterns("policies"))
    table = tmp_path / "mine" / "g1.yaml"
    text = re.sub("^commands:.*$", "commands: {h: {finishing: [-0.05, 0.0]}}", table.read_text(), flags=re.MULTILINE)
    table.rename(table.with_stem("mine")).write_text(text)
    assert "of -0.05 m" in installation.check_standing(str(tmp_path / "mine"))


def test_different_masses_are_noticed(monkeypatch):
    heavier = kinematics.pinocchio_model(load_robot()).copy()
    heavier.inertias[1] = heavier.inertias[1] + heavier.inertias[1]
    monkeypatch.setattr(kinematics, "pinocchio_model", lambda robot: heavier)
    with pytest.raises(ConfigError, match="differ by up to"):
        installation.check_agreement()


@pytest.mark.parametrize("survived", [0.0, 0.1, 1.0])
def test_a_fall_at_once_has_a_strain_too(synthetic_trace, survived):
    trace = dataclasses.replace(synthetic_trace(Command()), fell=True, survived_s=survived)
    assert re.fullmatch(r"\w+ turned at \S+ of \S+ rad/s and \w+ gave \S+ of \S+ N m", installation._strain(trace))

"""A folder in which a page is followed: the shipped robot and policies, as in a clone, and nothing else."""

import pathlib
import shutil

import pytest
from docs_pages import ROOT


@pytest.fixture
def folder(tmp_path: pathlib.Path) -> pathlib.Path:
    """An empty folder with the shipped models."""
    work = tmp_path / "work"
    work.mkdir()
    (work / "models").symlink_to(ROOT / "models")
    return work


@pytest.fixture
def package(tmp_path: pathlib.Path) -> pathlib.Path:
    """A copy of the package, and of what Python compiled of it, that a page may change."""
    copy = tmp_path / "copy"
    for name in ("hugwbc", "models"):
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("*.pyc.*"))
    return copy

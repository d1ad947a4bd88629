"""docs/getting-started.md does what it says."""

import pathlib

import pytest
from docs_pages import ROOT, follow

PAGE = ROOT / "docs" / "getting-started.md"


def test_every_quick_block_runs(folder: pathlib.Path) -> None:
    follow(PAGE, folder)
    assert (folder / "out" / "greet" / "replay.html").exists()
    assert (folder / "runs" / "first" / "policy.safetensors").exists()


@pytest.mark.slow
def test_every_block_runs(folder: pathlib.Path) -> None:
    follow(PAGE, folder, slow=True)
    assert (folder / "runs" / "soft" / "policy.safetensors").exists()

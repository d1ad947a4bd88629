"""docs/first-ten-minutes.md does what it says."""

import pathlib

import pytest
from docs_pages import ROOT, follow

PAGE = ROOT / "docs" / "first-ten-minutes.md"


@pytest.mark.slow
def test_every_block_runs(folder: pathlib.Path, package: pathlib.Path) -> None:
    follow(PAGE, folder, package)
    for name in ("squat", "bow"):
        assert (folder / "out" / name / "report.html").exists()
        assert (folder / "out" / name / "replay.html").exists()
    assert "reward/narrow_stance" in (folder / "runs" / "apart" / "metrics.csv").read_text()

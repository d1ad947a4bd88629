"""The door of the engine, and the page that describes it."""

import pathlib
import re
import subprocess
import sys

import hugwbc
from hugwbc.evaluation import engine

PAGE = pathlib.Path(hugwbc.__file__).parent.parent / "docs" / "engine.md"


def test_the_page_names_what_the_door_offers():
    assert all(hasattr(engine, name) for name in engine.__all__)
    shown = set(re.findall(r"`(\w+)`", PAGE.read_text()))
    helpers = {"ControllerFactory", "Row", "controller_of", "read_result", "DEFAULT_FOLDER"}
    assert set(engine.__all__) - helpers <= shown


def test_the_example_of_the_page_simulates_once_and_then_reads(tmp_path):
    (block,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    (tmp_path / "walks.py").write_text(block + "\nprint(execution.store.restored, [row.fell for row in rows])\n")
    for restored in (0, 3):
        words = [sys.executable, "walks.py"]
        result = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True)
        assert result.stdout.strip() == f"{restored} [False, False, False]"

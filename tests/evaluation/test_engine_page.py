"""The example of docs/engine.md simulates once, and then reads."""

import pathlib
import re
import subprocess
import sys

import hugwbc

PAGE = pathlib.Path(hugwbc.__file__).parent.parent / "docs" / "engine.md"


def test_the_example_of_the_page(tmp_path):
    run, read = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    (tmp_path / "walks.py").write_text(f"{run}\n{read}\nprint(len(result.rows), result.figures[0].estimate.samples)\n")
    for _ in range(2):
        words = [sys.executable, "walks.py"]
        result = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True)
        assert result.stdout.splitlines()[-1] == "3 3" and "0.6" in result.stdout
        (path,) = (tmp_path / "out" / "my-walks").iterdir()
        assert len(path.read_text().splitlines()) == 4

"""Both pages in a real browser without a window, where there is one."""

import pathlib
import re
import shutil
import subprocess
from collections.abc import Callable

import imageio.v2 as imageio
import numpy as np
import pytest

from hugwbc.viz.replay import replay_html

BROWSER = shutil.which("chromium") or shutil.which("google-chrome")
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--use-gl=angle", "--use-angle=swiftshader")
FLAGS += ("--enable-unsafe-swiftshader", "--window-size=800,450", "--virtual-time-budget=5000")

pytestmark = [pytest.mark.slow, pytest.mark.skipif(BROWSER is None, reason="no chromium on this machine")]


def _browse(*arguments: str) -> subprocess.CompletedProcess[str]:
    assert BROWSER is not None
    command = [BROWSER, *FLAGS, "--enable-logging=stderr", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=600, check=True)


def test_replay_runs_and_shows_a_robot(make_run: Callable, tmp_path: pathlib.Path) -> None:
    page, picture = tmp_path / "replay.html", tmp_path / "replay.png"
    page.write_text(replay_html([make_run(seconds=2.0)]))
    result = _browse("--dump-dom", f"{page.as_uri()}?t=1.2")
    assert not re.search(r"Uncaught|Error:", result.stderr)
    # The clock is written by the page's script, from the animation that the viewer has loaded: 50 frames at 25 Hz.
    assert re.search(r'<output id="clock">1\.20 / 1\.96 s</output>', result.stdout)
    _browse(f"--screenshot={picture}", f"{page.as_uri()}?t=1.2")
    pixels = imageio.imread(picture)[..., :3].astype(int)
    # The robot's shells are bluish, its joints nearly black; sky and floor are pale.
    assert np.mean(pixels.max(axis=2) < 60) > 0.003
    assert np.mean((pixels[..., 2] - pixels[..., 0] > 40) & (pixels.max(axis=2) > 120)) > 0.003


def test_layers_are_shown_and_hidden(make_run: Callable, tmp_path: pathlib.Path) -> None:
    page, red = tmp_path / "replay.html", {}
    page.write_text(replay_html([make_run(seconds=2.0)]))
    for hidden in ("", "forces", "hands,steps,balance,phases"):
        picture = tmp_path / "layers.png"
        result = _browse(f"--screenshot={picture}", f"{page.as_uri()}?t=1.2&hide={hidden}")
        assert not re.search(r"Uncaught|Error:", result.stderr)
        pixels = imageio.imread(picture)[..., :3].astype(int)
        # Nothing but a force's arrow is red.
        red[hidden] = np.count_nonzero((pixels[..., 0] > 100) & (pixels[..., 0] > 2 * pixels[..., 1:].max(axis=2)))
    assert red[""] > 50 and red["hands,steps,balance,phases"] > 50
    assert red["forces"] < 5

"""Processes of tests that talk over DDS."""

import os
import pathlib
import subprocess
import sys
from collections.abc import Sequence

PATIENCE = 300.0  # [s] for a process on a busy machine


class Processes:
    """Processes of a test; none outlives it."""

    def __init__(self, folder: pathlib.Path) -> None:
        self._folder = folder
        self._all: list[subprocess.Popen] = []

    def start(self, words: Sequence[str]) -> subprocess.Popen:
        process = subprocess.Popen(
            [sys.executable, *words],
            cwd=self._folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
        )
        self._all.append(process)
        return process

    def hugwbc(self, *words: object) -> subprocess.Popen:
        return self.start(["-m", "hugwbc.cli", *map(str, words)])

    def __enter__(self) -> "Processes":
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._all:
            if process.poll() is None:
                process.kill()
            process.wait(PATIENCE)
            if process.stdout is not None:
                process.stdout.close()


def output(process: subprocess.Popen, code: int = 0) -> str:
    """What a process prints until it ends with a code."""
    text = process.communicate(timeout=PATIENCE)[0]
    assert process.returncode == code, text
    return text

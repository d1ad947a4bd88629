"""The log of a training run: a row of figures per iteration, a record per session."""

import csv
import itertools
import json
import math
import pathlib
from typing import Any

LOG_NAME = "metrics.csv"
SESSIONS_NAME = "sessions.jsonl"


def append_row(folder: pathlib.Path, row: dict[str, float], iteration: int) -> None:
    """Add an iteration's figures to the run's log; NaN leaves a cell empty.

    A log with other columns, from a session with other settings, is kept under another name.

    Args:
        folder: of the run.
        row: figures by name.
        iteration: their number.
    """
    path = folder / LOG_NAME
    if path.exists():
        with path.open(newline="") as file:
            header = next(csv.reader(file), [])
        if header != list(row):
            path.rename(_free(path.with_stem(f"{path.stem}-until-{iteration - 1}")))
    new = not path.exists()
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(row))
        if new:
            writer.writeheader()
        writer.writerow({name: "" if math.isnan(value) else f"{value:.6g}" for name, value in row.items()})


def append_session(folder: pathlib.Path, record: dict[str, Any]) -> None:
    """Add a session's settings and versions to the run's record.

    Args:
        folder: of the run; it is made.
        record: anything JSON can hold.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / SESSIONS_NAME).open("a") as file:
        file.write(json.dumps(record) + "\n")


def _free(path: pathlib.Path) -> pathlib.Path:
    """The path, or the first of path-2, path-3 and so on that is no file yet."""
    numbered = (path.with_stem(f"{path.stem}-{number}") for number in itertools.count(2))
    return next(candidate for candidate in itertools.chain([path], numbered) if not candidate.exists())

"""The log of a training run: one row of figures per iteration, one record per session."""

import csv
import itertools
import json
import math
import pathlib
from typing import Any

from hugwbc.files import write_whole

LOG_NAME = "metrics.csv"
SESSIONS_NAME = "sessions.jsonl"


def begin_log(folder: pathlib.Path, iteration: int, *, resumed: bool) -> None:
    """Prepare the log of a run for a session, so that every iteration is in it once.

    A run that was cut off has logged iterations after its last checkpoint. The resumed run does these again, so their
    rows are dropped. The log of another run in the folder is kept under another name.

    Args:
        folder: folder of the run.
        iteration: last iteration before the session.
        resumed: whether the session continues the run in the folder.
    """
    path = folder / LOG_NAME
    if not path.exists():
        return
    with path.open(newline="") as file:
        header, *rows = list(csv.reader(file)) or [[]]
    if not resumed:
        path.rename(_free(path.with_stem(f"{path.stem}-before")))
        return
    column = header.index("iteration") if "iteration" in header else None
    kept = [row for row in rows if column is not None and len(row) == len(header) and float(row[column]) <= iteration]
    if len(kept) < len(rows):
        write_whole(path, "".join(",".join(row) + "\r\n" for row in [header, *kept]))


def append_row(folder: pathlib.Path, row: dict[str, float], iteration: int) -> None:
    """Append the figures of an iteration to the log; NaN leaves a cell empty.

    A log with other columns, from a session with other settings, is kept under another name.

    Args:
        folder: folder of the run.
        row: figures by name.
        iteration: number of the iteration.
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
    """Append the settings and versions of a session to the record of the run.

    Args:
        folder: folder of the run, created if needed.
        record: anything JSON can hold.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / SESSIONS_NAME).open("a") as file:
        file.write(json.dumps(record) + "\n")


def _free(path: pathlib.Path) -> pathlib.Path:
    """Return the path, or the first of path-2, path-3, ... that does not exist."""
    numbered = (path.with_stem(f"{path.stem}-{number}") for number in itertools.count(2))
    return next(candidate for candidate in itertools.chain([path], numbered) if not candidate.exists())

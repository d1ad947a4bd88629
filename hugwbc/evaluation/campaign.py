"""Many protocols with many controllers in one go; each finished cell is a JSON file that a report reads."""

import dataclasses
import json
import math
import os
import pathlib
import tempfile
from collections.abc import Callable, Sequence
from typing import Any

from hugwbc.errors import ResultFileError
from hugwbc.evaluation.controllers import ControllerSpec
from hugwbc.evaluation.execution import Execution
from hugwbc.evaluation.identity import code_identity, digest, to_json
from hugwbc.evaluation.store import set_aside

FORMAT = "hugwbc result"
VERSION = 1
FOLDER = "cells"


@dataclasses.dataclass(frozen=True)
class Cell:
    """One protocol with one controller.

    Attributes:
        protocol: as on the command line.
        spec: the controller.
        config: the protocol's settings.
        run: the protocol: called with a controller factory, settings, and what to call after each episode.
    """

    protocol: str
    spec: ControllerSpec
    config: Any
    run: Callable[..., Any]

    @property
    def work(self) -> float:
        """About how long it takes, beside other cells: simulated seconds."""
        return float(self.config.episodes * self.config.duration)

    def identity(self) -> dict[str, Any]:
        """Everything that determines the result, as JSON."""
        controller = self.spec.identity()
        return {
            "protocol": self.protocol,
            "config": to_json(self.config),
            "controller": controller,
            **code_identity([self.run.__module__, *controller["modules"]]),
        }


@dataclasses.dataclass(frozen=True)
class CellResult:
    """What a cell gave.

    Attributes:
        protocol: as on the command line.
        controller: its label.
        result: the protocol's result, as JSON.
    """

    protocol: str
    controller: str
    result: dict[str, Any]


def run_cells(
    cells: Sequence[Cell], execution: Execution, on_progress: Callable[[float], None] | None = None
) -> list[CellResult]:
    """Run the cells that are not finished yet, one after the other, and read the others.

    Args:
        cells: what to run.
        execution: where episodes run; finished episodes and cells are kept in its store, if it has one.
        on_progress: called with the fraction done after each episode.

    Raises:
        ResultFileError: if there is a file in the way that is foreign or of another version.
    """
    total, done = sum(cell.work for cell in cells), 0.0
    results = []
    for cell in cells:
        report = on_progress and _Progress(on_progress, done / total, cell.work / total / cell.config.episodes)
        results.append(CellResult(cell.protocol, cell.spec.label, _result(cell, execution, report)))
        done += cell.work
        if on_progress is not None:
            on_progress(done / total)
    return results


@dataclasses.dataclass
class _Progress:
    """Turns finished episodes of a cell into the fraction done of all cells."""

    tell: Callable[[float], None]
    fraction: float
    share: float

    def __call__(self, row: object) -> None:
        self.fraction += self.share
        self.tell(min(self.fraction, 1.0))


def _result(cell: Cell, execution: Execution, on_episode: Callable[[object], None] | None) -> dict[str, Any]:
    path, identity = None, {}
    if execution.store is not None:
        identity = cell.identity()
        path = execution.store.folder / FOLDER / f"{cell.protocol}-{cell.spec.label}-{digest(identity)[:16]}.json"
        path = path.with_name(path.name.replace(" ", "_"))
        if execution.store.first_use(path):
            set_aside(path)
        if path.exists():
            return read_result(path, identity)
    config = cell.config
    if any(field.name == "execution" for field in dataclasses.fields(config)):
        config = dataclasses.replace(config, execution=execution)
    result = _finite(dataclasses.asdict(cell.run(cell.spec.build, config, on_episode)))
    content = {"format": FORMAT, "version": VERSION, "identity": identity, "result": result}
    text = json.dumps(content, allow_nan=False)
    if path is not None:
        _write(path, text)
    return json.loads(text)["result"]


def read_result(path: pathlib.Path, identity: dict[str, Any] | None = None) -> dict[str, Any]:
    """The result in a cell's file.

    Args:
        path: of the file.
        identity: what it should be of; None takes any.

    Raises:
        ResultFileError: if the file cannot be read, or is foreign, of another version or of another cell.
    """
    remedy = "nothing was changed; move the file away, or choose another folder for the results"
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ResultFileError(f"cannot read {path}: {error}; {remedy}") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ResultFileError(f"{path} is no result of an evaluation; {remedy}")
    if content.get("version") != VERSION:
        raise ResultFileError(
            f"{path} has format version {content.get('version')}, this hugwbc reads {VERSION}; {remedy}"
        )
    if identity is not None and content.get("identity") != identity:
        raise ResultFileError(f"{path} holds the result of another cell than its name says; {remedy}")
    return content["result"]


def _finite(content: Any) -> Any:  # noqa: ANN401  whatever JSON holds
    """JSON with null for numbers that are not finite."""
    if isinstance(content, dict):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def _write(path: pathlib.Path, text: str) -> None:
    """Write a file at once: a reader sees all of it or nothing."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=path.stem, suffix=".tmp")
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
        os.replace(name, path)
    except OSError as error:
        raise ResultFileError(
            f"cannot write {path}: {error.strerror}; choose another folder for the results"
        ) from error

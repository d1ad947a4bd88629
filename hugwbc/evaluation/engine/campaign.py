"""Run many protocols with many controllers; the result of each finished cell is a JSON file that a report reads."""

import dataclasses
import json
import pathlib
from collections.abc import Callable, Sequence
from typing import Any

from hugwbc.errors import ResultFileError
from hugwbc.evaluation.engine.execution import Execution
from hugwbc.evaluation.engine.identity import code_identity, digest, judge_module, to_json
from hugwbc.evaluation.engine.store import ResultStore, set_aside
from hugwbc.files import finite_json, write_whole
from hugwbc.runtime.controllers import ControllerSpec

FORMAT = "hugwbc result"
VERSION = 1
FOLDER = "cells"


@dataclasses.dataclass(frozen=True)
class Cell:
    """One protocol with one controller.

    Attributes:
        protocol: name of the protocol, as on the command line.
        spec: the controller.
        config: settings of the protocol.
        run: function of the protocol; called with a controller factory, the settings, and a function to call after each
            episode.
        episodes: number of episodes in all, or about that.
    """

    protocol: str
    spec: ControllerSpec
    config: Any
    run: Callable[..., Any]
    episodes: int

    @property
    def told(self) -> ControllerSpec:
        """The controller, told the robot and the drives of the settings; its label leaves them out."""
        return self.spec.told(self.config.conditions.told_arena)

    @property
    def work(self) -> float:
        """The simulated seconds of the cell, an estimate of its share of the whole campaign."""
        return float(self.episodes * self.config.duration)

    def identity(self) -> dict[str, Any]:
        """Return everything that determines the result, as JSON."""
        controller = self.told.identity()
        return {
            "protocol": self.protocol,
            "config": to_json(self.config),
            "controller": controller,
            **code_identity([judge_module(self.run), *controller["modules"]]),
        }


@dataclasses.dataclass(frozen=True)
class CellResult:
    """The result of a cell.

    Attributes:
        protocol: name of the protocol, as on the command line.
        controller: label of the controller.
        result: result of the protocol, as JSON.
    """

    protocol: str
    controller: str
    result: dict[str, Any]


def run_cells(
    cells: Sequence[Cell], execution: Execution, on_progress: Callable[[float, float], None] | None = None
) -> list[CellResult]:
    """Run the cells that are not finished yet one after the other, and read the results of the others.

    Args:
        cells: the cells to run.
        execution: where episodes run; finished episodes and cells are kept in its store, if it has one.
        on_progress: called after each episode with the fraction done and the fraction that was only read.

    Raises:
        ResultFileError: if a result's file is in another format or version, or cannot be written.
    """
    progress = _Progress(on_progress or (lambda fraction, read: None), sum(cell.work for cell in cells), execution)
    results = []
    for cell in cells:
        path, identity = _place(cell, execution.store)
        if path is not None and path.exists():
            result = read_result(path, identity)
            progress.end(cell, read=True)
        else:
            result = _run(cell, execution, path, identity, progress.begin(cell))
            progress.end(cell)
        results.append(CellResult(cell.protocol, cell.spec.label, result))
    return results


class _Progress:
    """The fraction of all work that is done, from finished cells and episodes."""

    def __init__(self, tell: Callable[[float, float], None], total: float, execution: Execution) -> None:
        self._tell, self._total, self._store = tell, total, execution.store
        self._done = self._read = 0.0  # simulated seconds, of cells that are finished
        self._partly_read = 0.0  # of the cell under way

    def begin(self, cell: Cell) -> Callable[[object], None]:
        """Return the function to call after each episode of a cell."""
        share = cell.work / cell.episodes
        before, episodes = self._restored, 0

        def on_episode(_: object) -> None:
            nonlocal episodes
            episodes += 1
            done = min(episodes, cell.episodes)  # a search may take more episodes than estimated
            self._partly_read = share * min(self._restored - before, done)
            self._report(share * done)

        return on_episode

    def end(self, cell: Cell, *, read: bool = False) -> None:
        """Count a cell as finished; `read` if its result was stored."""
        self._done += cell.work
        self._read += cell.work if read else self._partly_read
        self._partly_read = 0.0
        self._report()

    @property
    def _restored(self) -> int:
        return 0 if self._store is None else self._store.restored

    def _report(self, done: float = 0.0) -> None:
        self._tell(min((self._done + done) / self._total, 1.0), (self._read + self._partly_read) / self._total)


def _place(cell: Cell, store: ResultStore | None) -> tuple[pathlib.Path | None, dict[str, Any]]:
    """Return the file of a result and its identity; nothing without a store. A fresh store renames an old file."""
    if store is None:
        return None, {}
    identity = cell.identity()
    name = f"{cell.protocol}-{cell.spec.label}-{digest(identity)[:16]}.json".replace(" ", "_")
    path = store.folder / FOLDER / name
    if store.first_use(path):
        set_aside(path)
    return path, identity


def _run(
    cell: Cell,
    execution: Execution,
    path: pathlib.Path | None,
    identity: dict[str, Any],
    on_episode: Callable[[object], None],
) -> dict[str, Any]:
    config = cell.config
    if any(field.name == "execution" for field in dataclasses.fields(config)):
        config = dataclasses.replace(config, execution=execution)
    result = finite_json(dataclasses.asdict(cell.run(cell.told.build, config, on_episode)))
    content = {"format": FORMAT, "version": VERSION, "identity": identity, "result": result}
    text = json.dumps(content, allow_nan=False)
    if path is not None:
        try:
            write_whole(path, text)
        except OSError as error:
            raise ResultFileError(
                f"cannot write {path}: {error.strerror}; choose another folder for the results"
            ) from error
    return json.loads(text)["result"]


def read_result(path: pathlib.Path, identity: dict[str, Any] | None = None) -> dict[str, Any]:
    """Return the result in a cell's file.

    Args:
        path: path of the file.
        identity: expected identity of the cell; None accepts any.

    Raises:
        ResultFileError: if the file cannot be read, has another format or version, or belongs to another cell.
    """
    remedy = "nothing was changed; move the file away, or choose another folder for the results"
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ResultFileError(f"cannot read {path}: {error}; {remedy}") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ResultFileError(f"{path} is not a result of an evaluation; {remedy}")
    if content.get("version") != VERSION:
        raise ResultFileError(
            f"{path} has format version {content.get('version')}, this hugwbc reads {VERSION}; {remedy}"
        )
    if identity is not None and content.get("identity") != identity:
        raise ResultFileError(f"{path} holds the result of another cell than its name says; {remedy}")
    if "result" not in content:
        raise ResultFileError(f"{path} holds no result; {remedy}")
    return content["result"]

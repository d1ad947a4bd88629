"""Finished episodes on the disk: one table for each experiment, settings, controller, commit and versions of packages.

A table is a file of JSON lines. The first line is its key; every other line is the row of one episode. Rows are only
appended, each by one write, so that a killed run loses only the episodes that were running.
"""

import contextlib
import dataclasses
import functools
import importlib.metadata
import inspect
import json
import os
import pathlib
import re
from collections.abc import Callable, Iterator
from typing import Any

from hugwbc import extensions
from hugwbc.errors import ConfigError
from hugwbc.evaluation.episode import Row, Settings
from hugwbc.evaluation.plans import Plan
from hugwbc.files import digest, digest_of, is_own, note, noting, write_whole, writing
from hugwbc.learned.policy.records import versions
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.scripts.motion import motion_files
from hugwbc.sim.physx import PhysxSimulation
from hugwbc.source import source_commit
from hugwbc.tasks.task import registered_tasks

DEFAULT_FOLDER = pathlib.Path("out") / "evaluation"
_EPISODE, READ = "_episode", "_read"  # of a row: digest of its plan, and those of files that only the episode read
Episode = Callable[..., Row]
"""What runs one episode: a function of a module."""


class StoredTable:
    """The rows of one table, which is on the disk if it has a path.

    Attributes:
        path: path of the file, which is created with the first row; None keeps the rows in memory.
    """

    def __init__(self, path: pathlib.Path | None, key: dict[str, Any], *, fresh: bool = False) -> None:
        """Read the file if it exists; its rows do not count if they are to be measured afresh."""
        self.path, self._key = path, key
        stored = {} if path is None or not path.exists() else _read(path, key)
        self._rows = {} if fresh else stored

    def get(self, plan: Plan) -> Row | None:
        """Return the row of an episode, or None if it has not run."""
        return self._rows.get(digest(repr(plan)))

    def add(self, plan: Plan, row: Row) -> Row:
        """Append the row of an episode, and return it as it will be read."""
        episode, known = digest(repr(plan)), self._key["files"]
        read = {name: found for name, found in row.pop(READ, {}).items() if known.get(name) != found}
        try:
            self._rows[episode] = json.loads(json.dumps(row))
        except TypeError as error:
            odd = ", ".join(f"{name} ({type(value).__name__})" for name, value in row.items() if not _is_plain(value))
            what = f"an episode of '{self._key['experiment']}' gives {odd}, which is no plain number or text"
            raise ConfigError(f"{what}; convert it, such as by float(x) or x.tolist()") from error
        if self.path is not None:
            with writing(self.path):
                _append(self.path, self._key, {_EPISODE: episode, **({READ: read} if read else {}), **row})
        return self._rows[episode]


class Store:
    """A folder of tables; None keeps all rows in memory.

    Attributes:
        folder: folder of the files, created with the first row.
        fresh: whether to run again what is stored; new rows take the place of the earlier ones.
    """

    def __init__(self, folder: str | pathlib.Path | None = DEFAULT_FOLDER, *, fresh: bool = False) -> None:
        """Use a folder."""
        self.folder, self.fresh = None if folder is None else pathlib.Path(folder), fresh

    def table(self, experiment: str, episode: Episode, settings: Settings, spec: ControllerSpec) -> StoredTable:
        """Return the table of an experiment with a controller."""
        key = table_key(experiment, episode, settings, spec)
        if self.folder is None:
            return StoredTable(None, key)
        name = f"{experiment}-{spec.label}-{digest(json.dumps(key))[:16]}.jsonl"
        return StoredTable(self.folder / re.sub(r"[/\\:]+", "-", name.replace(" ", "_")), key, fresh=self.fresh)


def table_key(experiment: str, episode: Episode, settings: Settings, spec: ControllerSpec) -> dict[str, Any]:
    """Return what tells a table from others, as JSON: names, settings, versions, digests of controller, code and files.

    A shipped policy counts only where it is the controller, by its digest; with a user's own code, which may load any
    of them, all count. Robots count by their tables and descriptions. The number of episodes does not count: more of
    them continue a table.
    """
    files, given = _files(episode, settings), dataclasses.asdict(settings)
    given.pop("episodes", None)
    own = spec.is_own or any(path.endswith(".py") for path in files)
    return json.loads(
        json.dumps(
            {
                "experiment": experiment,
                "controller": spec.label,
                "digest": controller_digest(spec),
                "commit": source_commit(policies=own),
                "versions": versions() | _further_versions(),
                "settings": given,
                "arenas": [arena.version for arena in (settings.conditions.chosen, settings.conditions.told_arena)],
                "files": files,
            },
            default=str,
        )
    )


def _further_versions() -> dict[str, str]:
    """Return the versions of what runs exported policies, and of the second engine, where they are installed."""
    found = {}
    for package in ("onnxruntime", PhysxSimulation.package):
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            found[package] = importlib.metadata.version(package)
    return found


def controller_digest(spec: ControllerSpec) -> str:
    """Return a digest of everything that a controller depends on, the content of its files included."""
    return digest(json.dumps(spec.identity(), sort_keys=True, default=str))


def _files(episode: Episode, settings: Settings) -> dict[str, str]:
    """Return the digests of what settings name and read, motions in a folder included, and of a user's own code."""
    with noting() as read:
        code = [pathlib.Path(inspect.getfile(part)) for part in (type(settings), episode)]
        for text in _texts(dataclasses.asdict(settings)):
            path = extensions.split_object(text)[0] if extensions.names_object(text) else pathlib.Path(text)
            for file in motion_files(path) if path.is_dir() else [path] if path.suffix else []:
                note(file)
            code += [path] * extensions.names_object(text)
            entry = registered_tasks().get(text)
            for file in extensions.code_of(source) if entry and (source := extensions.source_of(entry)) else ():
                note(file)
        for path in [path for path in code if is_own(path) and path.is_file()]:
            extensions.note_code(path)
        dataclasses.replace(settings)  # reads everything again
    return read


def _texts(value: Any) -> Iterator[str]:  # noqa: ANN401  of settings
    if isinstance(value, str):
        yield value
    for item in value.values() if isinstance(value, dict) else value if isinstance(value, list | tuple) else ():
        yield from _texts(item)


def _is_plain(value: Any) -> bool:  # noqa: ANN401  of a row
    with contextlib.suppress(TypeError):
        return bool(json.dumps(value))
    return False


def _read(path: pathlib.Path, key: dict[str, Any]) -> dict[str, Row]:
    try:
        first, *lines = path.read_text(encoding="utf-8", errors="replace").splitlines() or [""]
    except OSError:
        first, lines = "", []
    if first != json.dumps(key):
        raise ConfigError(f"{path} is not a table of episodes; move it away, or choose another folder")
    rows: dict[str, Row] = {}
    now = functools.cache(digest_of)
    for line in lines:
        try:
            row = json.loads(line)
            if all(now(name) == found for name, found in row.pop(READ, {}).items()):
                rows[row.pop(_EPISODE)] = row
        except (ValueError, KeyError, AttributeError, TypeError, RecursionError):
            continue  # a killed run left half a line: its episode runs again
    return rows


def _append(path: pathlib.Path, key: dict[str, Any], row: Row) -> None:
    """Append a line, and before the first one the key; a line that was cut off before it stays a line of its own."""
    if not path.exists():
        write_whole(path, json.dumps(key) + "\n")
    with path.open("rb") as file:
        file.seek(-1, os.SEEK_END)
        cut_off = file.read(1) != b"\n"
    with path.open("a", encoding="utf-8") as file:
        file.write("\n" * cut_off + json.dumps(row) + "\n")

"""Store finished episodes in files: an interrupted evaluation resumes, a finished one is only read.

A file has the episodes of one cell: one controller, one judge, one set of settings. Its first line is the cell's
identity; every other line is the row of one episode with its key and a checksum. Lines are only appended, each by one
write, so that a killed run loses only the episodes that were running.
"""

import dataclasses
import errno
import itertools
import json
import logging
import os
import pathlib
import tempfile
import zlib
from typing import Any

from hugwbc.errors import ResultFileError
from hugwbc.evaluation.engine.identity import digest

FORMAT = "hugwbc episodes"
VERSION = 1
DEFAULT_FOLDER = pathlib.Path("out") / "evaluation"

_log = logging.getLogger(__name__)


class EpisodeFile:
    """The stored rows of one cell, a mapping from an episode's key to its row.

    Attributes:
        path: path of the file, which is created with the first row.
        damaged: number of lines that could not be read; their episodes count as missing.
    """

    def __init__(self, path: pathlib.Path, identity: dict[str, Any]) -> None:
        """Read the file if it exists.

        Args:
            path: path of the file.
            identity: identity of the cell, JSON.

        Raises:
            ResultFileError: if the file has another format or version, or belongs to another cell.
        """
        self.path = path
        self.damaged = 0
        self._identity = identity
        self._rows: dict[str, Any] = {}
        self._complete = True  # whether the last line ends with a line break
        if path.exists():
            self._read()

    def __len__(self) -> int:
        return len(self._rows)

    def __contains__(self, key: str) -> bool:
        return key in self._rows

    def __getitem__(self, key: str) -> Any:  # noqa: ANN401  whatever JSON holds
        return self._rows[key]

    def rows(self) -> list[Any]:
        """Return all rows, in the order in which they were stored."""
        return list(self._rows.values())

    def add(self, key: str, row: Any) -> None:  # noqa: ANN401  whatever JSON holds
        """Append the row of an episode, so that it outlives this process.

        Raises:
            ResultFileError: if the file cannot be written.
        """
        payload = _dump({"key": key, "row": row})
        try:
            if not self.path.exists():
                _create(self.path, _dump({"format": FORMAT, "version": VERSION, "identity": self._identity}))
            _append(self.path, ("" if self._complete else "\n") + f"{zlib.crc32(payload.encode()):08x} {payload}\n")
        except OSError as error:
            self._complete = False  # a part of the line may have been written
            raise ResultFileError(
                f"cannot write {self.path}: {error.strerror}; choose another folder for the results"
            ) from error
        self._complete = True
        self._rows[key] = json.loads(payload)["row"]

    def _read(self) -> None:
        try:
            text = self.path.read_text(encoding="utf-8", errors="replace")
        except OSError as error:
            raise ResultFileError(f"cannot read {self.path}: {error.strerror}; make it readable") from error
        head, *lines = text.split("\n")
        self._check(head)
        self._complete = text.endswith("\n")
        for line in filter(None, lines):
            checksum, _, payload = line.partition(" ")
            if checksum != f"{zlib.crc32(payload.encode()):08x}":
                self.damaged += 1
                continue
            entry = json.loads(payload)
            self._rows[entry["key"]] = entry["row"]
        if self.damaged:
            _log.warning("%s: %d damaged line(s) left out; their episodes are run again", self.path, self.damaged)

    def _check(self, head: str) -> None:
        remedy = "nothing was changed; move the file away, or choose another folder for the results"
        try:
            found = json.loads(head)
        except ValueError:
            found = None
        if not isinstance(found, dict) or found.get("format") != FORMAT:
            raise ResultFileError(
                f"{self.path} is not a file of evaluated episodes, or its first line is damaged; {remedy}"
            )
        if found.get("version") != VERSION:
            raise ResultFileError(
                f"{self.path} has format version {found.get('version')}, this hugwbc reads {VERSION}; {remedy}"
            )
        if found.get("identity") != self._identity:
            raise ResultFileError(f"{self.path} holds the episodes of another cell than its name says; {remedy}")


class ResultStore:
    """A folder of episode files.

    Attributes:
        folder: folder of the files, created with the first row.
        restored: number of episodes that were read from files instead of run.
    """

    def __init__(self, folder: str | pathlib.Path = DEFAULT_FOLDER, *, fresh: bool = False) -> None:
        """Use a folder.

        Args:
            folder: folder of the files.
            fresh: whether to ignore earlier results; a file that exists when its cell is opened is renamed.
        """
        self.folder = pathlib.Path(folder)
        self.restored = 0
        self._fresh = fresh
        self._seen: set[pathlib.Path] = set()
        self._open: dict[pathlib.Path, EpisodeFile] = {}

    def first_use(self, path: pathlib.Path) -> bool:
        """Return whether to set a file aside: in a fresh store, the first time that it is asked for."""
        first = self._fresh and path not in self._seen
        self._seen.add(path)
        return first

    def _path(self, label: str, identity: dict[str, Any]) -> pathlib.Path:
        return self.folder / f"{label}-{digest(identity)[:16]}.jsonl"

    def peek(self, label: str, identity: dict[str, Any]) -> EpisodeFile | None:
        """Return the file of a cell if it is there; a fresh store has only what was stored since.

        Unlike `cell`, this leaves an earlier file where it is. Arguments and errors as there.
        """
        path = self._path(label, identity)
        if path in self._open:
            return self._open[path]
        return EpisodeFile(path, identity) if path.exists() and not self._fresh else None

    def cell(self, label: str, identity: dict[str, Any]) -> EpisodeFile:
        """Return the file of a cell, the same object every time.

        Args:
            label: readable start of the file's name.
            identity: everything that determines the rows except the episodes' own keys, JSON.

        Raises:
            ResultFileError: if the file exists and cannot be used.
        """
        path = self._path(label, identity)
        if path not in self._open:
            if self.first_use(path):
                set_aside(path)
            self._open[path] = EpisodeFile(path, identity)
        return self._open[path]


def set_aside(path: pathlib.Path) -> pathlib.Path | None:
    """Rename a file to `.1.old` or the next free number; return the new path, or None if there was no file."""
    if not path.exists():
        return None
    numbered = (path.with_suffix(f".{number}.old") for number in itertools.count(1))
    kept = next(candidate for candidate in numbered if not candidate.exists())
    path.rename(kept)
    _log.warning("%s: the earlier results are kept as %s", path, kept.name)
    return kept


def plain(row: object) -> Any:  # noqa: ANN401  whatever JSON holds
    """Return a row as it is stored: the fields of a dataclass, anything else unchanged."""
    return dataclasses.asdict(row) if dataclasses.is_dataclass(row) and not isinstance(row, type) else row


def _dump(content: object) -> str:
    return json.dumps(content, separators=(",", ":"))


def _create(path: pathlib.Path, head: str) -> None:
    """Create a file with its first line, atomically and only if it does not exist."""
    # Linking a finished file into place fails if the name is taken; no process can see a half-written first line.
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=path.stem, suffix=".tmp")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(head + "\n")
        os.link(name, path)
    except FileExistsError:
        return  # another process was faster; its first line is the same
    finally:
        os.unlink(name)


def _append(path: pathlib.Path, text: str) -> None:
    data, handle = text.encode(), os.open(path, os.O_WRONLY | os.O_APPEND)
    try:
        if os.write(handle, data) < len(data):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    finally:
        os.close(handle)

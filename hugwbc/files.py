"""Files that are written completely or not at all, what is read meanwhile, digests, and numbers that JSON can hold."""

import contextlib
import contextvars
import errno
import fcntl
import functools
import hashlib
import math
import os
import pathlib
import secrets
import sys
import sysconfig
from collections.abc import Iterator
from typing import Any

from hugwbc.errors import ConfigError

LOCK = "run.lock"
# What the commit and the versions of packages stand for, and what belongs to the system.
_PACKAGE = pathlib.Path(__file__).parent
_SYSTEM = ("/proc", "/sys", "/dev", "/etc", "/usr/lib", "/usr/share", sysconfig.get_path("stdlib"))
_INSTALLED = (str(_PACKAGE), str(_PACKAGE.parent / "models"), *_SYSTEM)
_NOT_OWN = {"__pycache__", ".cache", "site-packages", "dist-packages"}
_reading: contextvars.ContextVar[set[str] | None] = contextvars.ContextVar("reading", default=None)


def write_whole(path: str | pathlib.Path, content: bytes | str) -> None:
    """Replace a file atomically: readers see either the old or the new content, whatever happens meanwhile.

    If several processes write it at once, one of them wins.

    Args:
        path: path of the file; its folder is created. Special files such as /dev/stdout are written to directly.
        content: bytes, or text, which is encoded as UTF-8.

    Raises:
        OSError: if the file cannot be written.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    path = pathlib.Path(path).resolve()  # a symbolic link stays a link
    if path.exists() and not path.is_file():
        path.write_bytes(data)
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    # The name is unique, because another process may be writing the same file.
    temporary = path.with_name(f"{path.name}.{secrets.token_hex(8)}.partial")
    try:
        with temporary.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def writing(path: str | pathlib.Path) -> Iterator[None]:
    """Turn an `OSError` in writing a file or a folder into a `ConfigError` that says what to do."""
    try:
        yield
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror}; give a path that can be written") from error


@contextlib.contextmanager
def sole_writer(folder: pathlib.Path) -> Iterator[None]:
    """Create a folder and keep other processes from writing to it; a killed process leaves no lock behind."""
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        file = (folder / LOCK).open("a")
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise ConfigError(f"another process is working on {folder}; wait for it or stop it") from error
        yield


def read_file(path: pathlib.Path, largest: int) -> bytes:
    """Return the bytes of a file that somebody else may have made.

    Args:
        path: path of the file.
        largest: most bytes that it may have.

    Raises:
        OSError: if it cannot be read, has more bytes, or is a folder, a device or a pipe, which could have no end;
            `strerror` says which.
    """
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "it is no file", str(path))
    with path.open("rb") as file:
        content = file.read(largest + 1)
    if len(content) > largest:
        raise OSError(errno.EFBIG, f"it has more than {largest} bytes", str(path))
    return content


@contextlib.contextmanager
def noting() -> Iterator[dict[str, str]]:
    """Collect the user's files that this thread reads meanwhile, with their digests; the mapping is filled at the end.

    Whatever Python opens counts, and what libraries in other languages read if their callers `note` it.
    """
    _watch_reading()
    names: set[str] = set()
    found: dict[str, str] = {}
    before = _reading.set(names)
    try:
        yield found
    finally:
        _reading.reset(before)
        for name in sorted(names):
            if is_own(name) and (now := digest_of(name)) is not None:
                note(name)  # for whoever else collects
                found[name] = now


def note(path: str | pathlib.Path) -> None:
    """Let those that collect know that a file is read."""
    if (names := _reading.get()) is not None:
        names.add(os.fspath(path))


def is_own(path: str | pathlib.Path) -> bool:
    """Return whether a file is neither part of an installed package or the system nor a cache."""
    parts = pathlib.Path(os.path.abspath(path))
    return not _NOT_OWN & {*parts.parts} and not any(parts.is_relative_to(root) for root in _INSTALLED)


@functools.cache
def _watch_reading() -> None:
    def see(event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open" and isinstance(arguments[0], str) and not (arguments[2] or 0) & (os.O_WRONLY | os.O_RDWR):
            note(arguments[0])

    sys.addaudithook(see)


def digest(content: bytes | str) -> str:
    """Return 32 hexadecimal digits of the SHA-256 of bytes, or of a text as UTF-8."""
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()[:32]


def digest_of(path: str | pathlib.Path) -> str | None:
    """Return the digest of a file, or None if there is none."""
    return digest(pathlib.Path(path).read_bytes()) if os.path.isfile(path) else None


def finite_json(content: Any) -> Any:  # noqa: ANN401  whatever JSON holds
    """Return JSON content with null in place of numbers that are not finite."""
    if isinstance(content, dict):
        return {key: finite_json(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [finite_json(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content
